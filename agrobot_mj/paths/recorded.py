"""Smoothing spline through waypoints, and its smoothing for a recorded track with the noise of a receiver."""

import warnings

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.track import Course, samples, through

DENSE_M, FEWEST_POINTS = 1.0, 20
"""Maximum median distance between the points of a recorded track [m], and minimum number of points."""
TIGHTEST = 0.4
"""Radius of the tightest bend of a recorded track, divided by that of a corner [-]. Assumed value: near full lock."""
WIDER, LEAST_M, MOST_M = 1.3, 0.005, 1.0
"""Factor from one trial of the smoothing to the next [-], and minimum and maximum smoothing [m]."""
THIRD_DIFFERENCE = 20.0 * np.log(2.0)
"""Median squared third difference of positions with white noise, divided by their mean square noise [-]."""


def smooth(points: Array, smoothing: float, closed: bool) -> Course:
    """Return one lap along the spline through `points`, shape (n, 2 or 3)."""
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


def is_recorded(points: Array) -> bool:
    """Return whether waypoints, shape (n, 2 or 3), are as close as those of a recorded track."""
    if len(points) < FEWEST_POINTS:
        return False
    return float(np.median(np.hypot(*np.diff(points[:, :2], axis=0).T))) < DENSE_M


def noise(points: Array) -> float:
    """Return the root mean square position noise of a recorded track, shape (n, 2 or 3) [m]."""
    third = np.diff(points[:, :2], n=3, axis=0)
    return float(np.sqrt(np.median((third**2).sum(axis=1)) / THIRD_DIFFERENCE))


def steerable(points: Array, closed: bool, radius: float) -> tuple[Course, float]:
    """Return the spline with the least smoothing at which a recorded track can be driven, and that smoothing [m].

    The smoothing is at least the noise of the track. A track can be driven if its bends have a radius of at least
    TIGHTEST times `radius` [m].
    """
    amount = max(noise(points), LEAST_M)
    found = smooth(points, amount, closed), amount
    while found[0].peaks.max() > 1 / (TIGHTEST * radius) and amount < MOST_M:
        amount *= WIDER
        found = smooth(points, amount, closed), amount
    return found
