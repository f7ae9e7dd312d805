"""Nearest point of a path, and points and curvatures of the path at given distances, for guidance laws and metrics.

A path is a function of time. `SampledRoute` samples the path every STEP_M along its length, as far as queries require.
The nearest point is searched for in a window around a given arc length, usually the previous result. The search thus
never switches to another branch of a crossing or to an adjacent swath. Between samples the path is approximated by its
osculating circle, which is exact on lines and arcs. Cusps divide a path into legs; a query is restricted to the leg of
the reference at the time of the query. Later sampling does not change the result of a query.
"""

from bisect import bisect_right
from collections.abc import Sequence
from math import inf
from typing import cast

import numpy as np

from agrobot_mj.core.errors import NotFiniteError
from agrobot_mj.core.kernels import stage
from agrobot_mj.core.long_array import LongArray
from agrobot_mj.core.samples import (
    DIRECTION,
    SPEED,
    STEP_M,
    TURNED,
    WIDTH,
    WINDOW_M,
    YAW,
    S,
    Sample,
    T,
    X,
    Y,
    curvatures_at,
    found_nearest,
    nearest_point,
    point_at,
    sample_of,
    samples_at,
)
from agrobot_mj.core.signals import Array, Matrix, PathPoint, Reference, Vector
from agrobot_mj.paths.base import ReferencePath, reference_at

CHUNK_S = 20.0  # Time interval by which the sampled path is extended [s]
BEYOND_S = 3600.0  # Time after the end of the path up to which samples are added to reach a required arc length [s]
LATEST_S = 48 * 3600.0  # Time up to which every path can be sampled [s]: twice the maximum duration of a run

LAP_GRID_M, MIN_LAP_M = 0.05, 10.0  # Grid spacing for comparing headings, and minimum lap length [m]
MAX_DIFFERENCE = 0.01
"""Maximum heading difference of two laps (1 minus the mean cosine), divided by the maximum over all lap lengths [-].
Assumed value, which excludes the exit from the field after the last pass."""
MIN_TURN = 0.8  # Minimum heading change of a path with laps [rad]. Assumed value (45 deg).

_samples_at, _search, _nearest, _ahead, _curvatures = (
    stage(samples_at),
    stage(found_nearest),
    stage(nearest_point),
    stage(point_at),
    stage(curvatures_at),
)


class SampledRoute:
    """Reference path with cached samples, for fast queries by arc length or position."""

    def __init__(self, path: ReferencePath) -> None:
        self.path = path
        self._samples = np.array([sample_of(0.0, reference_at(path, 0.0))])
        self._buffer: LongArray | None = None
        self._until = self._end = 0.0
        self._leg_times, self._leg_starts, self._sign = [0.0], [0.0], 0.0
        self._lap: float | None = None

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s]."""
        return reference_at(self.path, t)

    def leg(self, t: float) -> tuple[float, float]:
        """Return the arc lengths [m] at both ends of the leg, between two cusps, on which the reference travels at time
        `t` [s]. The end is infinity if no later cusp is known."""
        if not self._until >= t + CHUNK_S:
            self._grow(until=t + CHUNK_S)
        k = max(bisect_right(self._leg_times, t) - 1, 0)
        return self._leg_starts[k], self._leg_starts[k + 1] if k + 1 < len(self._leg_starts) else inf

    def nearest(self, x: float, y: float, near: float, t: float) -> PathPoint:
        """Return the path point nearest to (x, y) [m], within a search range around the arc length `near` [m] on the
        leg that the reference travels at time `t` [s]."""
        low, high = self.leg(t)
        return _nearest(self.around(max(near, low)), x, y, near, low, high)

    def around(self, near: float) -> Matrix:
        """Sample the path to the end of the search window around the arc length `near` [m] and return all samples."""
        if not self._end >= near + WINDOW_M:
            self._grow(beyond=near + WINDOW_M)
        return self._samples

    def sample_until(self, t: float, s: float) -> tuple[Matrix, Matrix, float]:
        """Sample the path up to time `t` [s] and arc length `s` [m], and return the samples, the legs and the sampled
        length.

        The legs are an array of their start times [s] and start arc lengths [m] with shape (legs, 2). The sampled
        length is the arc length of the last sample [m], or infinity if the path ends before `s`.
        """
        self._grow(until=t + CHUNK_S, beyond=s)
        legs = np.column_stack((self._leg_times, self._leg_starts))
        return self._samples, legs, self._end if self._end >= s else inf

    def grows(self, s: float) -> bool:
        """Sample the path up to the arc length `s` [m]; return whether samples were added."""
        return self._end < s + STEP_M and self._grow(beyond=s + STEP_M)

    def search(self, x: float, y: float, near: float, t: float) -> tuple[int, bool]:
        """Return the index of the path sample nearest to (x, y) [m], searched around the arc length `near` [m], and
        whether the sample is between the ends of the search range."""
        low, high = self.leg(t)
        near = min(max(near, low), high)
        self._grow(beyond=near + WINDOW_M)
        return _search(self._samples, x, y, near, low, high, WINDOW_M)

    def number_at(self, t: float) -> int:
        """Return the index of the last sample that the reference has passed at time `t` [s]."""
        self._grow(until=t)
        return max(int(np.searchsorted(self._samples[:, T], t, "right")) - 1, 0)

    def distance_at(self, t: float) -> float:
        """Return the arc length [m] of the last sample that the reference has passed at time `t` [s]."""
        k = self.number_at(t)
        return float(self.distances[k])

    def lap(self) -> float:
        """Return the distance [m] after which the headings of the path repeat, or the path length without a
        repetition."""
        if self._lap is None:
            self._grow(until=self.path.duration_s)
            known = self._samples[: max(self.number_at(self.path.duration_s) + 1, 2)]
            self._lap = lap_length(known[:, S], known[:, YAW])
        return self._lap

    @property
    def distances(self) -> Array:
        """Arc lengths of all samples [m], shape (n,)."""
        return self._samples[:, S]

    def sample(self, k: int) -> "Sample":
        """Return the sample with the index `k`."""
        return Sample(*self._samples[k].tolist())

    def ahead(self, s: float) -> PathPoint:
        """Return the path point at arc length `s` [m]; the path continues straight beyond its ends."""
        self._grow(beyond=s + STEP_M)
        return _ahead(self._samples, s)

    def curvatures(self, distances: Sequence[float] | Vector) -> Vector:
        """Return the curvatures [1/m] at the arc lengths `distances` [m], shape (n,), positive to the left; 0 for
        negative arc lengths."""
        distances = np.asarray(distances, dtype=float)
        found, most = _curvatures(self._samples, distances)
        if self.grows(most):
            found, _ = _curvatures(self._samples, distances)
        return found

    def _grow(self, until: float = CHUNK_S, beyond: float = -inf) -> bool:
        """Sample the path up to time `until` [s] and arc length `beyond` [m]; return whether samples were added."""
        before = self._until
        if not (until <= LATEST_S and beyond < inf):
            self._require_possible(until, beyond)
        # the duration is last, because it is slow to compute for many laps and rarely needed
        while self._until < until or (self._end < beyond and self._until < self.path.duration_s + BEYOND_S):
            count = max(int(CHUNK_S * self.path.speed_m_s / STEP_M), 4)
            times = self._until + CHUNK_S * np.arange(1, count + 1) / count
            self._append(_samples_at(times, references_at(self.path, times)))
            self._until = float(times[-1])
        return self._until > before

    def _require_possible(self, until: float, beyond: float) -> None:
        """Raise `NotFiniteError` if the path cannot be sampled up to `until` [s] and `beyond` [m]."""
        if not (until <= max(LATEST_S, self.path.duration_s + BEYOND_S) and beyond < inf):
            place = f"the time {until:g} s" if beyond < inf else f"the arc length {beyond:g} m"
            raise NotFiniteError(
                f"the route cannot be sampled up to {place}; use finite numbers in queries of the route"
            )

    def _append(self, new: Array) -> None:
        known = self._samples[-1:]
        joined = np.concatenate([known, new])
        distance = known[0, S] + np.cumsum(np.hypot(np.diff(joined[:, X]), np.diff(joined[:, Y])))
        signs = np.sign(np.where(np.abs(new[:, SPEED]) > 1e-9, new[:, SPEED], 0.0))
        last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(1, len(new) + 1), 0))
        directions = np.concatenate([[self._sign], signs])[last]  # at rest: the direction of the last motion
        before = np.concatenate([[self._sign], directions[:-1]])
        reverses = before * directions < 0.0
        for k in np.flatnonzero(reverses).tolist():
            self._leg_times.append(float(new[k, T]))
            self._leg_starts.append(float(distance[max(k - 1, 0)]))
        moves = np.flatnonzero(directions)
        if len(moves) and not self._samples[0, DIRECTION]:  # at rest: the direction of the first motion
            self._samples[0, DIRECTION] = directions[moves[0]]
        self._sign = float(directions[-1])
        new[:, DIRECTION], new[:, S] = directions, distance
        marks = np.floor(np.concatenate([known[:, S], distance]) / (0.99 * STEP_M))
        kept = new[(np.diff(marks) > 0) | reverses]
        if len(kept):
            turns = np.angle(np.exp(1j * np.diff(np.concatenate([known[:, YAW], kept[:, YAW]]))))
            kept[:, TURNED] = known[0, TURNED] + np.cumsum(np.abs(turns))
            self._keep(kept)

    def _keep(self, new: Array) -> None:
        """Append samples to a buffer, whose capacity doubles when the buffer is full. Samples of long paths are stored
        in a file."""
        count, end = len(self._samples), len(self._samples) + len(new)
        if self._buffer is None or end > len(self._buffer.numbers):
            self._buffer = LongArray(2 * end, (WIDTH,), by_column=False)
            self._buffer.make_room(end)
            self._buffer.numbers[:count] = self._samples
        self._buffer.make_room(end)
        self._buffer.numbers[count:end] = new
        self._samples = self._buffer.numbers[:end]
        self._end = float(new[-1, S])
        self.release()

    def release(self) -> None:
        """Free the memory of samples that are stored in a file."""
        if self._buffer is not None:
            self._buffer.release()


def references_at(path: ReferencePath, times: Vector) -> Matrix:
    """Return the reference states of a path at increasing positive `times` (n,) [s], shape (n, 7), as rows of
    `Reference`.

    If the class that defines `at` also defines `_references_at`, one call computes all times. Other paths, and paths
    with non-finite numbers, are evaluated time by time.
    """
    owner = next(kind for kind in type(path).__mro__ if "at" in vars(kind))
    compiled = vars(owner).get("_references_at")
    if compiled and np.isfinite(found := compiled(path, times)).all():
        return cast(Matrix, np.ascontiguousarray(found, dtype=float))
    return np.array([reference_at(path, t) for t in times.tolist()], dtype=float)


def lap_length(s: Array, yaw: Array) -> float:
    """Return the minimum distance [m] after which the headings of a path repeat.

    `yaw` [rad] are the headings at arc lengths `s` [m], shape (n,). Without bends, or if the headings do not repeat
    within two thirds of the path, the result is the last arc length. Two passes of a field and their turns are one lap.
    """
    length = float(s[-1])
    count = int(length / LAP_GRID_M)
    turned = np.unwrap(yaw)
    if count < 2 * MIN_LAP_M / LAP_GRID_M or np.ptp(turned) < MIN_TURN:
        return length
    headings = np.exp(1j * np.interp(LAP_GRID_M * np.arange(count), s, turned))
    padded = np.fft.fft(headings, 2 * count)
    lags = np.arange(1, 2 * count // 3)
    differences = 1.0 - np.fft.ifft(np.abs(padded) ** 2)[lags].real / (count - lags)
    alike = differences < MAX_DIFFERENCE * differences.max()
    left = np.maximum.accumulate(~alike)  # exclude initial similarity caused by gentle bends
    again = np.flatnonzero(left & alike & (lags * LAP_GRID_M >= MIN_LAP_M))
    if not len(again):
        return length
    first = again[: int(np.argmax(np.diff(again, append=again[-1] + 2) > 1)) + 1]
    return float(lags[first[np.argmin(differences[first])]]) * LAP_GRID_M
