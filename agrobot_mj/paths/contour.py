"""Parallel passes along the contour lines of a plane slope, starting with the lowest pass.

`uphill_deg` is the direction of steepest ascent, equal to the `direction_deg` of a terrain of kind `slope`. By default
the passes run east and west. `swath_m` is the horizontal distance between passes. See `parallel` for turns and passes.
"""

from math import pi, radians
from typing import Literal

from agrobot_mj.paths.parallel import Parallel


class Contour(Parallel):
    """Parallel passes across a slope, starting with the lowest pass."""

    kind: Literal["contour"] = "contour"
    uphill_deg: float = 90.0
    """Direction of steepest ascent [deg], counter-clockwise from east."""
    first_uphill: Literal["left", "right"] = "left"
    """Side of the first pass that faces uphill, as seen in the direction of travel."""

    @property
    def orientation(self) -> tuple[float, float]:
        """Direction of the first pass [rad], and the side of the other passes: 1 for left, -1 for right."""
        side = 1.0 if self.first_uphill == "left" else -1.0
        return radians(self.uphill_deg) - side * pi / 2, side
