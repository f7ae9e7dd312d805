"""Swaths on a rectangular field: parallel AB lines with turns on the headlands.

The first pass is the AB line from (start_x_m, start_y_m) in the direction `heading_deg`. The other passes follow on the
side `first_turn`. To start at another corner of the field, change `heading_deg` and `first_turn`. The field extends
half a swath beyond the outer passes. See `parallel` for turns and passes.
"""

from math import radians
from typing import Literal

from agrobot_mj.paths.parallel import Parallel


class Swaths(Parallel):
    """Parallel passes across a rectangular field."""

    kind: Literal["swaths"] = "swaths"
    heading_deg: float = 0.0
    """Direction of the first pass [deg], counter-clockwise from east."""
    first_turn: Literal["left", "right"] = "left"
    """Side of the first pass on which the other passes lie, relative to the travel direction of the first pass."""

    @property
    def orientation(self) -> tuple[float, float]:
        """Direction of the first pass [rad], and the side of the other passes: 1 for left, -1 for right."""
        return radians(self.heading_deg), 1.0 if self.first_turn == "left" else -1.0
