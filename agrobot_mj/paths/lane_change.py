"""Lane change: a straight, a transition to a parallel line, and a straight; optionally followed by a transition back.

The shape follows the tracks of [ISO2018], but defines a line instead of a lane between cones. The lateral offset
divided by its final value is 10 u^3 - 15 u^4 + 6 u^5, where u is the distance along the lines divided by `change_m`.
The curvature is zero at both ends of the transition.
"""

from math import radians
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import HUGE, Positive
from agrobot_mj.paths.parallel import Coordinate
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, course_along, samples


class LaneChange(Timed):
    """Path of a single or double lane change."""

    kind: Literal["lane_change"] = "lane_change"
    offset_m: Annotated[float, Field(ge=-HUGE, le=HUGE)] = 3.0
    """Distance to the parallel line [m], positive to the left. Assumed value (range 2-4): a traffic lane, or three
    track widths."""
    change_m: Positive = 12.0
    """Length of one lane change along the line [m]. Assumed value (range 8-20), which gives a bend radius of 8.8 m with
    the default offset."""
    straight_m: Positive = 20.0
    """Length of each straight before, between and after lane changes [m]. Assumed value (range 10-30), long enough for
    errors to decay."""
    double: bool = False
    """Whether the path returns to the first line (double lane change)."""
    heading_deg: float = 0.0
    """Direction of the lines [deg], counter-clockwise from east."""
    start_x_m: Coordinate = 0.0
    """East coordinate of the start [m]."""
    start_y_m: Coordinate = 0.0
    """North coordinate of the start [m]."""

    def course(self) -> Course:
        """Return the geometry of the path along all straights and lane changes."""
        changes = 2 if self.double else 1
        end = changes * (self.straight_m + self.change_m) + self.straight_m
        count = max(samples(end + changes * abs(self.offset_m)), int(64 * min(end / self.change_m, 1e4)))
        x = np.linspace(0.0, end, count)
        y, slope = self._change(x - self.straight_m)
        if self.double:
            back, back_slope = self._change(x - 2 * self.straight_m - self.change_m)
            y, slope = y - back, slope - back_slope
        return course_along((self.start_x_m, self.start_y_m, radians(self.heading_deg)), x, y, slope)

    def _change(self, x: Array) -> tuple[Array, Array]:
        """Return the lateral offset [m] and the slope [-] of a lane change at the distances `x` [m] from its start."""
        u = np.clip(x / self.change_m, 0.0, 1.0)
        return self.offset_m * u**3 * (10 - 15 * u + 6 * u**2), self.offset_m * 30 * u**2 * (1 - u) ** 2 / self.change_m
