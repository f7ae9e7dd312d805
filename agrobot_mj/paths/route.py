"""Where a point is beside a path, asked online: the nearest point, and what lies ahead.

A path is a function of time. `Route` samples it every STEP_M along its length, as far as the questions reach, and seeks
the nearest point in a window about a place that the caller names (its last one), so that neither the other branch of a
crossing nor the neighbouring swath is ever taken. From the nearest sample on, the path is its osculating circle, which
is exact on lines and arcs. A path that reverses its direction of travel falls into legs; a query stays on the leg of
its time. Sampling only adds to what is known: no question changes a later answer.
"""

from bisect import bisect_right
from math import atan2, cos, hypot, sin

import numpy as np

from agrobot_mj.core.geometry import to_heading, wrap
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
"""Time beyond the path's duration after which nothing new is sampled [s]."""

T, X, Y, YAW, CURVATURE, SPEED, S, TURNED, DIRECTION = range(9)
"""Columns of the samples; the speed is along the heading, negative in reverse; the direction 1 or -1, 0 unknown."""


class SampledRoute:
    """A path with a memory of its samples."""

    def __init__(self, path: ReferencePath) -> None:
        self.path = path
        self._samples = np.array([_sample(0.0, reference_at(path, 0.0))])
        self._until = 0.0
        self._leg_times, self._leg_starts, self._sign = [0.0], [0.0], 0.0

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
        low, high = self.leg(t)
        near = min(max(near, low), high)
        self._grow(beyond=near + WINDOW_M)
        s, turned = self._samples[:, S], self._samples[:, TURNED]
        middle = min(int(np.searchsorted(s, near)), len(s) - 1)
        first = max(
            int(np.searchsorted(s, max(near - WINDOW_M, low - ROUNDING_M))),
            int(np.searchsorted(turned, turned[middle] - BEND - 1e-9)),
        )
        last = min(
            int(np.searchsorted(s, min(near + WINDOW_M, high + ROUNDING_M), "right")),
            int(np.searchsorted(turned, turned[middle] + BEND + 1e-9, "right")),
        )
        window = self._samples[first : max(last, first + 1)]
        k = first + int(np.argmin((window[:, X] - x) ** 2 + (window[:, Y] - y) ** 2))
        return self._beside(k, x, y, first < k < last - 1)

    def ahead(self, s: float) -> PathPoint:
        """The path at the distance `s` [m] from its start; straight on beyond its ends."""
        self._grow(beyond=s + STEP_M)
        samples = self._samples
        k = min(int(np.searchsorted(samples[:, S], s + 1e-12, "right")) - 1, len(samples) - 1)
        return self._along(max(k, 0), s - float(samples[max(k, 0), S]), 0.0)

    def _beside(self, k: int, x: float, y: float, inside: bool) -> PathPoint:
        """The nearest point from sample `k` on; beyond STEP_M from it only at an end of the window."""
        _, x_k, y_k, yaw, curvature, _, _, _, direction = self._samples[k].tolist()
        ahead, left = to_heading(yaw, x - x_k, y - y_k)
        angle = atan2(curvature * ahead, 1 - curvature * left)
        way = angle / curvature if abs(curvature) > 1e-9 else ahead
        limit = STEP_M if inside else WINDOW_M
        to_centre = hypot(curvature * ahead, 1 - curvature * left)
        offset = (2 * left - curvature * (ahead**2 + left**2)) / (1 + to_centre)
        way = min(max(way, -limit), limit)
        return self._along(k, -way if direction < 0 else way, offset)

    def _along(self, k: int, ds: float, offset: float) -> PathPoint:
        t, x, y, yaw, curvature, speed, s, _, direction = self._samples[k].tolist()
        if s + ds < 0.0 and k == 0:
            curvature = 0.0  # straight on before the start
        pose = advance(Pose(x, y, yaw), curvature, -ds if direction < 0 else ds)
        t += ds / abs(speed) if abs(speed) > 1e-6 else 0.0
        return PathPoint(
            s + ds, t, pose.x, pose.y, wrap(pose.yaw), curvature, speed, offset, -1.0 if direction < 0 else 1.0
        )

    def _grow(self, until: float = CHUNK_S, beyond: float = -np.inf) -> None:
        """Sample the path at least until a time [s] and beyond a distance [m]."""
        end = self.path.duration_s + BEYOND_S
        while self._until < end and (self._until < until or self._samples[-1, S] < beyond):
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
            self._samples = np.concatenate([self._samples, kept])


def _sample(t: float, r: Reference) -> tuple[float, ...]:
    return t, r.x, r.y, r.yaw, r.curvature, cos(r.yaw) * r.vx + sin(r.yaw) * r.vy, 0.0, 0.0, 0.0
