"""A straight line at constant speed after a ramp.

The reference goes straight on beyond both ends.
"""

from math import radians
from typing import Literal

from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import Positive
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, advance, progress, reference
from agrobot_mj.paths.base import ReferencePath


class Line(ReferencePath):
    """A straight line from (start_x_m, start_y_m) in direction heading_deg."""

    ends = True

    kind: Literal["line"] = "line"
    ramp_s: Ramp = RAMP_S
    """Time over which the speed rises from rest; 0: at once [s]. Assumed value: as the figure eight."""
    length_m: Positive = 144.0
    """Length [m]; assumed value: as long as one turn of the default figure 8."""
    heading_deg: float = 0.0
    """Direction of travel from east, counter-clockwise [deg]."""
    start_x_m: float = 0.0
    """Start, east [m]."""
    start_y_m: float = 0.0
    """Start, north [m]."""

    @property
    def duration_s(self) -> float:
        """Time from the start to the end [s]."""
        return self.ramp_s / 2 + self.length_m / self.speed_m_s

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        return 0.0

    @property
    def sharpest(self) -> Place:
        """Place of the largest curvature: it is zero everywhere, so the start."""
        return Place(self.start_x_m, self.start_y_m, 0.0)

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s] since the start; any `t`, the line has no end in space."""
        start = Pose(self.start_x_m, self.start_y_m, radians(self.heading_deg))
        moved, share = progress(t, self.ramp_s)
        return reference(advance(start, 0.0, self.speed_m_s * moved), 0.0, share * self.speed_m_s)
