"""What every path is made of: pieces of constant curvature, travelled at constant speed after a ramp from rest.

Lengths in metres along the path; curvature in 1/m, left positive; yaw from east, counter-clockwise.
"""

from itertools import pairwise
from math import cos, pi, sin, sqrt
from typing import Annotated, NamedTuple

from pydantic import Field

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Reference

SLOWEST_M_S, FASTEST_M_S = 0.001, 5.0
"""Speeds that a reference may have [m/s]."""
Speed = Annotated[float, Field(ge=SLOWEST_M_S, le=FASTEST_M_S)]
Ramp = Annotated[float, Field(ge=0, le=60)]
RAMP_S = 4.0
"""Default ramp [s]: 0.3 m/s2 at 1.2 m/s. Estimate: what a driver takes."""


class Pose(NamedTuple):
    """A point of a path and the direction of travel there."""

    x: float
    """East [m]."""
    y: float
    """North [m]."""
    yaw: float
    """Not wrapped [rad]."""


class Place(NamedTuple):
    """A point of a path, for messages."""

    x: float
    """East [m]."""
    y: float
    """North [m]."""
    distance: float
    """Way from the start [m]."""


def advance(start: Pose, curvature: float, distance: float) -> Pose:
    """The pose `distance` [m] (may be negative) along an arc of `curvature` [1/m] that begins at `start`."""
    half_turn = curvature * distance / 2
    chord = distance * (sin(half_turn) / half_turn if half_turn else 1.0)
    direction = start.yaw + half_turn
    return Pose(start.x + chord * cos(direction), start.y + chord * sin(direction), start.yaw + 2 * half_turn)


def progress(t: float, ramp: float) -> tuple[float, float]:
    """Time at full speed [s] that the way until `t` [s] stands for, and the share of full speed [-], when the speed
    rises evenly from rest over `ramp` [s]."""
    if t >= ramp:
        return t - ramp / 2, 1.0
    return (t * t / (2 * ramp), t / ramp) if t > 0 else (0.0, 0.0)


def when(moved: float, ramp: float) -> float:
    """The time [s] at which `progress` gives `moved` [s]."""
    return moved + ramp / 2 if moved >= ramp / 2 else sqrt(2 * ramp * moved)


def turns(duration: float, count: int, ramp: float, run_in: float = 0.0) -> tuple[tuple[float, float], ...]:
    """(start, end) of `count` turns that take `duration` [s] each at full speed, after a run-in [s at full speed]."""
    times = [when(run_in + k * duration, ramp) for k in range(count + 1)]
    return tuple(pairwise(times))


def reference(pose: Pose, curvature: float, speed: float) -> Reference:
    """The reference of a point that passes `pose` at `speed` [m/s]."""
    yaw = pose.yaw if -pi < pose.yaw <= pi else wrap(pose.yaw)
    return Reference(pose.x, pose.y, speed * cos(yaw), speed * sin(yaw), yaw, curvature)
