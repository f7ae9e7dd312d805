"""Angle wrapping, rotation between frames, and polygons."""

from collections.abc import Sequence
from math import cos, pi, sin
from typing import TypeVar

import numpy as np

from agrobot_mj.core.signals import Array

Angle = TypeVar("Angle", float, Array)


def wrap(angle: Angle) -> Angle:
    """Wrap an angle, or an array of angles, to (-pi, pi] [rad]."""
    return pi - (pi - angle) % (2 * pi)


def to_heading(yaw: float, east: float, north: float) -> tuple[float, float]:
    """Rotate an ENU vector (east, north) to components (forward, left) in a frame with heading `yaw` [rad]."""
    c, s = cos(yaw), sin(yaw)
    return c * east + s * north, -s * east + c * north


def from_heading(yaw: float, forward: float, left: float) -> tuple[float, float]:
    """Rotate a vector (forward, left) in a frame with heading `yaw` [rad] to ENU components (east, north)."""
    c, s = cos(yaw), sin(yaw)
    return c * forward - s * left, s * forward + c * left


def along_arc(start: tuple[float, float, float], curvature: float, distance: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] after `distance` [m] along an arc of `curvature` [1/m] from the pose
    `start`."""
    x, y, yaw = start
    half_turn = curvature * distance / 2
    chord = distance * (sin(half_turn) / half_turn if half_turn else 1.0)
    direction = yaw + half_turn
    return x + chord * cos(direction), y + chord * sin(direction), yaw + 2 * half_turn


def to_level(roll: float, pitch: float, vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Rotate a vector from the body axes (x, y, z) to the level frame (forward, left, up) by roll and pitch [rad]."""
    x, y, z = vector
    left, up = cos(roll) * y - sin(roll) * z, sin(roll) * y + cos(roll) * z
    return cos(pitch) * x + sin(pitch) * up, left, -sin(pitch) * x + cos(pitch) * up


def to_body(roll: float, pitch: float, vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Rotate a vector from the level frame (forward, left, up) to the body axes (x, y, z) by roll and pitch [rad]."""
    forward, left, up = vector
    across = sin(pitch) * forward + cos(pitch) * up
    ahead = cos(pitch) * forward - sin(pitch) * up
    return ahead, cos(roll) * left + sin(roll) * across, -sin(roll) * left + cos(roll) * across


def check_polygon(points: Sequence[tuple[float, float]]) -> None:
    """Raise ValueError with the key `points` in its text if the corners of a polygon do not enclose an area."""
    if len(set(points)) < 3:
        raise ValueError("points: the polygon has fewer than 3 different corners; add corners")
    lengths = np.linalg.svd(np.array(points) - points[0], compute_uv=False)
    if lengths[1] < 1e-9 * lengths[0]:
        raise ValueError("points: all corners are on one line; add a corner off this line")


def in_polygon(points: Sequence[tuple[float, float]], x: float, y: float) -> bool:
    """Return whether the point (x, y) is inside a polygon with the corners `points`, by counting crossed edges."""
    inside = False
    for (x0, y0), (x1, y1) in zip(points, (*points[1:], points[0]), strict=True):
        if (y0 <= y) != (y1 <= y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside
