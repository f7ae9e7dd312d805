"""Clearance between the tractor's chassis and the ground; physics steps with enough clearance skip contact detection.

The chassis parts that can touch the ground are above `lowest` and within `reach` of the z axis of the chassis. With the
angle a between this axis and the ground normal, the height of all parts above the ground is at least the height of the
chassis origin + lowest cos(a) - reach sin(a). The ground is a plane; a height grid is replaced by the level of its
highest node.
"""

from math import inf, sqrt
from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector
from agrobot_mj.plants.mujoco.views import CHASSIS

SPARE_M = 0.01  # Clearance below which contacts are detected [m]; large compared with rounding errors


class Clearance(NamedTuple):
    """Extent of the chassis parts that can touch the ground, and plane of the ground."""

    lowest: float  # Height of the lowest part in the chassis frame [m]
    reach: float  # Maximum distance of a part from the z axis of the chassis [m]
    normal: Vector  # Normal of the ground in world axes, unit vector [-]
    level: float
    """Signed distance of the ground plane from the world origin along its normal [m], or infinity if bodies other than
    the chassis can touch the ground."""


def clearance_of(model: mujoco.MjModel) -> Clearance:
    """Return the clearance parameters of a compiled `model`, which contains the tractor and a geom named `ground`."""
    touching = [k for k in range(model.ngeom) if model.geom_contype[k] or model.geom_conaffinity[k]]
    parts = [k for k in touching if model.geom_bodyid[k] > 0]
    corners = np.concatenate([_corners(model, k) for k in parts])
    lowest, reach = float(corners[:, 2].min()), float(np.hypot(corners[:, 0], corners[:, 1]).max())
    if any(model.geom_bodyid[k] != CHASSIS for k in parts):
        return Clearance(lowest, reach, (0.0, 0.0, 1.0), inf)
    ground = model.geom("ground")
    if ground.type == mujoco.mjtGeom.mjGEOM_HFIELD:
        return Clearance(lowest, reach, (0.0, 0.0, 1.0), float(ground.pos[2] + model.hfield_size[0, 2]))
    normal = rotation_of(ground.quat)[:, 2]
    x, y, z = normal.tolist()
    return Clearance(lowest, reach, (x, y, z), float(normal @ ground.pos))


def _corners(model: mujoco.MjModel, geom: int) -> Array:
    """Return the corners of the bounding box of a geom in the frame of its body [m], shape (8, 3)."""
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    signs = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)]), axis=-1).reshape(8, 3)
    found: Array = model.geom_pos[geom] + (middle + signs * half) @ rotation_of(model.geom_quat[geom]).T
    return found


def rotation_of(quat: Array) -> Array:
    """Return the rotation matrix of a quaternion w x y z, shape (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def quat_of(rotation: Array) -> Array:
    """Return the quaternion w x y z of a rotation matrix, shape (4,)."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    return quat


@kernel
def is_clear(c: Clearance, qpos: Array) -> bool:
    """Return whether a tractor with the generalised positions `qpos` cannot touch the ground; NaN gives False."""
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    n = c.normal
    cosine = n[0] * 2 * (x * z + w * y) + n[1] * 2 * (y * z - w * x) + n[2] * (1 - 2 * (x * x + y * y))
    over = n[0] * qpos[0] + n[1] * qpos[1] + n[2] * qpos[2] - c.level
    sine = sqrt(max(1 - cosine * cosine, 0.0))
    return bool(cosine > 0.0 and over + c.lowest * cosine - c.reach * sine > SPARE_M)
