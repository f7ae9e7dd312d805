"""Position of a point relative to a path: signed offset, and time at which the reference passes the nearest path point.

The search covers WINDOW_M before and after the nearest point of the previous row, so that the tractor may be far behind
the reference. In the first row, and after the nearest point was lost, the search is centred at the reference. Only the
leg of the path (between two cusps) at the current time is searched (see `paths.route`). Left is relative to the heading
of the path.
"""

from math import inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import stage
from agrobot_mj.core.samples import CURVATURE, S, T, X, found_nearest, offset_at
from agrobot_mj.core.signals import Array, Matrix
from agrobot_mj.paths import Path
from agrobot_mj.paths.route import SampledRoute

WINDOW_M = 10.0
"""Search distance before and after the previous nearest point, and maximum offset of a valid nearest point [m]."""
FORGOTTEN_S = 5.0
"""Duration without valid positions after which the previous nearest point is discarded [s]. Assumed value."""
FARTHEST_M = 1e7  # Maximum plausible distance of a position from the origin [m]: a quarter of the equator


class BesidePath(NamedTuple):
    """Positions of n points relative to a path, NaN for points without a finite and plausible position."""

    offset: Array  # Signed distance from the path [m], left positive, shape (n,)
    time: Array  # Time at which the reference passes the nearest path point [s], shape (n,)
    circles: Array
    """Osculating circle of the path near each point, shape (n, 4): x, y [m], heading [rad], curvature [1/m]."""

    def offset_of(self, x: Array, y: Array) -> Array:
        """Return the signed distances [m] of the points (x, y) from `circles`, positive to the left, shape (n,)."""
        x0, y0, yaw, curvature = self.circles.T
        east, north = x - x0, y - y0
        ahead, left = np.cos(yaw) * east + np.sin(yaw) * north, np.cos(yaw) * north - np.sin(yaw) * east
        to_centre = np.hypot(curvature * ahead, 1 - curvature * left)
        found: Array = (2 * left - curvature * (ahead**2 + left**2)) / (1 + to_centre)
        return found


def cross_track(path: Path, t: Array, x: Array, y: Array) -> Array:
    """Return the offset [m] of the points (x, y) [m] from `path` at times `t` [s], positive to the left, shape (n,).

    The offset is NaN for points without a finite and plausible position.
    """
    return track(path, t, x, y).offset


def track(path: Path, t: Array, x: Array, y: Array, route: SampledRoute | None = None) -> BesidePath:
    """Return the positions of the points (x, y) [m] relative to `path` at the times `t` [s], all of shape (n,)."""
    route, found = route or SampledRoute(path), np.full((len(t), 6), np.nan)
    known = np.maximum(np.abs(x), np.abs(y)) < FARTHEST_M
    places = np.column_stack((t, x, y))[known]
    near = found if len(places) == len(found) else np.empty((len(places), 6))
    row, place, seen, wanted = 0, 0.0, -inf, 0.0
    while row < len(places):
        samples, legs, end = route.sample_until(float(places[-1, 0]), wanted + WINDOW_M)
        row, place, seen, wanted = _track(places, near, row, place, seen, samples, legs, end)
    route.release()
    found[known] = near
    return BesidePath(found[:, 0], found[:, 1], found[:, 2:])


@stage
def _track(
    places: Matrix, found: Matrix, row: int, place: float, seen: float, samples: Matrix, legs: Matrix, end: float
) -> tuple[int, float, float, float]:
    """Track the nearest sample from row `row` of `places` (t, x, y) to the last row or the arc length `end` [m].

    `place` [m] is the arc length of the last nearest sample, found at the time `seen` [s]. Fill `found` with offset,
    time and circle. Return the next row, `place`, `seen`, and the arc length [m] at which further samples are needed.
    """
    for i in range(row, len(places)):
        now, east, north = places[i]
        leg = max(int(np.searchsorted(legs[:, 0], now, "right")) - 1, 0)
        low, high = legs[leg, 1], legs[leg + 1, 1] if leg + 1 < len(legs) else inf
        k, offset, inside = 0, inf, False
        if now - seen < FORGOTTEN_S:
            near = min(max(place, low), high)
            if near + WINDOW_M > end:
                return i, place, seen, near
            k, inside = found_nearest(samples, east, north, near, low, high, WINDOW_M)
            offset = offset_at(samples, k, east, north)
        if not inside or abs(offset) > WINDOW_M:
            passed = max(int(np.searchsorted(samples[:, T], now, "right")) - 1, 0)
            near = min(max(samples[passed, S], low), high)
            if near + WINDOW_M > end:
                return i, place, seen, near
            again, _ = found_nearest(samples, east, north, near, low, high, WINDOW_M)
            if abs(offset_at(samples, again, east, north)) <= abs(offset):
                k = again
        place, seen = samples[k, S], now
        found[i, 0], found[i, 1] = offset_at(samples, k, east, north), samples[k, T]
        found[i, 2], found[i, 3], found[i, 4], found[i, 5] = samples[k, X : CURVATURE + 1]
    return len(places), place, seen, place
