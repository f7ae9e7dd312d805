"""Plane terrains: level ground and a slope."""

from typing import Literal

from agrobot_mj.terrain.base import Grade, Landscape, Sized, Tilted
from agrobot_mj.terrain.grid import Ground, plane


class Flat(Sized, Landscape):
    """Terrain with level ground at height zero."""

    kind: Literal["flat"] = "flat"

    def relief(self) -> Ground:
        """Return a height grid at height zero."""
        return plane(0.0, 0.0, *self.half_sizes)


class Slope(Sized, Tilted):
    """Terrain on a plane that rises by `grade_deg` towards `direction_deg`, with height zero at the origin."""

    kind: Literal["slope"] = "slope"
    grade_deg: Grade = 5.0

    def relief(self) -> Ground:
        """Return the height grid of the sloping plane."""
        return plane(*self.gradient, *self.half_sizes)
