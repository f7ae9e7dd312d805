"""Straight line at constant speed after a ramp; the reference continues straight beyond both ends of the line."""

from math import radians
from typing import Literal

import numpy as np

from agrobot_mj.core.kernels import shared, stage
from agrobot_mj.core.samples import write_reference
from agrobot_mj.core.signals import Matrix, Reference, Vector
from agrobot_mj.core.spec import Positive
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, advance, progress, reference
from agrobot_mj.paths.base import ReferencePath


@shared
def _reference(start: Pose, ramp: float, speed: float, t: float) -> Reference:
    moved, fraction = progress(t, ramp)
    return reference(advance(start, 0.0, speed * moved), 0.0, fraction * speed)


@stage
def _references(start: Pose, ramp: float, speed: float, times: Vector) -> Matrix:
    references = np.empty((times.size, 7))
    for n, t in enumerate(times):
        write_reference(references, n, _reference(start, ramp, speed, t))
    return references


class Line(ReferencePath):
    """Path along a straight line from (start_x_m, start_y_m) in the direction heading_deg."""

    ends = True

    kind: Literal["line"] = "line"
    ramp_s: Ramp = RAMP_S
    """Duration of the acceleration from rest [s], or 0 for no ramp. Assumed value, equal to the default of
    `figure_eight`."""
    length_m: Positive = 144.0
    """Length of the line [m]. Assumed value, equal to the length of one lap of the default figure-eight."""
    heading_deg: float = 0.0
    """Direction of travel [deg], counter-clockwise from east."""
    start_x_m: float = 0.0
    """East coordinate of the start [m]."""
    start_y_m: float = 0.0
    """North coordinate of the start [m]."""

    @property
    def duration_s(self) -> float:
        """Travel time from the start to the end of the line [s]."""
        return self.ramp_s / 2 + self.length_m / self.speed_m_s

    @property
    def max_curvature(self) -> float:
        """Maximum absolute curvature [1/m], which is 0."""
        return 0.0

    @property
    def sharpest(self) -> Place:
        """Point of maximum curvature: the start, because the curvature is zero everywhere."""
        return Place(self.start_x_m, self.start_y_m, 0.0)

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s]; the line continues beyond its ends."""
        return _reference(self._start, self.ramp_s, self.speed_m_s, t)

    def _references_at(self, times: Vector) -> Matrix:
        return _references(self._start, self.ramp_s, self.speed_m_s, times)

    @property
    def _start(self) -> Pose:
        return Pose(self.start_x_m, self.start_y_m, radians(self.heading_deg))
