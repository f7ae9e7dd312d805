"""Rig for MuJoCo's contact model, which has no tyre kernel: a sled tows the wheel of the tractor in MuJoCo.

The wheel is taken from `models/tractor.xml`. The sled keeps its heading along x and its velocity, carries the load as
mass, and moves freely upwards. Before sliding, the force is viscous,

    F_y = -c v_y,        c = n b impratio m d / (1 - d),

with n contact points, d and b of `solimp` and `solref`, and the effective mass m at the contact. The cornering
stiffness is c v_x. During sliding, MuJoCo's contact pushes the wheel off the ground, and the wheel hops. Therefore a
steady measurement is a mean over time, and `Reading.grounded` is the fraction of time in contact.
"""

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.extensions.bench.rig.wheel import DT_S, FRONT, Reading, Setting
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants.mujoco.model import tractor_spec
from agrobot_mj.tyres.base import NativeContact

RIGID = 1e9  # Gain of the actuators that impose velocities [N s/m, N m s/rad]: 1,000 times the gain of the contact
PREFIX = "towed_"  # Prefix of the names of all elements taken from the tractor model
FOUND_AND_NET_FORCE = [0b11, 3, 1]
"""Settings of the contact sensor for two outputs: number of contacts, and net force in the world frame."""
SETTLE_S, STEADY_S = 1.0, 2.0
"""Time at rest before the motion, and duration of a steady measurement, whose second half is averaged [s]."""


class Towed:
    """Tyre rig with the contact model of MuJoCo and the interface of `Rig`."""

    relaxation = 0.0
    """Relaxation length of the contact model, always 0 [m]. Only the constraints of the sled delay the force."""

    def __init__(self, contact: NativeContact, tractor: TractorParameters, wheel: int = FRONT) -> None:
        self.contact, self.tractor, self.wheel = contact, tractor, wheel
        self.load = 0.0

    def history(self, setting: Setting, distance_m: float) -> Array:
        """Impose the motion of a setting over `distance_m` [m]. Return one `Reading` per time step, shape (steps,
        5)."""
        self._carry(setting.load)
        model, data = self.model, self.data
        data.qpos[:], data.time = self.settled, 0.0
        data.ctrl[:] = data.qvel[self.imposed] = self._velocity(setting)
        data.qvel[2] = 0.0
        out = np.zeros((max(2, round(distance_m / (setting.speed * DT_S))), 5))
        for row in out:
            mujoco.mj_step(model, data)
            row[:] = self._read()
        return out

    def steady(self, setting: Setting) -> Reading:
        """Return forces, moment and fraction of time in contact with the ground in steady state, averaged over time."""
        readings = self.history(setting, STEADY_S * setting.speed)
        return Reading(*readings[len(readings) // 2 :].mean(axis=0).tolist())

    def _carry(self, load: float) -> None:
        if load == self.load:
            return
        self.load, self.model = load, _model(self.contact, self.tractor, WHEELS[self.wheel], load)
        self.data = mujoco.MjData(self.model)
        joints = ("x", "y", f"{PREFIX}spin_{WHEELS[self.wheel]}")
        self.imposed = [int(self.model.joint(name).dofadr[0]) for name in joints]
        mujoco.mj_step(self.model, self.data, round(SETTLE_S / DT_S))
        self.settled = self.data.qpos.copy()
        depth = -min(float(c.dist) for c in self.data.contact)
        self.radius = float(self.model.geom(f"{PREFIX}tyre_{WHEELS[self.wheel]}").size[0]) - depth / 2

    def _velocity(self, setting: Setting) -> tuple[float, float, float]:
        """Return the sled velocities along x and y [m/s], and the wheel spin [rad/s] from the mean contact radius."""
        v = setting.speed
        return v, v * float(np.tan(setting.slip_angle)), (1.0 + setting.slip_ratio) * v / self.radius

    def _read(self) -> tuple[float, float, float, float, float]:
        """Return the `Reading` of this step, with signs such that the normal force is positive."""
        touches, fx, fy, fz = self.data.sensor("contact").data.tolist()
        sign = 1.0 if fz > 0.0 else -1.0
        return sign * fx, sign * fy, 0.0, sign * fz, float(touches > 0.0)


def _model(contact: NativeContact, tractor: TractorParameters, wheel: str, load: float) -> mujoco.MjModel:
    """Return a MuJoCo model of sled, wheel and level ground, with imposed velocities along x and y and imposed spin."""
    whole = tractor_spec(Machine(tractor))
    spec = mujoco.MjSpec()
    for name in ("integrator", "cone"):
        setattr(spec.option, name, getattr(whole.option, name))
    spec.option.timestep, spec.option.impratio = DT_S, contact.impratio
    body = whole.body(f"wheel_{wheel}")
    mass, radius = load / GRAVITY - body.mass, float(whole.geom(f"tyre_{wheel}").size[0])
    if mass <= 0:
        raise ValueError(f"load: {load:g} N is below the weight of the wheel; increase the load")
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], friction=[contact.friction, 0.005, 0.0001]
    )
    sled = spec.worldbody.add_body(name="sled", pos=[0, 0, radius], mass=mass, inertia=[1, 1, 1])
    for name, axis in zip("xyz", np.eye(3), strict=True):
        sled.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    sled.add_frame().attach_body(body, PREFIX, "").pos = [0, 0, 0]
    spec.geom(f"{PREFIX}tyre_{wheel}").friction[0] = contact.friction
    for joint in ("x", "y", f"{PREFIX}spin_{wheel}"):
        spec.add_actuator(target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_velocity(kv=RIGID)
    spec.add_sensor(
        name="contact",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=f"{PREFIX}tyre_{wheel}",
        intprm=FOUND_AND_NET_FORCE,
    )
    return spec.compile()
