"""Path through the waypoints of a file: straight legs with rounded corners, or a smoothing spline.

`corners = "fillet"`: The legs between waypoints are exactly straight, and `fillet.py` rounds the corners. A corner is
the widest arc within `smoothing_m` of its waypoint, or an arc of `corner_radius_m` if that is wider. The path thus cuts
corners with a large angle, and follows a series of small-angle corners as a smooth curve.

`corners = "spline"`: The path is the smoothest cubic spline [Dierckx1993] with a root mean square distance of at most
`smoothing_m` from the waypoints; with 0 it passes through all waypoints. Its curvature is continuous, but it oscillates
about a straight row next to a corner.

An open path runs from the first to the last waypoint. A closed path joins the last to the first (a repeated first row
at the end is optional), runs for `laps` laps, and continues straight. With fillets a lap starts on the first leg, after
the corner at the first waypoint. A third column limits the speed, linearly interpolated between waypoints, in addition
to `speed_m_s`. Repeated points and the scatter of a standstill are left out, and a recorded track whose noise is too
sharp to steer becomes a spline. A curvature that the tractor cannot follow is an error that names the location.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from agrobot_mj.core.resources import Stamp, stamp
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.paths.fillet import Rounding, rounded
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.recorded import TIGHTEST, is_recorded, smooth, steerable
from agrobot_mj.paths.track import Course, checked_length
from agrobot_mj.paths.transition import Transitions
from agrobot_mj.paths.waypoint_file import CLOSEST_M, Track, stamp_of, track


class Waypoints(Transitions, Timed):
    """Path through the waypoints of a file."""

    sized: ClassVar = {**Transitions.sized, "corner_radius_m": {"turn": 1}}
    radius_key: ClassVar = "corner_radius_m"

    kind: Literal["waypoints"] = "waypoints"
    reads_file: ClassVar[bool] = True
    """Always True: the course is read from a file."""
    file: str = "waypoints.csv"
    """File of positions: CSV with columns named x, y [m] or lat, lon [deg], and optionally speed [m/s]; KML, GeoJSON,
    GPX, a shapefile, or a file of an AgOpenGPS field."""
    crs: str = ""
    """Coordinate system of a file in metres, such as EPSG:25832. Default: metres of a local plane."""
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
    def notes(self) -> tuple[str, ...]:
        """Sentences about what was changed in the file."""
        return (*self._track().notes, *_lap(self)[1])

    def _track(self) -> Track:
        try:
            self._stamp = self._stamp or stamp_of(self.file)
            return track(self._stamp, self.crs, self.closed)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None

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
        points = self.waypoints()
        checked_length(self._laps * float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum()))
        lap = _lap(self)[0]
        return Course(lap.start, *(np.tile(part, self._laps) for part in lap[1:]))

    def waypoints(self) -> Array:
        """Return the waypoints, shape (n, 2 or 3); the last one of a closed path equals its first."""
        points = self._track().points
        if self.closed and np.hypot(*(points[-1] - points[0])[:2]) >= CLOSEST_M:
            points = np.vstack([points, points[:1]])
        return points

    def rounded(self, points: Array) -> Course:
        """Return one lap of straight legs and fillets through `points`, shape (n, 2 or 3)."""
        rounding = Rounding(
            self.corner_radius_m, self.smoothing_m, self.speed_m_s, self.lateral_acceleration_m_s2, self
        )
        return rounded(points, self.closed, rounding)


@lru_cache(maxsize=16)
def _lap(path: Waypoints) -> tuple[Course, tuple[str, ...]]:
    points, reason = path.waypoints(), ""
    try:
        lap = path.rounded(points) if path.corners == "fillet" else smooth(points, path.smoothing_m, path.closed)
    except ValueError as error:
        reason = str(error)
    if reason.startswith("smoothing_m"):
        raise ValueError(reason)
    if not is_recorded(points):
        if reason:
            raise ValueError(f"file: {path.file}: {reason}")
        return lap, ()
    if not reason and lap.peaks.max() <= 1 / (TIGHTEST * path.corner_radius_m):
        return lap, ()
    lap, amount = steerable(points, path.closed, path.corner_radius_m)
    return lap, (f"the recorded track is smoothed with a spline within {amount:.2g} m (rms) because of its noise",)
