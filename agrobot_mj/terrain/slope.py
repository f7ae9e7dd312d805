"""A plane slope."""

from math import cos, radians, sin, tan
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.spec import Positive
from agrobot_mj.terrain.base import Landscape
from agrobot_mj.terrain.grid import Ground, plane


class Slope(Landscape):
    """A plane that rises by `grade_deg` towards `direction_deg`, through height zero at the origin."""

    kind: Literal["slope"] = "slope"
    grade_deg: Annotated[float, Field(ge=0, lt=45)] = 5.0
    """Angle between the plane and the horizontal [deg]."""
    direction_deg: float = 90.0
    """Direction of steepest ascent, from east, counter-clockwise [deg]."""
    half_size_m: Positive = 500.0
    """From the origin to each edge of the field [m]."""

    def relief(self) -> Ground:
        """The height grid."""
        grade, direction = tan(radians(self.grade_deg)), radians(self.direction_deg)
        return plane(grade * cos(direction), grade * sin(direction), self.half_size_m)
