"""Path through the waypoints of a file: straight legs with rounded corners, or a smoothing spline.

`corners = "fillet"`: The legs between waypoints are exactly straight, and `fillet.py` rounds the corners. A corner is
the widest arc within `smoothing_m` of its waypoint, or an arc of `corner_radius_m` if this arc is wider. The path thus
cuts corners with a large angle, and follows a series of small-angle corners as a smooth curve.

`corners = "spline"`: The path is the smoothest cubic spline [Dierckx1993] with a root mean square distance of at most
`smoothing_m` from the waypoints; with 0 it passes through all waypoints. Its curvature is continuous, but it oscillates
about a straight row next to a corner.

An open path runs from the first to the last waypoint. A closed path returns to the first waypoint (which may be
repeated as the last row of the file), runs for `laps` laps, and continues straight. With fillets a lap starts on the
first leg, after the corner at the first waypoint. A speed column limits the speed in addition to `speed_m_s`; the limit
is interpolated linearly between waypoints. Repeated points and the scatter at standstill are omitted. A recorded track
with noise that the tractor cannot follow becomes a spline. Reverse driving, and a curvature that the tractor cannot
follow, are errors that name the location.

Waypoints are read from CSV, KML, GeoJSON or GPX, from a file of an AgOpenGPS field, or from a shapefile. The longest
line of the file is the track. If the file has no lines, its longest ring is used, or else its points in the order of
the file. An AB line of AgOpenGPS is cut at the Boundary.txt in the same folder. Every error is a ValueError that names
the file, the table row and the fix.
"""

import warnings
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.resources import Stamp, refuse, stamp
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.paths.arc import FASTEST_M_S, SLOWEST_M_S
from agrobot_mj.paths.fillet import Rounding, round_corners
from agrobot_mj.paths.from_file import FromFile
from agrobot_mj.paths.imports import Polyline, clean, local_shapes, read_shapes
from agrobot_mj.paths.imports.agopengps import BOUNDARY, cut_line
from agrobot_mj.paths.imports.cleaning import CLOSEST_M, cusps
from agrobot_mj.paths.track import Course, checked_length, samples, through
from agrobot_mj.paths.transition import Transitions

MAX_BYTES = 2_000_000
MAX_ROWS = 20_000


class Track(NamedTuple):
    """Waypoints read from a file, with notes about changes to the data in the file."""

    points: Array  # Waypoints, shape (n, 2) or (n, 3): x, y [m] and speed [m/s]
    notes: tuple[str, ...]  # Sentences about omitted columns, shapes and points, and about a shift of the coordinates


@lru_cache(maxsize=8)
def track(file_stamp: Stamp, crs: str, closed: bool, boundary: Stamp | None = None) -> Track:
    """Return at least three waypoints of a file, in metres of a local plane. Raise ValueError for an invalid file.

    `boundary` is the stamp of the field boundary next to a file of AgOpenGPS, at which an AB line is cut.
    """
    file = Path(file_stamp[0])
    read = read_shapes(file_stamp[0], MAX_BYTES)
    try:
        shape, left = _choose_line(read.shapes)
        if shape.properties.get("extends"):
            points, note = cut_line(shape.points, read_shapes(boundary[0], MAX_BYTES) if boundary else None)
            shape, left = replace(shape, points=points), [*left, note]
        found = local_shapes(replace(read, shapes=(shape,)), crs)
        points, notes = _clean_line(found.shapes[0], closed)
    except ValueError as error:
        refuse(file, str(error))
    return Track(points, (*found.notes, *left, *notes))


def _choose_line(shapes: tuple[Polyline, ...]) -> tuple[Polyline, list[str]]:
    lines = [shape for shape in shapes if not shape.ring and shape.role != "point"]
    rings = [shape for shape in shapes if shape.ring and shape.role != "hole"]
    if not (choice := lines or rings):
        return Polyline(np.vstack([np.empty((0, 2)), *(shape.points for shape in shapes)]), name="points"), []
    best = max(choice, key=lambda shape: float(np.hypot(*np.diff(shape.points, axis=0).T).sum()))
    if len(choice) == 1:
        return best, []
    named = f", {best.name!r}," if best.name else ""
    return best, [f"the longest{named} of {len(choice)} {'lines' if lines else 'rings'} is used"]


def _clean_line(shape: Polyline, closed: bool) -> tuple[Array, list[str]]:
    points = shape.points
    if len(points) > MAX_ROWS:
        raise ValueError(f"the file has {len(points)} waypoints, but the limit is {MAX_ROWS}; remove some rows")
    notes = list[str]()
    if len(points) >= 3:
        reverses = any((shape.columns.get(name, np.zeros(1)) < 0).any() for name in ("direction", "speed"))
        kept, notes = clean(points, closed, reverses)
        rows = np.asarray(shape.columns.get("row", np.arange(1, len(points) + 1)), float)[kept]
        points = points[kept]
        if "speed" in shape.columns:
            speeds, more = _speeds(shape.columns["speed"][kept], points, rows)
            points, notes = np.column_stack([points, speeds]), [*notes, *more]
    if not closed and len(points) == 2:
        points = np.insert(points, 1, points.mean(axis=0), axis=0)  # a straight line
    if len(points) < 3:
        raise ValueError(f"the file has {len(points)} different waypoints; at least {2 + closed} are required")
    return points, notes


CREEP_M_S = 0.1  # Limit of the speed at a standstill of a recorded track [m/s]. Assumed value (range 0.05-0.3).


def _speeds(speeds: Array, points: Array, rows: Array) -> tuple[Array, list[str]]:
    """Return the speed limits from a column of speeds [m/s], and notes about limited or raised speeds. Raise ValueError
    for an invalid speed."""
    still = (speeds >= 0) & (speeds < SLOWEST_M_S) & (len(points) >= FEWEST_POINTS)
    if (wrong := np.flatnonzero((speeds < SLOWEST_M_S) & ~still)).size:
        row, speed = rows[wrong[0]], speeds[wrong[0]]
        raise ValueError(f"row {row:.0f}: speed is {speed:g} m/s; use a speed from {SLOWEST_M_S:g} to {FASTEST_M_S:g}")
    notes, fast = list[str](), speeds > FASTEST_M_S
    if fast.any():
        notes.append(f"{fast.sum()} speeds above {FASTEST_M_S:g} m/s are limited to {FASTEST_M_S:g} m/s")
    if still.any():
        notes.append(f"{still.sum()} speeds at a standstill are raised to {CREEP_M_S:g} m/s")
    return np.where(still, CREEP_M_S, np.minimum(speeds, FASTEST_M_S)), notes


DENSE_M, SPARSE_M, FEWEST_POINTS = 1.0, 3.0, 20
"""Maximum median point distances of a recorded track that is smoothed, and of a recorded track whose reversals are
cusps [m], and minimum number of points of a recorded track [-]."""
TIGHTEST = 0.4
"""Minimum bend radius of a recorded track, divided by `corner_radius_m` [-]. Assumed value, near full steering lock."""
WIDER, LEAST_M, MOST_M = 1.3, 0.005, 1.0
"""Factor between successive smoothing distances in the search for a spline [-], and limits of this distance [m]."""
FARTHEST_M = 4.0  # Maximum distance of a spline from the recorded points [m]. Assumed value, less than a swath width.
THIRD_DIFFERENCE = 20.0 * np.log(2.0)
"""Ratio of the median squared third difference of positions with white noise to the mean squared noise [-]."""


def smooth(points: Array, smoothing: float, closed: bool) -> Course:
    """Return the geometry of one lap along a smoothing spline of `points`, shape (n, 2 or 3), with an rms deviation of
    at most `smoothing` [m]."""
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
        raise ValueError(f"smoothing_m: {smoothing:g} m removes the shape of the path; reduce the value")
    allowed = np.interp((u[:-1] + u[1:]) / 2, distances, points[:, 2]) if points.shape[1] == 3 else np.inf
    return through(x, y, np.arctan2(dy, dx), allowed)


def is_recorded(points: Array, distance: float = DENSE_M) -> bool:
    """Return whether waypoints, shape (n, 2 or 3), come from a recorded track: many points with a median distance below
    `distance` [m]."""
    if len(points) < FEWEST_POINTS:
        return False
    return float(np.median(np.hypot(*np.diff(points[:, :2], axis=0).T))) < distance


def noise(points: Array) -> float:
    """Return the rms position noise [m] of a recorded track with points of shape (n, 2 or 3)."""
    third = np.diff(points[:, :2], n=3, axis=0)
    return float(np.sqrt(np.median((third**2).sum(axis=1)) / THIRD_DIFFERENCE))


def steerable(points: Array, closed: bool, radius: float) -> tuple[Course, str]:
    """Return the least smoothed spline that the tractor can follow on a recorded track, and a sentence about it.

    The tractor can follow bends with a radius of at least TIGHTEST times `radius` [m]. The smoothing distance starts at
    the position noise of the track. If it exceeds MOST_M, or the spline is farther than FARTHEST_M from the points, the
    track is smoothed by its noise only.
    """
    least, tightest = max(noise(points), LEAST_M), TIGHTEST * radius
    amount, found, reason = least, smooth(points, least, closed), "its noise"
    while (tight := found.peaks.max() > 1 / tightest) and amount < MOST_M:
        amount *= WIDER
        found, reason = smooth(points, amount, closed), f"bends with a radius below {tightest:.2g} m"
    if tight or _distances(points, found).max() > FARTHEST_M:
        amount, found, reason = least, smooth(points, least, closed), "its noise"
    apart = _distances(points, found)
    x, y = points[int(np.argmax(apart)), :2].tolist()
    return found, (
        f"the recorded track is smoothed with a spline within {amount:.2g} m (rms) and {apart.max():.2g} m (maximum, "
        f"at ({x:.1f}, {y:.1f}) m) because of {reason}"
    )


def _distances(points: Array, lap: Course) -> Array:
    """Return the distances of `points`, shape (n, 2 or 3), from a spline through these points [m], shape (n,)."""
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))))
    x, y, _ = lap.joints()
    at = np.linspace(0.0, along[-1], len(x))
    found: Array = np.hypot(points[:, 0] - np.interp(along, at, x), points[:, 1] - np.interp(along, at, y))
    return found


class Waypoints(Transitions, FromFile):
    """Path through the waypoints of a file."""

    sized: ClassVar = {**Transitions.sized, "corner_radius_m": {"turn": 1}}
    radius_key: ClassVar = "corner_radius_m"

    kind: Literal["waypoints"] = "waypoints"
    max_bytes: ClassVar[int] = MAX_BYTES
    file: str = "waypoints.csv"
    """File of positions: KML, GeoJSON, GPX, a shapefile, a file of an AgOpenGPS field, or CSV. CSV columns are named x,
    y [m] or lat, lon [deg], and optionally speed [m/s]."""
    crs: str = ""
    """Coordinate system of a file in metres, such as EPSG:25832. Default: metres of a local plane."""
    corners: Literal["fillet", "spline"] = "fillet"
    """Corner type: straight legs with rounded corners (`fillet`), or a smoothing spline (`spline`)."""
    corner_radius_m: Positive = 4.0
    """Radius of corners with a large angle [m], reduced if the legs are too short. Default: proportional to the turning
    circle of the machine. Assumed value (range 2.5-10); 4 m require a steering angle of 19 deg."""
    smoothing_m: Annotated[float, Field(ge=0, le=1000)] = 0.05
    """Maximum distance of the path from the waypoints [m]: at corners with a small angle, or as a root mean square for
    a spline. Assumed value (range 0-0.5), twice the noise of RTK-GNSS."""
    transition: Literal["none", "clothoid"] = "clothoid"
    """Transition at both ends of a fillet: a step of the curvature (`none`) or a clothoid."""
    closed: bool = False
    """Whether the path returns to its first waypoint."""
    laps: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of laps of a closed path [-]."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about changes to the data read from the file."""
        return (*self._track().notes, *_lap(self)[1])

    def _track(self) -> Track:
        return self.content(
            lambda content: track(content, self.crs, self.closed, stamp(str(Path(content[0]).with_name(BOUNDARY))))
        )

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end times of each lap [s]. An open path consists of one lap."""
        length, laps = float(self.motion.distances[-1]), self._laps
        times = [self.motion.time_at(k * length / laps) for k in range(laps)] + [self.duration_s]
        return tuple(pairwise(times))

    @property
    def _laps(self) -> int:
        return self.laps if self.closed else 1

    def course(self) -> Course:
        """Return the geometry of the path along all laps. Raise ValueError if the file is invalid."""
        points = self.waypoints()
        checked_length(self._laps * float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum()))
        lap = _lap(self)[0]
        return Course(lap.start, *(np.tile(part, self._laps) for part in lap[1:]))

    def waypoints(self) -> Array:
        """Return the waypoints, shape (n, 2 or 3); the last waypoint of a closed path equals the first waypoint."""
        points = self._track().points
        if self.closed and np.hypot(*(points[-1] - points[0])[:2]) >= CLOSEST_M:
            points = np.vstack([points, points[:1]])
        return points

    def round_corners(self, points: Array) -> Course:
        """Return the geometry of one lap through `points`, shape (n, 2 or 3), with straight legs and fillets."""
        rounding = Rounding(
            self.corner_radius_m, self.smoothing_m, self.speed_m_s, self.lateral_acceleration_m_s2, self
        )
        return round_corners(points, self.closed, rounding)


@lru_cache(maxsize=16)
def _lap(path: Waypoints) -> tuple[Course, tuple[str, ...]]:
    points, reason = path.waypoints(), ""
    try:
        lap = path.round_corners(points) if path.corners == "fillet" else smooth(points, path.smoothing_m, path.closed)
    except ValueError as error:
        reason = str(error)
    if reason.startswith("smoothing_m"):
        raise ValueError(reason)
    if not reason and lap.peaks.max() <= 1 / (TIGHTEST * path.corner_radius_m):
        return lap, ()
    if is_recorded(points, SPARSE_M) and len(found := cusps(points[:, :2], noise(points))):
        x, y = points[found[0], :2].tolist()
        reason = (
            f"the recorded track reverses at ({x:.1f}, {y:.1f}) m, but waypoints are driven forward; remove the points "
            "of the manoeuvre, or use a path of the kind manoeuvre"
        )
    elif is_recorded(points):
        lap, note = steerable(points, path.closed, path.corner_radius_m)
        return lap, (note,)
    if reason:
        raise ValueError(f"file: {path.file}: {reason}")
    return lap, ()
