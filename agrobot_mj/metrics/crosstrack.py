"""Position of a point relative to a path, regardless of time: distance, and time at which the reference is closest.

The nearest point is searched in a window of the path around the reference at the same time. The window reaches
WINDOW_M ahead and behind, no farther than the path turns through BEND, and not past a cusp, so that neither the other
branch of a crossing or a cusp nor the neighbouring swath ever enters it. Left is left of the heading, in reverse too.
From the nearest point the distance is that to the path's osculating circle, which is exact on lines and arcs.
"""

from math import radians
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths import Path

STEP_M = 0.05
"""Spacing of the points along the path in which the nearest one is searched [m]."""
WINDOW_M = 10.0
"""Largest distance along the path from the reference at which the nearest point is searched [m]."""
BEND = radians(80.0)
"""Largest angle of a bend within the window ahead, and behind: less than a right angle [rad]."""
PIECE = 24_000
"""Rows that are looked at together: the path beside them is sampled, which for a day would take 1 GB."""
PART = 250
"""Rows whose windows are searched together: 1 MB an array."""

Index = np.ndarray[tuple[int, ...], np.dtype[np.signedinteger]]


class BesidePath(NamedTuple):
    """Points beside a path; both arrays have the shape of the points, NaN where a point is not finite."""

    offset: Array
    """Signed distance from the path, left positive [m]."""
    time: Array
    """Time at which the reference passes the nearest point [s]."""


def cross_track(path: Path, t: Array, x: Array, y: Array) -> Array:
    """Signed distance of the points (x, y) at times `t` from `path`, left positive, shape as `t` [m]; NaN where the
    position is not finite."""
    return track(path, t, x, y).offset


def track(path: Path, t: Array, x: Array, y: Array) -> BesidePath:
    """Position relative to `path` of the points (x, y) [m] at the times `t` [s], each of shape (n,)."""
    offset, time = np.empty(len(t)), np.empty(len(t))
    for first in range(0, len(t), PIECE):
        rows = slice(first, first + PIECE)
        offset[rows], time[rows] = _track(path, t[rows], x[rows], y[rows])
    return BesidePath(offset, time)


def _track(path: Path, t: Array, x: Array, y: Array) -> BesidePath:
    """`track` of a piece."""
    times, points = _spaced(path, t)
    middle = np.clip(np.searchsorted(times, t), 0, len(times) - 1)
    first, last = _windows(points)
    reach = int(WINDOW_M / STEP_M)
    nearest = np.empty(len(t), dtype=int)
    with np.errstate(over="ignore", invalid="ignore"):
        for rows in np.array_split(np.arange(len(t)), len(t) // PART + 1):
            window = middle[rows, None] + np.arange(-reach, reach + 1)
            window = np.clip(window, first[middle[rows], None], last[middle[rows], None])
            distance = (points[window, 0] - x[rows, None]) ** 2 + (points[window, 1] - y[rows, None]) ** 2
            nearest[rows] = window[np.arange(len(rows)), distance.argmin(axis=1)]
        offset = _offset(points[nearest], x, y)
    return BesidePath(offset, np.where(np.isfinite(offset), times[nearest], np.nan))


def _spaced(path: Path, t: Array) -> tuple[Array, Array]:
    """Times (n,) and references (n, 7) at about equal distances along the path, WINDOW_M beyond the ends of `t`."""
    step, room = STEP_M / path.speed_m_s, WINDOW_M / path.speed_m_s
    times = t[0] + step * np.arange(-int(room / step), int((t[-1] - t[0] + room) / step) + 2)
    points = np.fromiter((path.at(time) for time in times.tolist()), dtype=(float, 7), count=len(times))
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))))
    kept = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], 0.99 * STEP_M)))
    return times[kept], points[kept]


def _windows(points: Array) -> tuple[Index, Index]:
    """First and last index of the references within BEND of each reference (n, 7), each of shape (n,)."""
    turned = np.concatenate(([0.0], np.cumsum(np.abs(np.angle(np.exp(1j * np.diff(points[:, 4])))))))
    reverse = points[:, 2] * np.cos(points[:, 4]) + points[:, 3] * np.sin(points[:, 4]) < 0
    turned[1:] += 2 * BEND * np.cumsum(np.diff(reverse.astype(float)) != 0)  # a cusp ends every window
    first = np.searchsorted(turned, turned - BEND - 1e-9)
    last = np.searchsorted(turned, turned + BEND + 1e-9, "right") - 1
    return first, last


def _offset(references: Array, x: Array, y: Array) -> Array:
    """Signed distance of each (x, y) from the circle along its reference, left positive [m]."""
    x_r, y_r, _, _, yaw, curvature, _ = references.T
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, left = c * (x - x_r) + s * (y - y_r), -s * (x - x_r) + c * (y - y_r)
    to_centre = np.hypot(curvature * ahead, 1 - curvature * left)
    offset: Array = (2 * left - curvature * (ahead**2 + left**2)) / (1 + to_centre)
    return np.where(np.isfinite(offset), offset, np.nan)
