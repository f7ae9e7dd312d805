"""The MuJoCo tractor: sole owner of the simulation's MjModel and MjData."""

from math import atan2, cos, hypot, isfinite, radians
from typing import Annotated, Literal

import mujoco
import numpy as np
from pydantic import Field

from agrobot_mj.driveline import Driveline, drive_at_rest, drive_law
from agrobot_mj.geometry import wrap
from agrobot_mj.hydraulics import Cylinder, Valve, ailing, come_to_rest, static_flow, valve_law
from agrobot_mj.plants.model import WHEELS, simulation_model, tractor_spec
from agrobot_mj.plants.scene import body_poses, scene_of
from agrobot_mj.plants.stepping import Oil, Tyred, Views, observe, run_steps
from agrobot_mj.signals import GOOD_DAY, NEUTRAL_V, Array, Conditions, Drive, Reference, Truth
from agrobot_mj.spec import Spec
from agrobot_mj.terrain import Ground, height_and_gradient
from agrobot_mj.terrain.grid import heights
from agrobot_mj.tractor import TractorParameters
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Tyre
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, LOAD, SLIP_ANGLE, SLIP_RATIO

ROLLOVER_COSINE = cos(radians(60))
"""Cosine of the lean beyond which the tractor counts as rolled over [-]. Estimate: past any balance point."""


UNEARTHLY_SPEED = 100.0
"""A tractor faster than this has blown up [m/s]. Estimate."""


class Mujoco(Spec):
    """The MJCF tractor on its tyres."""

    kind: Literal["mujoco"] = "mujoco"
    tyre: Tyre = MagicFormula()
    """Law of the tyres, `plant.tyre.kind`."""
    settle_s: Annotated[float, Field(ge=0, le=120)] = 3.0
    """Time to come to rest on the tyres before the run starts [s]."""


class MujocoPlant:
    """The running tractor."""

    def __init__(
        self,
        spec: Mujoco,
        tractor: TractorParameters,
        valve: Valve,
        cylinder: Cylinder,
        driveline: Driveline,
        ground: Ground,
        physics_dt: float,
        steps: int,
    ) -> None:
        self.spec, self.tractor, self.ground = spec, tractor, ground
        native = isinstance(spec.tyre, Contact)
        contact = spec.tyre if isinstance(spec.tyre, Contact) else Contact()
        self.model = simulation_model(
            tractor_spec(tractor, cylinder, driveline),
            ground,
            physics_dt,
            native,
            contact.friction,
            contact.impratio,
        )
        self.data = mujoco.MjData(self.model)
        law = tyre_set(Linear() if isinstance(spec.tyre, Contact) else spec.tyre, tractor)
        self.tyred = Tyred(native, law, ground, np.zeros((4, 3)), np.zeros((4, 6)))
        self.oil = Oil(
            displacement=cylinder.displacement,
            steer_limit=tractor.steer_limit,
            steer_windup=cylinder.relief_torque / cylinder.stiffness_n_m_rad,
            steer_lead=cylinder.damping_n_m_s_rad / cylinder.stiffness_n_m_rad,
            drive_radius=tractor.rear_wheel_radius_m,
            drive_torque=driveline.torque_limit_n_m,
            drive_power=1e3 * driveline.power_limit_kw,
            drive_stiffness=driveline.stiffness_n_m_rad,
            drive_lead=driveline.damping_n_m_s_rad / driveline.stiffness_n_m_rad,
        )
        self.sound_valve, self.valve_memory = valve_law(valve, physics_dt)
        self.valve, self.conditions = self.sound_valve, GOOD_DAY
        self.drive, self.drive_memory = drive_law(driveline, physics_dt)
        self.views = _views(self.model, self.data)
        self.samples = np.zeros((2, steps))
        self.settle_ticks = round(spec.settle_s / (steps * physics_dt))
        self.tick_s, self.ticks = steps * physics_dt, 0
        self.scene = scene_of(self.model)
        self.sites = [np.array(self.model.site(name).pos) for name in ("cg", "antenna")]
        self.motion = np.zeros(18)
        self.velocity = np.zeros(6)

    def reset(self, start: Reference) -> Truth:
        """Place the tractor at rest with its CG above the path's start, and let it settle on its tyres."""
        mujoco.mj_resetData(self.model, self.data)
        self.tyred.bristles[:] = 0.0
        self._befall(GOOD_DAY)
        come_to_rest(self.valve_memory)
        drive_at_rest(self.drive_memory)
        self.data.qpos[:7] = _pose_on(self.ground, start, self.tractor)
        for _ in range(self.settle_ticks):
            self.step_through(Drive(NEUTRAL_V, NEUTRAL_V))
        mujoco.mj_forward(self.model, self.data)
        self.ticks = 0
        return self.truth()

    def advance(self, drive: Drive, conditions: Conditions = GOOD_DAY) -> Truth:
        """One tick under constant voltages and conditions."""
        if conditions != self.conditions:
            self._befall(conditions)
        self.step_through(drive)
        self.ticks += 1
        return self.truth()

    def step_through(self, drive: Drive) -> None:
        """The physics steps of one tick under constant voltages, without looking at the outcome."""
        run_steps(
            self.views,
            self.tyred,
            self.oil,
            self.valve,
            self.valve_memory,
            self.drive,
            self.drive_memory,
            (drive.steer_voltage, drive.pedal_voltage),
            self.samples,
        )

    def _befall(self, conditions: Conditions) -> None:
        """Put the machine under these conditions."""
        self.conditions = conditions
        self.valve = ailing(self.sound_valve, conditions.valve_gain, conditions.valve_dead_band)
        self.tyred.tyres.grip[:] = conditions.grip

    def truth(self) -> Truth:
        """The state as the sensors may see it."""
        observe(self.views, self.sites[0], self.sites[1], self.motion)
        motion, q = self.motion.tolist(), self.data.qpos
        return Truth(
            t=self.ticks * self.tick_s,
            x=motion[0],
            y=motion[1],
            z=motion[2],
            yaw=wrap(motion[12]),
            pitch=motion[13],
            roll=motion[14],
            speed=motion[15],
            lateral_speed=motion[16],
            yaw_rate=motion[17],
            steer=float(q[self.views.steer_q]),
            pedal=float(self.drive_memory.pedal[0]),
            rear_x=float(q[0]),
            rear_y=float(q[1]),
            antenna=(motion[3], motion[4], motion[5]),
            antenna_velocity=(motion[9], motion[10], motion[11]),
            steer_samples=self.samples[0].copy(),
            pedal_samples=self.samples[1].copy(),
        )

    def poses(self) -> Array:
        """Pose of every body of the scene, shape (bodies, 7): x y z, quaternion w x y z."""
        return body_poses(self.data)

    def wheels(self) -> Array:
        """Load, slip angle, slip ratio, forward and lateral force, use of friction; shape (6 * 4,), by quantity."""
        if self.tyred.native:
            self._read_contacts()
        return self.tyred.report.T.ravel()

    def actuation(self) -> tuple[float, float, float]:
        """Oil flow to the cylinder [m3/s], its pressure [Pa] and the torque on the driven wheels [N m]."""
        flow = static_flow(self.valve, float(self.valve_memory.spool[0]))
        steering, drive = self.data.actuator_force.tolist()
        return flow, steering / self.oil.displacement, drive

    def _read_contacts(self) -> None:
        """Fill the report from MuJoCo's contact sensors and the wheels' own motion, in the plane of the ground."""
        for i, wheel in enumerate(WHEELS):
            body = self.model.body(f"wheel_{wheel}").id
            force = self.data.sensor(f"contact_{wheel}").data[:3]
            mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, body, self.velocity, 0)
            axle = self.data.xmat[body].reshape(3, 3)[:, 1]
            _, dx, dy = height_and_gradient(self.ground, *self.data.xpos[body, :2])
            n = np.array([-dx, -dy, 1.0]) / hypot(dx, dy, 1.0)
            forward = np.cross(axle, n)
            forward /= np.linalg.norm(forward)
            left = np.cross(n, forward)
            v_x, v_y = float(self.velocity[3:] @ forward), float(self.velocity[3:] @ left)
            rim = float(self.velocity[:3] @ axle) * float(self.tyred.tyres.radius[i])
            upward = force if force @ n >= 0 else -force
            report = self.tyred.report[i]
            report[LOAD], report[FORCE_X], report[FORCE_Y] = upward @ n, upward @ forward, upward @ left
            report[SLIP_ANGLE] = atan2(v_y, max(abs(v_x), 1e-3))
            report[SLIP_RATIO] = (rim - v_x) / max(abs(v_x), abs(rim), 1e-3)

    def warnings(self) -> int:
        """How often MuJoCo warned since the reset."""
        return sum(int(warning.number) for warning in self.data.warning)

    def trouble(self) -> str | None:
        """What ended the run, if anything: rolled_over, left_terrain or diverged."""
        x, y = self.motion[0], self.motion[1]
        if not isfinite(self.motion.sum()) or abs(self.motion[6:12]).max() > UNEARTHLY_SPEED:
            return "diverged"
        if self.data.xmat[1, 8] < ROLLOVER_COSINE:
            return "rolled_over"
        return None if self.ground.covers(x, y) else "left_terrain"


def _views(model: mujoco.MjModel, data: mujoco.MjData) -> Views:
    return Views(
        model=model._address,
        data=data._address,
        ctrl=data.ctrl,
        act=data.act,
        qpos=data.qpos,
        qvel=data.qvel,
        xpos=data.xpos,
        xmat=data.xmat,
        cvel=data.cvel,
        root_com=data.subtree_com[1],
        xfrc=data.xfrc_applied,
        wheels=np.array([model.body(f"wheel_{w}").id for w in WHEELS], dtype=np.int64),
        steer_q=int(model.joint("steer").qposadr[0]),
        spins_q=np.array([model.joint(f"spin_{w}").qposadr[0] for w in ("rl", "rr")], dtype=np.int64),
        steer_v=int(model.joint("steer").dofadr[0]),
        spins_v=np.array([model.joint(f"spin_{w}").dofadr[0] for w in ("rl", "rr")], dtype=np.int64),
    )


def _pose_on(ground: Ground, start: Reference, tractor: TractorParameters) -> Array:
    """Free-joint position (7,) with the chassis aligned to the ground below its wheels and the CG above the start."""
    heading = np.array([np.cos(start.yaw), np.sin(start.yaw), 0.0])
    height, n = _footprint(ground, start, tractor)
    forward = heading - (heading @ n) * n
    forward /= np.linalg.norm(forward)
    rotation = np.stack([forward, np.cross(n, forward), n], axis=1)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    cg = rotation @ np.array([tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m])
    z = height + cg[:2] @ n[:2] / n[2]
    return np.concatenate([[start.x - cg[0], start.y - cg[1], z], quat])


def _footprint(ground: Ground, start: Reference, tractor: TractorParameters) -> tuple[float, Array]:
    """Height at the start [m] and normal (3,) of the plane along the ground below the wheels that clears them all."""
    L, l_r, half = tractor.wheelbase_m, tractor.cg_to_rear_axle, tractor.track_m / 2
    c, s = np.cos(start.yaw), np.sin(start.yaw)
    wheels = np.array([[L - l_r, half], [L - l_r, -half], [-l_r, half], [-l_r, -half]])
    x, y = (wheels @ np.array([[c, s], [-s, c]]) + (start.x, start.y)).T
    below = heights(ground, x, y)
    ahead = (below[:2].sum() - below[2:].sum()) / (2 * L)
    left = (below[::2].sum() - below[1::2].sum()) / (4 * half)
    n = np.array([left * s - ahead * c, -ahead * s - left * c, 1.0])
    return float((below - wheels @ (ahead, left)).max()), n / np.linalg.norm(n)
