"""Initial pose of a tractor: on both rear wheels, and in front on the middle of its pivoting axle."""

from math import hypot

import mujoco
import numpy as np

from agrobot_mj.core.signals import Array, Reference
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Ground, height_and_gradient

PASSES = 3
"""Fits of the plane: each finds the wheels where the one before has put them."""


def pose_on(ground: Ground, start: Reference, tractor: TractorParameters) -> tuple[Array, float]:
    """Free-joint position (7,) with the CG above the start, and the roll of the front axle [rad]."""
    _, dx, dy = height_and_gradient(ground, start.x, start.y)
    rotation = _facing(np.array([-dx, -dy, 1.0]) / hypot(dx, dy, 1.0), start.yaw)
    l_r, half = tractor.cg_to_rear_axle, tractor.track_m / 2
    cg = np.array([l_r, 0.0, tractor.cg_height_m])
    feet = np.array([[tractor.wheelbase_m * front, side * half, 0.0] for front in (1, 0) for side in (1, -1)])
    points = np.zeros((4, 3))
    for _ in range(PASSES):
        rear = np.array([start.x, start.y, 0.0]) - rotation @ cg
        points = rear + feet @ rotation.T
        points[:, 2] = [height_and_gradient(ground, x, y)[0] for x, y in points[:, :2]]
        front, left = points[:2].mean(axis=0) - points[2:].mean(axis=0), points[2] - points[3]
        normal = np.cross(front, left)
        rotation = _facing(normal / np.linalg.norm(normal), start.yaw)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    place = np.array([start.x, start.y, 0.0]) - rotation @ cg
    place[2] = points[2:, 2].mean()
    across = (points[0] - points[1]) @ rotation
    limit = np.radians(tractor.axle_pivot_limit_deg)
    return np.concatenate([place, quat]), float(np.clip(np.arctan2(across[2], across[1]), -limit, limit))


def _facing(normal: Array, yaw: float) -> Array:
    """Rotation (3, 3) that stands on a plane of this normal, with its nose towards `yaw` as seen from above [rad]."""
    forward = np.cross([-np.sin(yaw), np.cos(yaw), 0.0], normal)
    forward /= np.linalg.norm(forward)
    return np.stack([forward, np.cross(normal, forward), normal], axis=1)
