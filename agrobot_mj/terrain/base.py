"""Base of every terrain: a relief, patches with other properties on it, and for most kinds a tilted plane below."""

from functools import lru_cache
from math import cos, radians, sin, tan
from typing import Annotated

import numpy as np
from pydantic import Field

from agrobot_mj.core.contracts import check_type
from agrobot_mj.core.datafile import stamp as file_stamp
from agrobot_mj.core.spec import Spec
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.terrain.patches import GroundPatch, surface

STEEPEST_DEG = 60.0
"""Steepest slope between neighbouring nodes; no tractor drives on a steeper one [deg]. Estimate."""
Grade = Annotated[float, Field(ge=0, lt=45)]


class Landscape(Spec):
    """A terrain; a kind overrides `relief`."""

    kind: str
    patch: Annotated[tuple[GroundPatch, ...], Field(max_length=1000)] = ()
    """Patches of ground with other properties; where they overlap the last one counts."""

    def relief(self) -> Ground:
        """The height grid alone. Raises ValueError, naming the key, if it cannot be made."""
        raise NotImplementedError

    def stamp(self) -> tuple[object, ...]:
        """A value that changes whenever a file of the relief or of a patch changes."""
        return tuple(file_stamp(part.file) for part in (self, *self.patch) if hasattr(part, "file"))

    def ground(self) -> Ground:
        """The height grid with the properties of the ground. Raises ValueError, naming the key."""
        return _ground(self, self.stamp())


class Tilted(Landscape):
    """A terrain on a plane that rises by `grade_deg` towards `direction_deg`, through height zero at the origin."""

    grade_deg: Grade = 0.0
    """Angle between the plane and the horizontal [deg]."""
    direction_deg: float = 90.0
    """Direction of steepest ascent, from east, counter-clockwise [deg]."""

    @property
    def gradient(self) -> tuple[float, float]:
        """Gradient of the plane, dh/dx and dh/dy [-]."""
        grade, direction = tan(radians(self.grade_deg)), radians(self.direction_deg)
        return grade * cos(direction), grade * sin(direction)

    def tilted(self, ground: Ground) -> Ground:
        """The grid with the plane added."""
        rows, columns = ground.heights.shape
        x = ground.x0 + ground.spacing * np.arange(columns)
        y = ground.y0 + ground.spacing * np.arange(rows)
        grade_x, grade_y = self.gradient
        heights = ground.heights + grade_x * x[None, :] + grade_y * y[:, None]
        return ground._replace(heights=np.ascontiguousarray(heights))


@lru_cache(maxsize=4)
def _ground(landscape: Landscape, stamp: tuple[object, ...]) -> Ground:
    relief = check_type(landscape.relief(), Ground, "the terrain", landscape.kind, "relief")
    heights = np.asarray(relief.heights)
    if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all():
        raise ValueError("relief: its heights must be finite numbers, two rows and two columns or more")
    return relief._replace(surface=surface(landscape.patch, relief.extent)) if landscape.patch else relief
