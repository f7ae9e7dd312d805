"""What every path is made of: pieces of constant curvature travelled at constant speed.

Lengths in metres along the path; curvature in 1/m, left positive; yaw from east, counter-clockwise.
"""

from math import cos, pi, sin
from typing import Annotated, NamedTuple

from pydantic import Field

from agrobot_mj.geometry import wrap
from agrobot_mj.signals import Reference

Speed = Annotated[float, Field(gt=0, le=5)]


class Pose(NamedTuple):
    """A point of a path and the direction of travel there."""

    x: float
    """East [m]."""
    y: float
    """North [m]."""
    yaw: float
    """Not wrapped [rad]."""


def advance(start: Pose, curvature: float, distance: float) -> Pose:
    """The pose `distance` [m] (may be negative) along an arc of `curvature` [1/m] that begins at `start`."""
    half_turn = curvature * distance / 2
    chord = distance * (sin(half_turn) / half_turn if half_turn else 1.0)
    direction = start.yaw + half_turn
    return Pose(start.x + chord * cos(direction), start.y + chord * sin(direction), start.yaw + 2 * half_turn)


def reference(pose: Pose, curvature: float, speed: float) -> Reference:
    """The reference of a point that passes `pose` at `speed` [m/s]."""
    yaw = pose.yaw if -pi < pose.yaw <= pi else wrap(pose.yaw)
    return Reference(pose.x, pose.y, speed * cos(yaw), speed * sin(yaw), yaw, curvature)
