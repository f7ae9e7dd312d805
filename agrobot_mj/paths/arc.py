"""Geometry of a path segment: poses along an arc or a clothoid, and the reference state of a point that moves along it.

Distances [m] are measured along the tractor's heading and are negative in reverse. Curvature [1/m] is positive to the
left. Yaw is counter-clockwise from east. `progress` and its inverse `time_at` apply to paths on which the speed
increases linearly from rest to a constant speed.
"""

from itertools import pairwise
from math import cos, inf, pi, sin, sqrt
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.geometry import along_arc, wrap
from agrobot_mj.core.kernels import shared
from agrobot_mj.core.signals import Reference

SLOWEST_M_S, FASTEST_M_S = 0.001, 5.0  # Minimum and maximum speed of a reference path [m/s]
Speed = Annotated[float, Field(ge=SLOWEST_M_S, le=FASTEST_M_S)]
Ramp = Annotated[float, Field(ge=0, le=60)]
RAMP_S = 4.0  # Default ramp time [s]. Assumed value, typical of drivers: 0.3 m/s2 up to 1.2 m/s.

NODES = tuple(zip(*(part.tolist()[2:] for part in np.polynomial.legendre.leggauss(5)), strict=True))
"""Nodes and weights [-] of five-point Gauss-Legendre quadrature: the central node and the positive nodes."""
MAX_HALF_TURN = 0.2
"""Maximum heading change over half a clothoid [rad]. Longer clothoids are divided, for a relative error below 1e-10."""


class Pose(NamedTuple):
    """Position and heading of the tractor on a path."""

    x: float  # East coordinate [m]
    y: float  # North coordinate [m]
    yaw: float  # Heading [rad], not wrapped


class Place(NamedTuple):
    """Position on a path with its distance from the start, for error messages."""

    x: float  # East coordinate [m]
    y: float  # North coordinate [m]
    distance: float  # Distance travelled from the start [m]


@shared
def advance(start: Pose, curvature: float, distance: float, sharpness: float = 0.0) -> Pose:
    """Return the pose at `distance` [m] along an arc or clothoid from the pose `start` with initial `curvature` [1/m].

    `sharpness` [1/m2] is the change of curvature per metre, which is 0 for an arc and nonzero for a clothoid.
    """
    return _along_clothoid(start, curvature, distance, sharpness) if sharpness else on_arc(start, curvature, distance)


@shared
def on_arc(start: Pose, curvature: float, distance: float) -> Pose:
    """Return the pose at `distance` [m] along an arc of `curvature` [1/m] from the pose `start`."""
    x, y, yaw = along_arc((start.x, start.y, start.yaw), curvature, distance)
    return Pose(x, y, yaw)


@shared
def _along_clothoid(start: Pose, curvature: float, distance: float, sharpness: float) -> Pose:
    """Return the pose at `distance` [m] along a clothoid, divided into parts until their quadrature is accurate.

    A loop finds each part from the start of the clothoid, because numba does not compile the recursion.
    """
    pose, done = start, 0.0
    while done < 1.0:
        k, half, begin, fraction = curvature, distance / 2, 0.0, 1.0
        while MAX_HALF_TURN < abs((k + sharpness * half) * half) + abs(sharpness) * half * half < inf:
            fraction /= 2
            if done >= begin + fraction:
                k, begin = k + sharpness * half, begin + fraction
            half /= 2
        pose, done = _quadrature(pose, k, half, sharpness), done + fraction
    return pose


@shared
def _quadrature(start: Pose, curvature: float, half: float, sharpness: float) -> Pose:
    """Return the pose after the distance `2 * half` [m] on a short clothoid, exact up to rounding.

    At the distance u from the middle, the heading is yaw_m + kappa_m u + sharpness u^2 / 2. The quadratic term is equal
    at u and -u, so each pair of Gauss-Legendre nodes requires one evaluation of its sine and cosine.
    """
    middle = curvature + sharpness * half
    along, across = NODES[0][1], 0.0
    for node, weight in NODES[1:]:
        u = node * half
        even = 2 * weight * cos(middle * u)
        bow = sharpness * u * u / 2
        along += even * cos(bow)
        across += even * sin(bow)
    direction = start.yaw + (curvature + sharpness * half / 2) * half
    c, s = cos(direction), sin(direction)
    return Pose(
        start.x + half * (along * c - across * s),
        start.y + half * (along * s + across * c),
        start.yaw + middle * (2 * half),
    )


@shared
def progress(t: float, ramp: float) -> tuple[float, float]:
    """Return the distance [s] and the speed [-] at time `t` [s], both divided by the full speed that is reached after
    `ramp` [s]."""
    if t >= ramp:
        return t - ramp / 2, 1.0
    return (t * t / (2 * ramp), t / ramp) if t > 0 else (0.0, 0.0)


def time_at(moved: float, ramp: float) -> float:
    """Return the travel time [s] from rest, with a speed ramp of `ramp` [s], over the distance that a tractor at full
    speed covers in `moved` [s]."""
    return moved + ramp / 2 if moved >= ramp / 2 else sqrt(2 * ramp * moved)


def turns(duration: float, count: int, ramp: float, run_in: float = 0.0) -> tuple[tuple[float, float], ...]:
    """Return the start and end times of `count` laps [s], for a start from rest with a speed ramp of `ramp` [s].

    At full speed, a lap takes `duration` and the approach to the first lap takes `run_in` [s].
    """
    times = [time_at(run_in + k * duration, ramp) for k in range(count + 1)]
    return tuple(pairwise(times))


@shared
def reference(pose: Pose, curvature: float, speed: float, sharpness: float = 0.0) -> Reference:
    """Return the reference state at `pose`. The signed `speed` [m/s] along the heading is negative in reverse."""
    yaw = pose.yaw if -pi < pose.yaw <= pi else wrap(pose.yaw)
    yaw = pi if yaw == -pi else yaw  # an angle just above pi may round to -pi
    return Reference(pose.x, pose.y, speed * cos(yaw), speed * sin(yaw), yaw, curvature, sharpness * speed)


@shared
def reference_along(
    start: Pose, curvature: float, sharpness: float, distance: float, speed: float, trend: float
) -> Reference:
    """Return the reference state at `distance` [m] along a segment that starts at the pose `start`.

    `speed` [m/s] is negative in reverse. `trend` is the change of curvature per metre of the approximated curve [1/m2].
    """
    pose = advance(start, curvature, distance, sharpness)
    return reference(pose, curvature + sharpness * distance if sharpness else curvature, speed, trend)
