"""Compiled functions for a sampled path: nearest path point, and path points and curvatures at given arc lengths."""

from math import atan2, cos, sin, sqrt
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import along_arc, to_heading, wrap
from agrobot_mj.core.kernels import jit, shared
from agrobot_mj.core.signals import Matrix, PathPoint, Reference, Vector

STEP_M = 0.05  # Spacing of the samples [m]
WINDOW_M = 4.0  # Half-width of the search window around the given arc length [m]
ROUNDING_M = 1e-6  # Extension of the search range at both ends for rounding errors, less than the sample spacing [m]
BEND = 1.4
"""Maximum heading change of the path from the middle of the search window to either end [rad]. Must be below pi / 2."""
WIDTH = 9  # Number of columns of the sample array
T, X, Y, YAW, CURVATURE, SPEED, S, TURNED, DIRECTION = range(
    WIDTH
)  # Column numbers of the sample array, as in `Sample`


class Sample(NamedTuple):
    """Sampled point of a path, with the motion of the reference at this point."""

    t: float  # Time at which the reference motion passes the point [s]
    x: float  # East coordinate [m]
    y: float  # North coordinate [m]
    yaw: float  # Heading of a tractor on the path at this point [rad]
    curvature: float  # Curvature [1/m], positive left
    speed: float  # Speed along the heading [m/s], negative in reverse
    s: float = 0.0  # Arc length from the start [m]
    turned: float = 0.0  # Accumulated absolute heading change from the start [rad]
    direction: float = 0.0  # Direction of travel: 1 forward, -1 reverse, 0 unknown [-]


@shared
def sample_of(t: float, r: Reference) -> Sample:
    """Return the sample of the reference `r` at time `t` [s], with zero arc length, heading change and direction."""
    return Sample(t, r.x, r.y, r.yaw, r.curvature, cos(r.yaw) * r.vx + sin(r.yaw) * r.vy, 0.0, 0.0, 0.0)


@shared
def write_reference(references: Matrix, n: int, r: Reference) -> None:
    """Write the fields of the reference `r` to row `n` of the matrix `references`."""
    for k, value in enumerate(r):
        references[n, k] = value


@shared
def reference_in(references: Matrix, n: int) -> Reference:
    """Return row `n` of a matrix of references, shape (n, 7), as a `Reference`."""
    r = references[n]
    return Reference(r[0], r[1], r[2], r[3], r[4], r[5], r[6])


@jit
def samples_at(times: Vector, references: Matrix) -> Matrix:
    """Return samples of the references (n, 7) at `times` (n,) [s], with zero arc length, heading change and
    direction."""
    samples = np.zeros((times.size, WIDTH))
    for n in range(times.size):
        for k, value in enumerate(sample_of(times[n], reference_in(references, n))):
            samples[n, k] = value
    return samples


@shared
def _offset(a: Sample, x: float, y: float) -> float:
    """Return the signed distance [m] of (x, y) [m] from the osculating circle at a sample, positive to the left."""
    ahead, left = to_heading(a.yaw, x - a.x, y - a.y)
    along, across = a.curvature * ahead, 1 - a.curvature * left
    return (2 * left - a.curvature * (ahead * ahead + left * left)) / (1 + sqrt(along * along + across * across))


@jit
def found_nearest(
    samples: Matrix, x: float, y: float, near: float, low: float, high: float, window: float
) -> tuple[int, bool]:
    """Return the index of the sample nearest to (x, y) [m], and whether this sample is between the ends of the search
    range.

    The search range is centred at the arc length `near` [m] and limited to the path from `low` to `high` [m]. On both
    sides it extends by `window` [m], but at most by a heading change of BEND.
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


@jit
def offset_at(samples: Matrix, k: int, x: float, y: float) -> float:
    """Return the signed distance [m] of (x, y) [m] from the osculating circle of sample `k`, positive to the left."""
    return _offset(_sample_at(samples, k), x, y)


@jit
def nearest_point(samples: Matrix, x: float, y: float, near: float, low: float, high: float) -> PathPoint:
    """Return the path point nearest to (x, y) [m], searched near the arc length `near` and between `low` and `high`
    [m]."""
    near = min(max(near, low), high)
    k, inside = found_nearest(samples, x, y, near, low, high, WINDOW_M)
    a = _sample_at(samples, k)
    limit = STEP_M if inside else WINDOW_M
    ahead, left = to_heading(a.yaw, x - a.x, y - a.y)
    angle = atan2(a.curvature * ahead, 1 - a.curvature * left)
    distance = min(max(angle / a.curvature if abs(a.curvature) > 1e-9 else ahead, -limit), limit)
    return _along(a, -distance if a.direction < 0 else distance, _offset(a, x, y), k == 0)


@jit
def point_at(samples: Matrix, s: float) -> PathPoint:
    """Return the path point at arc length `s` [m]. Before the first sample the path is extended by a straight line."""
    k = max(int(np.searchsorted(samples[:, S], s + 1e-12, "right")) - 1, 0)
    a = _sample_at(samples, k)
    return _along(a, s - a.s, 0.0, k == 0)


@jit
def curvatures_at(samples: Matrix, distances: Vector) -> tuple[Vector, float]:
    """Return the path curvature [1/m] at each of the arc lengths `distances` [m], and the maximum of `distances`.

    Each value is the curvature of the last sample at or before the arc length, or 0 before the start of the path.
    """
    found, last, most = np.zeros(distances.size), samples.shape[0] - 1, -np.inf
    for i in range(distances.size):
        most = max(most, distances[i])
        if distances[i] >= 0.0:
            low, high = 0, last  # index of the sample is between these
            while low < high:
                middle = (low + high + 1) // 2
                if samples[middle, S] <= distances[i] + 1e-12:
                    low = middle
                else:
                    high = middle - 1
            found[i] = samples[low, CURVATURE]
    return found, most


@jit
def _sample_at(samples: Matrix, k: int) -> Sample:
    a = samples[k]
    return Sample(a[T], a[X], a[Y], a[YAW], a[CURVATURE], a[SPEED], a[S], a[TURNED], a[DIRECTION])


@jit
def _along(a: Sample, ds: float, offset: float, first: bool) -> PathPoint:
    """Return the path point at the distance `ds` [m] after a sample; `first` is true for the first sample of the
    path."""
    curvature = 0.0 if a.s + ds < 0.0 and first else a.curvature  # straight before the start
    direction = -1.0 if a.direction < 0 else 1.0
    x, y, yaw = along_arc((a.x, a.y, a.yaw), curvature, direction * ds)
    t = a.t + (ds / abs(a.speed) if abs(a.speed) > 1e-6 else 0.0)
    return PathPoint(a.s + ds, t, x, y, wrap(yaw), curvature, a.speed, offset, direction)
