"""Driven length of the path, and whether this length is sufficient.

The path is evaluated up to the planned end of the run or, if earlier, its own end. A segment is driven if the tractor
moves along the segment within CORRIDOR_M. The nearest point is tracked between successive positions of the tractor (see
`paths.route`), so that it stays on the same branch of a crossing, lap and swath. If the tractor is more than ASTRAY_M
away from the tracked point, the search also covers the neighbourhood of the reference. Segments that the nearest point
skips do not count. A tractor at standstill makes no progress, even if the reference passes it.

Guidance without a path must drive the distance given by its speed commands.
"""

from collections.abc import Iterator, Sequence
from math import hypot
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.long_array import PIECE
from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.crosstrack import FARTHEST_M
from agrobot_mj.paths.route import SampledRoute

CORRIDOR_M = 5.0
"""Maximum distance from the path at which a segment counts as driven [m]. Assumed value: the width of two swaths."""
ENOUGH = 0.9  # Minimum fraction of the path that must be driven [-]. Assumed value.
LATE_S = 2.0  # Delay behind the reference that is allowed at the end [s]. Assumed value: the tractor starts from rest.
STEP_M = 0.25
"""Spacing of the evaluated tractor positions, and minimum path length for computing the driven fraction [m]."""
ASTRAY_M = 1.0  # Distance from the path above which the nearest point is also searched near the reference [m]
LEAP_M = 1.5
"""Maximum path length counted as driven between two positions [m]. This length exceeds STEP_M, because the path is
longer than the track of a tractor on the inside of a bend."""


class PathProgress(NamedTuple):
    """Driven length of a path, its total length, and the required length."""

    driven: float  # Driven length of the path [m]
    length: float  # Length of the path [m]
    due: float  # Path length that the reference has covered LATE_S before the planned end [m]

    @property
    def share(self) -> float | None:
        """Driven length divided by the path length [-], or None for a path shorter than STEP_M."""
        return self.driven / self.length if self.length >= STEP_M else None

    @property
    def enough(self) -> bool:
        """Whether the driven length is at least ENOUGH times the required length `due`, with a tolerance of STEP_M."""
        return self.driven + STEP_M >= ENOUGH * self.due


def progress_of(route: SampledRoute, duration: float | None, columns: Sequence[Array]) -> PathProgress:
    """Return the driven length of the path up to the end of a run.

    `duration` is the planned duration [s], or None for the duration of the path. `columns` contains time [s] and
    position [m] of the true CG at each tick, shape (n,) each.
    """
    own = route.path.duration_s
    planned = own if duration is None else duration
    walk = _Walk(route, min(planned, own))
    for t, x, y in _places(columns):
        walk.go(t, x, y)
    route.release()
    granted = 0.0 if walk.is_stuck(planned) else LATE_S
    return PathProgress(walk.driven, walk.distance_at(planned), walk.distance_at(planned - granted))


def commanded_progress(t: Array, asked: Array, speed: Array) -> PathProgress:
    """Return the progress of guidance without a path: driven distance, and distance commanded by the speeds `asked`.

    Both distances are integrals of absolute speeds. Times are in s, speeds in m/s, shape (n,) each, NaN if missing.
    """
    t, asked, speed = map(np.nan_to_num, (t, asked, speed))
    steps = np.diff(t, append=t[-1:])
    due = t < t[-1] - LATE_S if len(t) else t
    return PathProgress(*(float(np.sum(np.abs(each) * steps)) for each in (speed, asked, asked * due)))


class _Walk:
    """Tracker of the path point nearest to the tractor, which marks the driven segments up to the time `end` [s]."""

    def __init__(self, route: SampledRoute, end: float) -> None:
        self.route, self.place, self.within, self.last = route, 0, False, route.number_at(end)
        self.pieces = bytearray(self.last)
        """Marks of the segments between samples of the route: 1 for a driven segment, otherwise 0."""
        self.t = self.driven_t = 0.0
        """Time of the last position, and time at which the last driven segment began [s]."""

    def go(self, t: float, x: float, y: float) -> None:
        """Process the next position (x, y) [m] of the tractor at the time `t` [s]."""
        before = self.route.distances[self.place]
        k, apart = self._nearest(t, x, y, before)
        if apart > ASTRAY_M:
            other, beside = self._nearest(t, x, y, self.distance_at(t))
            k, apart = (other, beside) if beside < apart else (k, apart)
        within = apart <= CORRIDOR_M
        if within and self.within and k > self.place and self.route.distances[k] - before <= LEAP_M:
            self.pieces[self.place : k] = b"\1" * (k - self.place)
            self.driven_t = self.t
        self.t, self.place, self.within = t, k, within

    def _nearest(self, t: float, x: float, y: float, near: float) -> tuple[int, float]:
        """Return index and distance [m] of the sample nearest to (x, y) [m], searched near the arc length `near` [m].
        If this sample is less than `STEP_M` before the last sample, the last sample is returned."""
        k, _ = self.route.search(x, y, near, t)
        if self.route.distances[k] > self.route.distances[self.last] - STEP_M:
            k = self.last
        sample = self.route.sample(k)
        return k, hypot(x - sample.x, y - sample.y)

    def distance_at(self, t: float) -> float:
        """Return the path length [m] covered by the reference at the time `t` [s], at most the evaluated length."""
        k = min(self.route.number_at(t), self.last)
        return float(self.route.distances[k])

    def is_stuck(self, end: float) -> bool:
        """Return whether the tractor made no more progress, while the reference continued until `end` [s]."""
        waited = self.t - self.driven_t
        return waited > LATE_S and self.distance_at(end) - self.distance_at(self.driven_t) > 2 * STEP_M

    @property
    def driven(self) -> float:
        """Total length of the driven segments [m]."""
        return float(np.diff(self.route.distances[: self.last + 1]) @ np.frombuffer(self.pieces, dtype=np.uint8))


def _places(columns: Sequence[Array]) -> Iterator[list[float]]:
    """Yield time [s] and position [m] of the true CG, about every STEP_M of driven distance and at the end."""
    way, end, told = -STEP_M, np.empty((0, 3)), True
    for first in range(0, len(columns[0]), PIECE):  # in blocks, because the rows of a day need 100 MB
        rows: Array = np.column_stack([column[first : first + PIECE] for column in columns])
        rows = rows[(np.abs(rows) < FARTHEST_M).all(axis=1)]
        if len(rows):
            steps = np.diff(np.concatenate([end if len(end) else rows[:1], rows])[:, 1:], axis=0)
            ways = max(way, 0.0) + np.cumsum(np.hypot(*steps.T))
            kept = np.diff(np.floor(ways / STEP_M), prepend=np.floor(way / STEP_M)) > 0
            yield from rows[kept].tolist()
            way, end, told = float(ways[-1]), rows[-1:], bool(kept[-1])
    if not told:
        yield from end.tolist()
