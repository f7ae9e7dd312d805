"""A plane slope."""

from typing import Literal

from agrobot_mj.terrain.base import Grade, Tilted
from agrobot_mj.terrain.extent import Sized
from agrobot_mj.terrain.grid import Ground, plane


class Slope(Sized, Tilted):
    """A plane that rises by `grade_deg` towards `direction_deg`, through height zero at the origin."""

    kind: Literal["slope"] = "slope"
    grade_deg: Grade = 5.0
    """Angle between the plane and the horizontal [deg]."""

    def relief(self) -> Ground:
        """The height grid."""
        return plane(*self.gradient, *self.half_sizes)
