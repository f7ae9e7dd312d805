"""Nearest point of a path and the path ahead of it, for the laws and for the metrics of a run.

A path is a function of time. `Route` samples it every STEP_M along its length, as far as the questions reach, and seeks
the nearest point in a window about a place that the caller names (its last one), so that neither the other branch of a
crossing nor the neighbouring swath is ever taken. From the nearest sample on, the path is its osculating circle, which
is exact on lines and arcs. A path that reverses its direction of travel falls into legs; a query stays on the leg of
its time. Sampling only adds to what is known: no question changes a later answer.
"""

from bisect import bisect_right
from collections.abc import Sequence
from math import atan2, cos, hypot, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.kernels import bound, jit
from agrobot_mj.core.signals import Array, PathPoint, Reference
from agrobot_mj.paths.arc import Pose, advance
from agrobot_mj.paths.base import ReferencePath, reference_at

STEP_M = 0.05
"""Spacing of the samples [m]."""
WINDOW_M = 4.0
"""How far from the named place the nearest point is sought, ahead and behind [m]."""
ROUNDING_M = 1e-6
"""How far a leg reaches beyond its ends, for rounding; a sample of the next leg stays outside [m]."""
CHUNK_S = 20.0
"""Time by which the sampled part grows [s]."""
BEND = 1.4
"""Largest turn of the path within the window, ahead and behind: less than a right angle [rad]."""
BEYOND_S = 3600.0
"""Time beyond the path's duration up to which it is sampled for a distance that it may never reach [s]."""

LAP_GRID_M, LEAST_LAP_M = 0.05, 10.0
"""Grid on which headings are compared, and shortest lap [m]."""
ALIKE = 0.01
"""Largest difference of the headings from lap to lap, one less the mean cosine, over that between other places [-].
Assumed value: the way off the field after the last pass counts as different."""
LEAST_TURN = 0.8
"""Turn without which a path has no places to tell apart [rad]. Assumed value: 45 deg."""

T, X, Y, YAW, CURVATURE, SPEED, S, TURNED, DIRECTION = range(9)
"""Columns of the samples, as in `Sample`."""


class Sample(NamedTuple):
    """A sampled point of a path."""

    t: float
    """Time at which the reference passes [s]."""
    x: float
    """East [m]."""
    y: float
    """North [m]."""
    yaw: float
    """Heading of a tractor on the path there [rad]."""
    curvature: float
    """Left positive [1/m]."""
    speed: float
    """Speed along the heading, negative in reverse [m/s]."""
    s: float = 0.0
    """Distance along the path from its start [m]."""
    turned: float = 0.0
    """Sum of the turns of the path, either way, from its start [rad]."""
    direction: float = 0.0
    """Direction of travel: 1 forward, -1 in reverse, 0 unknown [-]."""

    def offset(self, x: float, y: float) -> float:
        """Signed distance of (x, y) [m] from the osculating circle, left positive [m]."""
        ahead, left = to_heading(self.yaw, x - self.x, y - self.y)
        to_centre = hypot(self.curvature * ahead, 1 - self.curvature * left)
        return (2 * left - self.curvature * (ahead**2 + left**2)) / (1 + to_centre)


@jit
def _search(
    samples: Array, x: float, y: float, near: float, low: float, high: float, window: float
) -> tuple[int, bool]:
    """Number of the sample nearest to (x, y), and whether it lies between others of those that are looked at.

    These are within `window` and a turn of BEND about the distance `near`, from `low` to `high`, the ends of the leg.
    """
    s, turned = samples[:, S], samples[:, TURNED]
    middle = min(int(np.searchsorted(s, near)), len(s) - 1)
    first = max(
        int(np.searchsorted(s, max(near - window, low - ROUNDING_M))),
        int(np.searchsorted(turned, turned[middle] - BEND - 1e-9)),
    )
    last = min(
        int(np.searchsorted(s, min(near + window, high + ROUNDING_M), "right")),
        int(np.searchsorted(turned, turned[middle] + BEND + 1e-9, "right")),
    )
    some = samples[first : max(last, first + 1)]
    k = first + int(np.argmin((some[:, X] - x) ** 2 + (some[:, Y] - y) ** 2))
    return k, first < k < last - 1


class SampledRoute:
    """A path with a memory of its samples."""

    def __init__(self, path: ReferencePath) -> None:
        self.path = path
        self._samples = self._room = np.array([_sample(0.0, reference_at(path, 0.0))])
        self._until = 0.0
        self._search = bound(_search, self._samples, *(0.0,) * 6)
        self._leg_times, self._leg_starts, self._sign = [0.0], [0.0], 0.0
        self._lap: float | None = None

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s]."""
        return reference_at(self.path, t)

    def leg(self, t: float) -> tuple[float, float]:
        """Distances [m] between which the reference keeps its direction of travel at time `t` [s]."""
        self._grow(until=t + CHUNK_S)
        k = max(bisect_right(self._leg_times, t) - 1, 0)
        ends = (*self._leg_starts[1:], np.inf)
        return self._leg_starts[k], float(ends[k])

    def nearest(self, x: float, y: float, near: float, t: float) -> PathPoint:
        """The path's nearest point to (x, y) [m], sought about the distance `near` [m] on the leg of time `t` [s]."""
        return self._beside(*self.search(x, y, near, t), x, y)

    def search(self, x: float, y: float, near: float, t: float, window: float = WINDOW_M) -> tuple[int, bool]:
        """Number of the sample nearest to (x, y) [m], and whether it lies between others of those that were looked at.

        These are within `window` [m] ahead of and behind the distance `near` [m], on the leg of time `t` [s].
        """
        low, high = self.leg(t)
        near = min(max(near, low), high)
        self._grow(beyond=near + window)
        found: tuple[int, bool] = self._search(self._samples, x, y, near, low, high, window)
        return found

    def number_at(self, t: float) -> int:
        """Number of the last sample that the reference has passed at `t` [s]."""
        self._grow(until=t)
        return max(int(np.searchsorted(self._samples[:, T], t, "right")) - 1, 0)

    def passed(self, t: float) -> float:
        """Distance that the reference has passed at time `t` [s], to a sample [m]."""
        k = self.number_at(t)
        return float(self.distances[k])

    def lap(self) -> float:
        """Distance after which the path's heading comes again, its whole length where it does not [m]."""
        if self._lap is None:
            self._grow(until=self.path.duration_s)
            known = self._samples[: max(self.number_at(self.path.duration_s) + 1, 2)]
            self._lap = lap_length(known[:, S], known[:, YAW])
        return self._lap

    @property
    def distances(self) -> Array:
        """Distance of each sample along the path, as far as it is sampled, shape (n,) [m]."""
        return self._samples[:, S]

    def sample(self, k: int) -> "Sample":
        """Sample `k`."""
        return Sample(*self._samples[k].tolist())

    def ahead(self, s: float) -> PathPoint:
        """The path at the distance `s` [m] from its start; straight on beyond its ends."""
        self._grow(beyond=s + STEP_M)
        k = max(int(np.searchsorted(self.distances, s + 1e-12, "right")) - 1, 0)
        sample = self.sample(k)
        return _along(sample, s - sample.s, 0.0, k == 0)

    def curvatures(self, ways: Sequence[float]) -> Array:
        """Curvatures at the distances `ways` from its start [m], left positive, shape (n,) [1/m]; 0 before it."""
        self._grow(beyond=max(ways) + STEP_M)
        s = np.array(ways)
        k = np.maximum(np.searchsorted(self.distances, s + 1e-12, "right") - 1, 0)
        return np.where(s < 0.0, 0.0, self._samples[k, CURVATURE])

    def _beside(self, k: int, inside: bool, x: float, y: float) -> PathPoint:
        """The nearest point from sample `k` on; beyond STEP_M from it only at an end of the window."""
        sample = self.sample(k)
        curvature, limit = sample.curvature, STEP_M if inside else WINDOW_M
        ahead, left = to_heading(sample.yaw, x - sample.x, y - sample.y)
        angle = atan2(curvature * ahead, 1 - curvature * left)
        way = min(max(angle / curvature if abs(curvature) > 1e-9 else ahead, -limit), limit)
        return _along(sample, -way if sample.direction < 0 else way, sample.offset(x, y), k == 0)

    def _grow(self, until: float = CHUNK_S, beyond: float = -np.inf) -> None:
        """Sample the path at least until a time [s] and beyond a distance [m]."""
        # the duration last: that of a path of many laps takes a while, and most calls need none
        while self._until < until or (self._samples[-1, S] < beyond and self._until < self.path.duration_s + BEYOND_S):
            count = max(int(CHUNK_S * self.path.speed_m_s / STEP_M), 4)
            times = self._until + CHUNK_S * np.arange(1, count + 1) / count
            self._until = float(times[-1])
            self._append(np.array([_sample(t, reference_at(self.path, t)) for t in times.tolist()]))

    def _append(self, new: Array) -> None:
        """Add samples (n, 9) that are a step apart, and note where the direction of travel changes."""
        known = self._samples[-1:]
        joined = np.concatenate([known, new])
        way = known[0, S] + np.cumsum(np.hypot(np.diff(joined[:, X]), np.diff(joined[:, Y])))
        signs = np.sign(np.where(np.abs(new[:, SPEED]) > 1e-9, new[:, SPEED], 0.0))
        reverses = np.zeros(len(new), dtype=bool)
        for k, sign in enumerate(signs.tolist()):
            if sign and self._sign and sign != self._sign:
                reverses[k] = True
                self._leg_times.append(float(new[k, T]))
                self._leg_starts.append(float(way[max(k - 1, 0)]))
            self._sign = sign or self._sign
            new[k, DIRECTION] = self._sign
            if not self._samples[0, DIRECTION]:  # at rest: the direction in which it will set off
                self._samples[0, DIRECTION] = self._sign
        new[:, S] = way
        marks = np.floor(np.concatenate([known[:, S], way]) / (0.99 * STEP_M))
        kept = new[(np.diff(marks) > 0) | reverses]
        if len(kept):
            turns = np.angle(np.exp(1j * np.diff(np.concatenate([known[:, YAW], kept[:, YAW]]))))
            kept[:, TURNED] = known[0, TURNED] + np.cumsum(np.abs(turns))
            self._keep(kept)

    def _keep(self, new: Array) -> None:
        """Add samples; the room for them doubles, so that a day's path is not copied thousands of times."""
        count, end = len(self._samples), len(self._samples) + len(new)
        if end > len(self._room):
            self._room = np.empty((2 * end, len(Sample._fields)))  # takes memory only where it is written to
            self._room[:count] = self._samples
        self._room[count:end] = new
        self._samples = self._room[:end]


def lap_length(s: Array, yaw: Array) -> float:
    """Least distance [m] after which the headings `yaw` [rad] at the distances `s` [m], each of shape (n,), come again.

    The last distance where they do not over half a lap, or where the path has no bends. Laps may lie beside each other:
    two passes of a field and their turns are one.
    """
    length = float(s[-1])
    count = int(length / LAP_GRID_M)
    turned = np.unwrap(yaw)
    if count < 2 * LEAST_LAP_M / LAP_GRID_M or np.ptp(turned) < LEAST_TURN:
        return length
    headings = np.exp(1j * np.interp(LAP_GRID_M * np.arange(count), s, turned))
    padded = np.fft.fft(headings, 2 * count)
    lags = np.arange(1, 2 * count // 3)
    unlike = 1.0 - np.fft.ifft(np.abs(padded) ** 2)[lags].real / (count - lags)
    alike = unlike < ALIKE * unlike.max()
    left = np.maximum.accumulate(~alike)  # what is alike from the beginning is a gentle bend
    again = np.flatnonzero(left & alike & (lags * LAP_GRID_M >= LEAST_LAP_M))
    if not len(again):
        return length
    first = again[: int(np.argmax(np.diff(again, append=again[-1] + 2) > 1)) + 1]
    return float(lags[first[np.argmin(unlike[first])]]) * LAP_GRID_M


def _sample(t: float, r: Reference) -> Sample:
    return Sample(t, r.x, r.y, r.yaw, r.curvature, cos(r.yaw) * r.vx + sin(r.yaw) * r.vy)


def _along(sample: Sample, ds: float, offset: float, first: bool) -> PathPoint:
    """The path at the distance `ds` [m] from a sample, of which that of the start is the `first`."""
    t, x, y, yaw, curvature, speed, s, _, direction = sample
    if s + ds < 0.0 and first:
        curvature = 0.0  # straight on before the start
    pose = advance(Pose(x, y, yaw), curvature, -ds if direction < 0 else ds)
    t += ds / abs(speed) if abs(speed) > 1e-6 else 0.0
    return PathPoint(
        s + ds, t, pose.x, pose.y, wrap(pose.yaw), curvature, speed, offset, -1.0 if direction < 0 else 1.0
    )
