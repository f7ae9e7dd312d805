"""Position of a point relative to a path: signed offset, and time at which the reference passes the nearest point.

The search covers WINDOW_M before and after the nearest point of the previous row, so that the tractor may be far behind
the reference. For the first row, and after the nearest point was lost, the search starts at the reference. Only the leg
(between two cusps) of the current time is searched, see `paths.route`. Left is relative to the heading of the path.
"""

from math import inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths import Path
from agrobot_mj.paths.route import SampledRoute

WINDOW_M = 10.0
"""Search distance before and after the previous nearest point, and offset above which the point is lost [m]."""
FORGOTTEN_S = 5.0
"""Duration of missing positions after which the previous nearest point is discarded [s]. Assumed value."""
FARTHEST_M = 1e7  # Maximum plausible distance of a position from the origin [m]: a quarter of the equator


class BesidePath(NamedTuple):
    """Positions relative to a path: arrays of n rows, NaN for points that are not finite."""

    offset: Array  # Signed distance from the path [m], left positive, shape (n,)
    time: Array  # Time at which the reference passes the nearest point [s], shape (n,)
    circles: Array
    """Osculating circle of the path near each point, shape (n, 4): x, y [m], heading [rad], curvature [1/m]."""

    def offset_of(self, x: Array, y: Array) -> Array:
        """Return the signed offset of the points (x, y) from the circles, left positive, shape (n,) [m]."""
        x0, y0, yaw, curvature = self.circles.T
        east, north = x - x0, y - y0
        ahead, left = np.cos(yaw) * east + np.sin(yaw) * north, np.cos(yaw) * north - np.sin(yaw) * east
        to_centre = np.hypot(curvature * ahead, 1 - curvature * left)
        found: Array = (2 * left - curvature * (ahead**2 + left**2)) / (1 + to_centre)
        return found


def cross_track(path: Path, t: Array, x: Array, y: Array) -> Array:
    """Return the signed offset [m] of the points (x, y) from `path` at times `t`, left positive, shape as `t`, with NaN
    for positions that are not finite."""
    return track(path, t, x, y).offset


def track(path: Path, t: Array, x: Array, y: Array, route: SampledRoute | None = None) -> BesidePath:
    """Return the positions of the points (x, y) [m] relative to `path` at the times `t` [s], each of shape (n,)."""
    route, found = route or SampledRoute(path), np.full((len(t), 6), np.nan)
    beside = BesidePath(found[:, 0], found[:, 1], found[:, 2:])
    place, seen = 0.0, -inf
    for row in map(int, np.flatnonzero(np.maximum(np.abs(x), np.abs(y)) < FARTHEST_M)):
        now, east, north = float(t[row]), float(x[row]), float(y[row])
        offset, inside = inf, False
        if now - seen < FORGOTTEN_S:
            k, inside = route.search(east, north, place, now, WINDOW_M)
            offset = route.sample(k).offset(east, north)
        if not inside or abs(offset) > WINDOW_M:
            again, _ = route.search(east, north, route.passed(now), now, WINDOW_M)
            if abs(route.sample(again).offset(east, north)) <= abs(offset):
                k = again
        sample = route.sample(k)
        place, seen, beside.offset[row], beside.time[row] = sample.s, now, sample.offset(east, north), sample.t
        beside.circles[row] = sample.x, sample.y, sample.yaw, sample.curvature
    return beside
