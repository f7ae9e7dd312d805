"""Conversion of a compiled MuJoCo model to a `Scene` for images, and poses of its bodies.

`Ghost` computes the poses of a MuJoCo tractor for the bicycle plant, which has no bodies.
"""

from functools import lru_cache
from math import cos, sin
from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.geometry import from_heading
from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array, Index
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.bodywork import HIDDEN, KINDS
from agrobot_mj.plants.mujoco.c_api import kinematics
from agrobot_mj.plants.mujoco.model import ackermann_coefficients, tractor_spec
from agrobot_mj.plants.scene import Geom, Mesh, Scene

_SHAPES = {kind: name for name, kind in KINDS.items()} | {mujoco.mjtGeom.mjGEOM_MESH: "mesh"}


def scene_of(model: mujoco.MjModel) -> Scene:
    """Return a scene with all bodies of a compiled model, except the world, and their visible geoms."""
    bodies = tuple(model.body(i).name for i in range(1, model.nbody))
    shown = (model.geom_bodyid > 0) & (model.geom_group < HIDDEN) & np.isin(model.geom_type, [int(k) for k in _SHAPES])
    return Scene(bodies, tuple(_geom(model, int(i)) for i in np.flatnonzero(shown)))


def _geom(model: mujoco.MjModel, i: int) -> Geom:
    geom, material = model.geom(i), int(model.geom_matid[i])
    rgba = model.mat_rgba[material] if material >= 0 else geom.rgba
    return Geom(
        name=geom.name,
        body=model.body(model.geom_bodyid[i]).name,
        kind=_SHAPES[mujoco.mjtGeom(int(model.geom_type[i]))],
        size=tuple(geom.size.tolist()),
        pos=tuple(geom.pos.tolist()),
        quat=tuple(geom.quat.tolist()),
        rgba=tuple(rgba.tolist()),
        mesh=None if (at := int(model.geom_dataid[i])) < 0 else _mesh(model, at),
    )


def _mesh(model: mujoco.MjModel, i: int) -> Mesh:
    points = slice(int(model.mesh_vertadr[i]), int(model.mesh_vertadr[i] + model.mesh_vertnum[i]))
    faces = slice(int(model.mesh_faceadr[i]), int(model.mesh_faceadr[i] + model.mesh_facenum[i]))
    return Mesh(np.array(model.mesh_vert[points], dtype=float), np.array(model.mesh_face[faces], dtype=np.int64))


def poses_of(data: mujoco.MjData) -> tuple[Array, Array]:
    """Return views of the positions (n, 3) and quaternions w x y z (n, 4) of all bodies except the world."""
    return data.xpos[1:], data.xquat[1:]


class DrawnTractor(NamedTuple):
    """Inputs of `show`: model and data of a `Ghost`, and dimensions of its tractor."""

    model: int
    data: int
    qpos: Array
    at: Index  # Indices of the crank, the front wheel angles and the four wheel rotations in qpos, shape (7,)
    left: Array  # Coefficients of the polynomial from the virtual steering angle to the left wheel angle, shape (5,)
    behind: float  # Distance from the CG to the rear axle [m]
    radii: tuple[float, float]  # Radii of the front and rear wheels [m]


@kernel
def show(g: DrawnTractor, x: float, y: float, yaw: float, steer: float, travelled: float) -> int:
    """Compute the poses of all bodies for a position of the CG [m], yaw and steering angle [rad], and distance
    travelled [m]. Return 1 after an error, else 0."""
    back_x, back_y = from_heading(yaw, -g.behind, 0.0)
    q, left, right = g.qpos, 0.0, 0.0
    q[0], q[1], q[3], q[6] = x + back_x, y + back_y, cos(yaw / 2), sin(yaw / 2)
    for k in range(4, -1, -1):
        left, right = left * steer + g.left[k], -right * steer + g.left[k]
    q[g.at[0]], q[g.at[1]], q[g.at[2]] = steer, left, -right
    for k in range(3, 7):
        q[g.at[k]] = travelled / g.radii[0 if k < 5 else 1]
    return int(kinematics(g.model, g.data))


@lru_cache(maxsize=8)
def _compile_tractor(tractor: TractorParameters) -> tuple[mujoco.MjModel, Scene, Index, Array]:
    model = tractor_spec(Machine(tractor)).compile()
    joints = ("steer", "steer_fl", "steer_fr", "spin_fl", "spin_fr", "spin_rl", "spin_rr")
    at = np.array([int(model.joint(name).qposadr[0]) for name in joints])
    return model, scene_of(model), at, ackermann_coefficients(tractor)


class Ghost:
    """MuJoCo tractor on level ground that shows the planar state of the bicycle plant in images."""

    def __init__(self, tractor: TractorParameters) -> None:
        self.model, self.scene, at, left = _compile_tractor(tractor)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:7] = 0.0
        self.shown = DrawnTractor(
            model=self.model._address,
            data=self.data._address,
            qpos=self.data.qpos,
            at=at,
            left=left,
            behind=tractor.cg_to_rear_axle,
            radii=(tractor.front_wheel_radius_m, tractor.rear_wheel_radius_m),
        )
