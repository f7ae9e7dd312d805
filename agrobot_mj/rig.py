"""A tyre test rig: one wheel on level ground, driven at prescribed speed, slip and load through the tractor's own kernel.

The wheel's centre moves at a constant velocity at a constant height, its spin is imposed, and the forces are read once the
bristles have settled (or at each step). MuJoCo's native contact has no kernel: `contact_curve` tows a wheel in MuJoCo.
"""

from typing import NamedTuple

import mujoco
import numpy as np
import pyarrow as pa

from agrobot_mj.compiled import jit
from agrobot_mj.signals import Array
from agrobot_mj.terrain import Flat
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.tractor import TractorParameters
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Soil
from agrobot_mj.tyres.laws import tyre_set, wheel_step
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, TyreSet

DT_S = 0.002
"""Step of the rig, the simulator's default [s]."""
SETTLE_LENGTHS = 20.0
"""Relaxation lengths travelled before a steady force is read [-]."""
FRONT, REAR = 0, 2
"""Which of the tractor's tyres is on the rig."""


class Setting(NamedTuple):
    """What the rig imposes."""

    speed: float
    """Of the wheel's centre along its own heading [m/s]."""
    slip_angle: float
    """Between heading and velocity, positive when the wheel slides left [rad]."""
    slip_ratio: float
    """(rim - v) / v, driving positive [-]."""
    load: float
    """Vertical [N]."""


@jit
def drive_wheel(
    tyres: TyreSet, i: int, ground: Ground, setting: Setting, steps: int, dt: float, forces: Array
) -> None:
    """Run the rig for `steps` steps; `forces` (steps, 2) receives forward and lateral force [N]."""
    deflection = setting.load / tyres.stiffness[i]
    r_e = tyres.radius[i] - deflection / 3.0
    spin = (1.0 + setting.slip_ratio) * setting.speed / r_e
    centre = (0.0, 0.0, tyres.radius[i] - deflection)
    velocity = (setting.speed, setting.speed * np.tan(setting.slip_angle), 0.0)
    bristle, wrench, report = np.zeros(3), np.zeros(6), np.zeros(5)
    for k in range(steps):
        rotation = (0.0, spin, 0.0)
        wheel_step(
            tyres, i, ground, centre, (0.0, 1.0, 0.0), velocity, rotation, dt, bristle, wrench, report
        )
        forces[k, 0], forces[k, 1] = report[FORCE_X], report[FORCE_Y]


class Rig:
    """One tyre of a tractor on the rig."""

    def __init__(
        self, tyre: Linear | MagicFormula | Soil, tractor: TractorParameters, wheel: int = FRONT
    ) -> None:
        self.tyres, self.wheel = tyre_set(tyre, tractor), wheel
        self.ground = Flat().ground()
        self.relaxation = float(self.tyres.relaxation[wheel].max())

    def history(self, setting: Setting, distance_m: float, dt: float = DT_S) -> Array:
        """Forward and lateral force after each step of a start from rest bristles, shape (steps, 2) [N]."""
        steps = max(2, round(distance_m / (setting.speed * dt)))
        forces = np.zeros((steps, 2))
        drive_wheel(self.tyres, self.wheel, self.ground, setting, steps, dt, forces)
        return forces

    def steady(self, setting: Setting) -> tuple[float, float]:
        """Forward and lateral force once settled [N]."""
        forces = self.history(setting, SETTLE_LENGTHS * self.relaxation)
        return float(forces[-1, 0]), float(forces[-1, 1])


def sweep(tyre: Linear | MagicFormula | Soil, tractor: TractorParameters, speeds: Array, loads: Array) -> pa.Table:
    """Steady forces over slip angle and slip ratio, each pure, for front and rear tyre, every load and speed.

    `speeds` (n,) [m/s]; `loads` (m,) as shares of the static load [-].
    """
    angles = np.radians(np.linspace(-20, 20, 81))
    ratios = np.linspace(-0.5, 0.5, 81)
    rows = []
    for axle, wheel, static in (
        ("front", FRONT, tractor.front_axle_load / 2),
        ("rear", REAR, tractor.rear_axle_load / 2),
    ):
        rig = Rig(tyre, tractor, wheel)
        for speed in speeds:
            for load in loads * static:
                settings = [Setting(speed, a, 0.0, load) for a in angles]
                settings += [Setting(speed, 0.0, k, load) for k in ratios]
                rows += [(axle, *setting, *rig.steady(setting)) for setting in settings]
    names = ["axle", "speed_m_s", "slip_angle_rad", "slip_ratio", "load_n", "fx_n", "fy_n"]
    return pa.table([list(column) for column in zip(*rows, strict=True)], names=names)


def contact_curve(tyre: Contact, tractor: TractorParameters, speed: float, angles: Array) -> Array:
    """Lateral force of MuJoCo's own contact on a towed front wheel, shape as `angles` [rad], [N].

    A sled carries the static load; it is towed along x at `speed` [m/s], the wheel at the slip angle, rolling freely.
    """
    radius, width = tractor.front_wheel_radius_m, tractor.front_wheel_width_m
    load = tractor.front_axle_load / 2
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{DT_S}" integrator="implicitfast" cone="elliptic" impratio="{tyre.impratio}"/>
        <worldbody><geom type="plane" size="500 500 1" friction="{tyre.friction}"/>
          <body pos="0 0 {radius}"><joint name="x" type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
            <geom type="sphere" size="0.01" mass="{load / 9.81 - tractor.front_wheel_mass_kg}" contype="0" conaffinity="0"/>
            <body><joint name="toe" type="hinge" axis="0 0 1" armature="1e6"/>
              <inertial pos="0 0 0" mass="0.01" diaginertia="1e-4 1e-4 1e-4"/>
              <body><joint type="hinge" axis="0 1 0"/>
                <geom type="cylinder" size="{radius} {width / 2}" quat="1 1 0 0" mass="{tractor.front_wheel_mass_kg}"
                  friction="{tyre.friction}" priority="1" condim="3" solref="0.02 1"/></body></body></body></worldbody>
        <actuator><velocity joint="x" kv="1e6"/></actuator></mujoco>"""
    )
    found, data = [], mujoco.MjData(model)
    for angle in angles:
        mujoco.mj_resetData(model, data)
        data.joint("toe").qpos[0], data.ctrl[0] = -angle, speed
        data.joint("x").qvel[0] = speed
        mujoco.mj_step(model, data, round(3.0 / DT_S))
        force, lateral = np.zeros(6), 0.0
        for contact in range(data.ncon):
            mujoco.mj_contactForce(model, data, contact, force)
            frame = data.contact[contact].frame.reshape(3, 3)
            world = frame.T @ force[:3]
            lateral += float(world[1] * np.cos(angle) + world[0] * np.sin(angle))
        found.append(lateral)
    return np.array(found)
