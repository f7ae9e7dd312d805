"""A way through waypoints of a CSV file: straight legs with rounded corners, or a smoothing spline.

`corners = "fillet"`: the legs from waypoint to waypoint are straight to rounding, and `fillet.py` rounds the corners. A
corner turns on the widest arc that stays within `smoothing_m` of its waypoint, or on one of `corner_radius_m` where
that is wider, so that a sharp corner is cut and a chain of gentle ones becomes a flowing curve.

`corners = "spline"`: a cubic spline [Dierckx1993] passes the waypoints at a root mean square distance of at most
`smoothing_m`, as smoothly as that allows; with 0 it goes through every one. Its curvature is continuous, but it swings
to either side of a straight row beside a corner.

An open way goes from the first waypoint to the last; a closed one joins the last to the first (a last row that repeats
the first may stand or not) and goes round `laps` times, then straight on. With fillets a lap begins on the first leg,
behind the corner at the first waypoint. A third column limits the speed from each waypoint to the next, linearly
between them; `speed_m_s` stays the largest. A curvature that the tractor cannot steer is an error that names the place.
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
from agrobot_mj.paths.track import Course, affordable, samples, through
from agrobot_mj.paths.transition import Transitions
from agrobot_mj.paths.waypoint_file import CLOSEST_M, stamp_of, waypoints


class Waypoints(Transitions, Timed):
    """Waypoints from a file."""

    sized: ClassVar = {**Transitions.sized, "corner_radius_m": {"turn": 1}}
    radius_key: ClassVar = "corner_radius_m"

    kind: Literal["waypoints"] = "waypoints"
    reads_file: ClassVar[bool] = True
    """The course is that of the file."""
    file: str = "waypoints.csv"
    """CSV file with the columns x, y [m] and, if wanted, speed [m/s]; a header may stand above them."""
    corners: Literal["fillet", "spline"] = "fillet"
    """Straight legs with rounded corners, or a smoothing spline through all waypoints."""
    corner_radius_m: Positive = 4.0
    """Radius of a sharp corner, less where the legs are too short for it [m]. When left out it grows with the turning
    circle of the machine. Assumed value (2.5-10): 19 deg of steering."""
    smoothing_m: Annotated[float, Field(ge=0, le=1000)] = 0.05
    """Distance that the way may keep from the waypoints: at gentle corners, or root mean square of a spline [m].
    Assumed value (0-0.5): twice the noise of RTK-GNSS."""
    transition: Literal["none", "clothoid"] = "clothoid"
    """How a fillet begins and ends: with a step of the curvature, or with a clothoid."""
    closed: bool = False
    """Whether the way returns to its first waypoint."""
    laps: Annotated[int, Field(ge=1, le=1000)] = 1
    """How often to go round a closed way [-]."""

    _stamp: Stamp | None = PrivateAttr(default=None)
    """The state of the file: what is built of it belongs to this state alone."""

    def model_post_init(self, context: Any, /) -> None:
        """Note the state of the file, without reading it: equal keys of another state are another path."""
        self._stamp = stamp(self.file)

    def check(self) -> None:
        """Look at the file before it is opened, then build the course. Raises ValueError."""
        try:
            stamp_of(self.file)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
        super().check()

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each lap, an open way being one [s]."""
        length, laps = float(self.motion.distances[-1]), self._laps
        times = [self.motion.time_at(k * length / laps) for k in range(laps)] + [self.duration_s]
        return tuple(pairwise(times))

    @property
    def _laps(self) -> int:
        return self.laps if self.closed else 1

    def course(self) -> Course:
        """The way, in straights, arcs and clothoids. Raises ValueError when the file is not as it should be."""
        try:
            self._stamp = self._stamp or stamp_of(self.file)
            points = waypoints(self._stamp)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
        if self.closed and np.hypot(*(points[-1] - points[0])[:2]) >= CLOSEST_M:
            points = np.vstack([points, points[:1]])
        affordable(self._laps * float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum()))
        lap = self._rounded(points) if self.corners == "fillet" else _smooth(points, self.smoothing_m, self.closed)
        return Course(lap.start, *(np.tile(part, self._laps) for part in lap[1:]))

    def _rounded(self, points: Array) -> Course:
        """One lap of straight legs and fillets through `points`, shape (n, 2 or 3)."""
        rounding = Rounding(
            self.corner_radius_m, self.smoothing_m, self.speed_m_s, self.lateral_acceleration_m_s2, self
        )
        try:
            return rounded(points, self.closed, rounding)
        except ValueError as error:
            raise ValueError(f"file: {self.file}: {error}") from None


def _smooth(points: Array, smoothing: float, closed: bool) -> Course:
    """One lap along the spline through `points`, shape (n, 2 or 3)."""
    from scipy.interpolate import splev, splprep  # here, since it takes a tenth of a second of every start

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
