"""Conversion of a compiled MuJoCo model to a `Scene` for images, and poses of its bodies.

`Ghost` computes the poses of a MuJoCo tractor for the bicycle plant, which has no bodies.
"""

from math import cos, sin

import mujoco
import numpy as np

from agrobot_mj.core.geometry import from_heading
from agrobot_mj.core.signals import Array
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.bodywork import HIDDEN, KINDS
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


class Ghost:
    """MuJoCo tractor on level ground that shows the planar state of the bicycle plant in images."""

    def __init__(self, tractor: TractorParameters) -> None:
        self.model = tractor_spec(Machine(tractor)).compile()
        self.data = mujoco.MjData(self.model)
        self.scene = scene_of(self.model)
        self.tractor, self.left = tractor, ackermann_coefficients(tractor)
        joints = ("steer", "steer_fl", "steer_fr", "spin_fl", "spin_fr", "spin_rl", "spin_rr")
        self.at = [int(self.model.joint(name).qposadr[0]) for name in joints]

    def poses(self, x: float, y: float, yaw: float, steer: float, travelled: float) -> Array:
        """Return the poses of all bodies, shape (bodies, 7), for a position of the CG [m], yaw and steering angle
        [rad], and distance travelled [m]."""
        back_x, back_y = from_heading(yaw, -self.tractor.cg_to_rear_axle, 0.0)
        q = self.data.qpos
        q[:7] = x + back_x, y + back_y, 0.0, cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)
        front = travelled / self.tractor.front_wheel_radius_m
        rear = travelled / self.tractor.rear_wheel_radius_m
        powers = steer ** np.arange(5)
        q[self.at] = steer, self.left @ powers, -self.left @ (-steer) ** np.arange(5), front, front, rear, rear
        mujoco.mj_kinematics(self.model, self.data)
        return np.concatenate(poses_of(self.data), axis=1)
