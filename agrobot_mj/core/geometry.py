"""Angle wrapping and frames, shared by every stage."""

from math import cos, pi, sin
from typing import TypeVar

from agrobot_mj.core.signals import Array

Angle = TypeVar("Angle", float, Array)


def wrap(angle: Angle) -> Angle:
    """Wrap an angle, or each of an array of them, [rad] to (-pi, pi]."""
    return pi - (pi - angle) % (2 * pi)


def to_heading(yaw: float, east: float, north: float) -> tuple[float, float]:
    """Components (forward, left) of an ENU vector in the frame of heading `yaw` [rad]; same unit as the input."""
    c, s = cos(yaw), sin(yaw)
    return c * east + s * north, -s * east + c * north


def from_heading(yaw: float, forward: float, left: float) -> tuple[float, float]:
    """ENU components (east, north) of a vector given in the frame of heading `yaw` [rad]."""
    c, s = cos(yaw), sin(yaw)
    return c * forward - s * left, s * forward + c * left
