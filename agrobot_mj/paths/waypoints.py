"""A way through waypoints of a CSV file, smoothed by a cubic spline.

The spline [Dierckx1993] passes the waypoints at a root mean square distance of at most `smoothing_m`, as smoothly as
that allows; with 0 it goes through every one. Its curvature is continuous. An open way goes from the first waypoint to
the last; a closed one joins the last to the first (a last row that repeats the first may stand or not) and goes round
`laps` times, then straight on. A third column limits the speed from each waypoint to the next, linearly between them;
`speed_m_s` stays the largest. The heading between waypoints is that of the spline: a zigzag of the points is a zigzag
of the way, and a curvature that the tractor cannot steer is an error that names the place.
"""

import warnings
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr
from scipy.interpolate import splev, splprep

from agrobot_mj.core.datafile import Stamp
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, samples, through
from agrobot_mj.paths.waypoint_file import CLOSEST_M, stamp_of, waypoints


class Waypoints(Timed):
    """Waypoints from a file."""

    kind: Literal["waypoints"] = "waypoints"
    file: str = "waypoints.csv"
    """CSV file with the columns x, y [m] and, if wanted, speed [m/s]; a header may stand above them."""
    smoothing_m: Annotated[float, Field(ge=0, le=1000)] = 0.05
    """Root mean square distance that the way may keep from the waypoints [m]. Estimate: twice the noise of RTK-GNSS."""
    closed: bool = False
    """Whether the way returns to its first waypoint."""
    laps: Annotated[int, Field(ge=1, le=1000)] = 1
    """How often to go round a closed way [-]."""

    _stamp: Stamp | None = PrivateAttr(default=None)
    """The state of the file: what is built of it belongs to this state alone."""

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each lap, an open way being one [s]."""
        length, laps = float(self.motion.distances[-1]), self._laps
        times = [self.motion.when(k * length / laps) for k in range(laps)] + [self.duration_s]
        return tuple(pairwise(times))

    @property
    def _laps(self) -> int:
        return self.laps if self.closed else 1

    def course(self) -> Course:
        """The smoothed way, in arcs. Raises ValueError when the file is not as it should be."""
        try:
            self._stamp = self._stamp or stamp_of(self.file)
            points = waypoints(self._stamp)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
        lap = _smooth(points, self.smoothing_m, self.closed)
        lengths, curvatures, speeds = (np.tile(part, self._laps) for part in lap[1:])
        return Course(lap.start, lengths, curvatures, speeds)


def _smooth(points: Array, smoothing: float, closed: bool) -> Course:
    """One lap through `points`, shape (n, 2 or 3)."""
    if closed and np.hypot(*(points[-1] - points[0])[:2]) >= CLOSEST_M:
        points = np.vstack([points, points[:1]])
    x, y = points[:, 0], points[:, 1]
    ways = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that a very smooth spline stops short of the distance allowed
        spline, _ = splprep([x, y], u=ways, s=len(points) * smoothing**2, k=min(3, len(points) - 1), per=closed)
    u = np.linspace(0.0, ways[-1], samples(float(ways[-1])))
    x, y = splev(u, spline)
    dx, dy = splev(u, spline, der=1)
    if np.hypot(np.diff(x), np.diff(y)).min() < 1e-9:
        raise ValueError(f"smoothing_m: {smoothing:g} m leaves no way between the waypoints; make it smaller")
    allowed = np.interp((u[:-1] + u[1:]) / 2, ways, points[:, 2]) if points.shape[1] == 3 else np.inf
    return through(x, y, np.arctan2(dy, dx), allowed)
