"""Path through waypoints of a CSV file: straight legs with rounded corners, or a smoothing spline.

`corners = "fillet"`: The legs between waypoints are exactly straight, and `fillet.py` rounds the corners. A corner is
the widest arc within `smoothing_m` of its waypoint, or an arc of `corner_radius_m` if that is wider. The path thus cuts
corners with a large angle, and follows a series of small-angle corners as a smooth curve.

`corners = "spline"`: The path is the smoothest cubic spline [Dierckx1993] with a root mean square distance of at most
`smoothing_m` from the waypoints; with 0 it passes through all waypoints. Its curvature is continuous, but it oscillates
about a straight row next to a corner.

An open path runs from the first to the last waypoint. A closed path joins the last to the first waypoint (a repeated
first row at the end is optional), runs for `laps` laps, and continues straight. With fillets a lap starts on the first
leg, after the corner at the first waypoint. A third column limits the speed in addition to `speed_m_s`, linearly
interpolated between waypoints. A curvature that the tractor cannot follow is an error that names the location.
"""

import warnings
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from agrobot_mj.core.resources import Stamp, stamp
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.paths.fillet import Rounding, rounded
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, checked_length, samples, through
from agrobot_mj.paths.transition import Transitions
from agrobot_mj.paths.waypoint_file import CLOSEST_M, stamp_of, waypoints


class Waypoints(Transitions, Timed):
    """Path through the waypoints of a file."""

    sized: ClassVar = {**Transitions.sized, "corner_radius_m": {"turn": 1}}
    radius_key: ClassVar = "corner_radius_m"

    kind: Literal["waypoints"] = "waypoints"
    reads_file: ClassVar[bool] = True
    """Always True: the course is read from a file."""
    file: str = "waypoints.csv"
    """CSV file with the columns x, y [m] and, optionally, speed [m/s]; a header is optional."""
    corners: Literal["fillet", "spline"] = "fillet"
    """Corner type: straight legs with rounded corners (`fillet`), or a smoothing spline (`spline`)."""
    corner_radius_m: Positive = 4.0
    """Radius of corners with a large angle, smaller if the legs are too short [m]. Default: proportional to the turning
    circle of the machine. Assumed value (2.5-10); the steering angle is 19 deg."""
    smoothing_m: Annotated[float, Field(ge=0, le=1000)] = 0.05
    """Maximum distance from the waypoints at small-angle corners, or root mean square distance of a spline [m]. Assumed
    value (0-0.5), twice the noise of RTK-GNSS."""
    transition: Literal["none", "clothoid"] = "clothoid"
    """Transition at the ends of a fillet: step of the curvature (`none`) or clothoid."""
    closed: bool = False
    """Whether the path returns to its first waypoint."""
    laps: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of laps of a closed path [-]."""

    _stamp: Stamp | None = PrivateAttr(default=None)
    """Stamp of the file content from which the course was built."""

    def model_post_init(self, context: Any, /) -> None:
        """Record the stamp of the file without reading it; paths with equal keys and different content differ."""
        self._stamp = stamp(self.file)

    def check(self) -> None:
        """Check the file before reading it, then build the course. Raise ValueError if it is invalid."""
        try:
            stamp_of(self.file)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
        super().check()

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each lap; an open path is one lap [s]."""
        length, laps = float(self.motion.distances[-1]), self._laps
        times = [self.motion.time_at(k * length / laps) for k in range(laps)] + [self.duration_s]
        return tuple(pairwise(times))

    @property
    def _laps(self) -> int:
        return self.laps if self.closed else 1

    def course(self) -> Course:
        """Return the straights, arcs and clothoids. Raise ValueError if the file is invalid."""
        try:
            self._stamp = self._stamp or stamp_of(self.file)
            points = waypoints(self._stamp)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
        if self.closed and np.hypot(*(points[-1] - points[0])[:2]) >= CLOSEST_M:
            points = np.vstack([points, points[:1]])
        checked_length(self._laps * float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum()))
        lap = self._rounded(points) if self.corners == "fillet" else _smooth(points, self.smoothing_m, self.closed)
        return Course(lap.start, *(np.tile(part, self._laps) for part in lap[1:]))

    def _rounded(self, points: Array) -> Course:
        """Return one lap of straight legs and fillets through `points`, shape (n, 2 or 3)."""
        rounding = Rounding(
            self.corner_radius_m, self.smoothing_m, self.speed_m_s, self.lateral_acceleration_m_s2, self
        )
        try:
            return rounded(points, self.closed, rounding)
        except ValueError as error:
            raise ValueError(f"file: {self.file}: {error}") from None


def _smooth(points: Array, smoothing: float, closed: bool) -> Course:
    """Return one lap along the spline through `points`, shape (n, 2 or 3)."""
    from scipy.interpolate import splev, splprep  # slow import (0.1 s), needed only by this function

    x, y = points[:, 0], points[:, 1]
    distances = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a very smooth spline may end below the allowed distance
        spline, _ = splprep([x, y], u=distances, s=len(points) * smoothing**2, k=min(3, len(points) - 1), per=closed)
    u = np.linspace(0.0, distances[-1], samples(float(distances[-1])))
    x, y = splev(u, spline)
    dx, dy = splev(u, spline, der=1)
    if np.hypot(np.diff(x), np.diff(y)).min() < 1e-9:
        raise ValueError(f"smoothing_m: {smoothing:g} m smooths the path away; reduce it")
    allowed = np.interp((u[:-1] + u[1:]) / 2, distances, points[:, 2]) if points.shape[1] == 3 else np.inf
    return through(x, y, np.arctan2(dy, dx), allowed)
