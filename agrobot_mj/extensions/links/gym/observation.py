"""Observations of an agent: quantities that a controller on the tractor can measure or estimate and, optionally, true
values.

A table defines name, unit, bound, description and value of each component. Bounds are symmetric. Values beyond a bound
are clipped.
"""

from collections.abc import Callable
from math import pi
from typing import NamedTuple

import numpy as np

from agrobot_mj.control.base import Situation
from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.signals import Array, PathPoint, Truth

Vector = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


class Moment(NamedTuple):
    """State of an episode at one tick, from which observations are computed."""

    situation: Situation
    truth: Truth
    beside: PathPoint  # Path point nearest to the estimated position
    beside_truth: PathPoint  # Path point nearest to the true position
    curvatures: Array  # Path curvatures at the preview distances ahead of `beside` [1/m]
    steer: float  # Steering angle of the last action [rad], left positive


class Observed(NamedTuple):
    """Definition of one component of an observation."""

    name: str
    unit: str
    bound: float  # Maximum absolute value [unit of the component]
    description: str
    value: Callable[[Moment], float]


def along_track(m: Moment) -> float:
    """Return the distance of the reference ahead of the estimated position, along the reference heading [m]."""
    r, e = m.situation.reference, m.situation.estimate
    return to_heading(r.yaw, r.x - e.x, r.y - e.y)[0]


def reference_speed(m: Moment) -> float:
    """Return the component of the reference velocity along the reference heading [m/s], negative in reverse."""
    r = m.situation.reference
    return to_heading(r.yaw, r.vx, r.vy)[0]


SEEN = (
    Observed(
        "cross_track", "m", 5.0, "distance of the estimated CG from the path, left positive", lambda m: m.beside.offset
    ),
    Observed("along_track", "m", 10.0, "distance of the reference ahead of the estimated CG", along_track),
    Observed(
        "heading_error",
        "rad",
        pi,
        "estimated heading minus path heading, left positive",
        lambda m: wrap(m.situation.estimate.yaw - m.beside.yaw),
    ),
    Observed("speed", "m/s", 10.0, "estimated speed, negative in reverse", lambda m: m.situation.estimate.speed),
    Observed("speed_ref", "m/s", 10.0, "speed of the reference, negative in reverse", reference_speed),
    Observed("yaw_rate", "rad/s", 3.0, "estimated yaw rate, left positive", lambda m: m.situation.estimate.yaw_rate),
    Observed("steer", "rad", 1.0, "measured steering angle, left positive", lambda m: m.situation.steer),
    Observed("steer_action", "rad", 1.0, "steering angle of the last action, left positive", lambda m: m.steer),
)
"""Components that precede the path curvatures in every observation."""

ROLL = Observed("roll", "rad", pi, "measured roll, left side up positive", lambda m: m.situation.roll)
"""Measured roll, a component for scenarios with an inertial unit (`sensors.imu.enabled`)."""

TRUTH = (
    Observed(
        "true_cross_track", "m", 5.0, "distance of the CG from the path, left positive", lambda m: m.beside_truth.offset
    ),
    Observed(
        "true_heading_error",
        "rad",
        pi,
        "heading minus path heading, left positive",
        lambda m: wrap(m.truth.yaw - m.beside_truth.yaw),
    ),
    Observed("true_speed", "m/s", 10.0, "speed of the CG along the heading", lambda m: m.truth.speed),
    Observed("true_lateral_speed", "m/s", 5.0, "speed of the CG to the left", lambda m: m.truth.lateral_speed),
    Observed("true_yaw_rate", "rad/s", 3.0, "yaw rate, left positive", lambda m: m.truth.yaw_rate),
    Observed("true_steer", "rad", 1.0, "steering angle, left positive", lambda m: m.truth.steer),
    Observed("true_roll", "rad", pi, "roll, left side up positive", lambda m: m.truth.roll),
    Observed("true_pitch", "rad", pi, "pitch, nose down positive", lambda m: m.truth.pitch),
)
"""True values, appended to the observation with `privileged=True`."""


def curvature_ahead(k: int, distance: float) -> Observed:
    """Return a component with the path curvature at the preview distance `k`, which is `distance` [m]."""
    return Observed(
        f"curvature_{distance:g}m",
        "1/m",
        1.0,
        f"path curvature {distance:g} m ahead, left positive",
        lambda m: float(m.curvatures[k]),
    )


def table(preview_m: tuple[float, ...], imu: bool, privileged: bool) -> tuple[Observed, ...]:
    """Return the components of an observation in order, including the path curvatures `preview_m` [m] ahead."""
    ahead = tuple(curvature_ahead(k, distance) for k, distance in enumerate(preview_m))
    return (*SEEN, *ahead, *((ROLL,) if imu else ()), *(TRUTH if privileged else ()))


def bounds(components: tuple[Observed, ...]) -> Vector:
    """Return the maximum absolute value of each component, shape (n,)."""
    return np.array([part.bound for part in components], dtype=np.float32)


def observation(components: tuple[Observed, ...], highest: Vector, moment: Moment) -> Vector:
    """Return the observation clipped to its bounds, shape (n,). NaN and infinite values (diverged run) become 0."""
    values = np.array([part.value(moment) for part in components], dtype=np.float32)
    values[~np.isfinite(values)] = 0.0
    return np.minimum(np.maximum(values, -highest), highest)
