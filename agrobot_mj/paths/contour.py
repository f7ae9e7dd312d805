"""To and fro along the contour lines of a plane slope, one swath higher after each turn.

`uphill_deg` is the direction of steepest ascent, the `direction_deg` of a terrain of kind `slope`; with its default of
90 deg the legs run east and west. Legs lie `swath_m` apart on the map. See `parallel` for turns and passes.
"""

from math import pi, radians
from typing import Literal

from agrobot_mj.paths.parallel import Parallel


class Contour(Parallel):
    """Parallel passes across a slope, from the lowest upwards."""

    kind: Literal["contour"] = "contour"
    uphill_deg: float = 90.0
    """Direction of steepest ascent from east, counter-clockwise [deg]."""
    first_uphill: Literal["left", "right"] = "left"
    """Side of the first leg on which the hill rises."""

    @property
    def lie(self) -> tuple[float, float]:
        """Direction of the first pass [rad] and the side on which the others lie: 1 left, -1 right."""
        side = 1.0 if self.first_uphill == "left" else -1.0
        return radians(self.uphill_deg) - side * pi / 2, side
