"""Swaths over a rectangular field: parallel AB lines with turns on the headlands.

The first pass is the AB line from (start_x_m, start_y_m) in direction `heading_deg`; the others lie on the side of the
`first_turn`. Any corner of a field is a start: turn the heading, and choose the side. The field reaches half a swath
beyond the outer passes; see `parallel` for turns and passes.
"""

from math import radians
from typing import Literal

from agrobot_mj.paths.parallel import Parallel


class Swaths(Parallel):
    """Parallel passes along a heading."""

    kind: Literal["swaths"] = "swaths"
    heading_deg: float = 0.0
    """Direction of the first pass from east, counter-clockwise [deg]."""
    first_turn: Literal["left", "right"] = "left"
    """Side of the first pass on which the field lies."""

    @property
    def lie(self) -> tuple[float, float]:
        """Direction of the first pass [rad] and the side on which the others lie: 1 left, -1 right."""
        return radians(self.heading_deg), 1.0 if self.first_turn == "left" else -1.0
