"""Pedal valve and hydrostatic drive: voltage to pedal position to the rim speed that the pump demands.

Input 0-12 V, neutral at 6 V. The electro-mechanic valve moves the pedal at a rate (dead band, gain, limit); the
pedal sets the pump's displacement, which follows with a lag. The output is the rim speed that the oil flow corresponds
to; the MuJoCo plant puts the trapped oil's spring and the differential between it and the wheels, the bicycle
takes it as the speed. All numbers are estimates for a compact tractor's two-pedal hydrostat in its low range.
"""

from math import exp
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import NEUTRAL_V, Array
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class Driveline(Spec):
    """Driveline, from the voltage of the pedal valve to the rear wheels."""

    pedal_dead_band_v: Annotated[float, Field(ge=0, lt=NEUTRAL_V)] = 0.30
    """Half width of the dead band about neutral [V]. Estimate."""
    pedal_rate_per_v_s: Positive = 0.50
    """Pedal rate per volt beyond the dead band [1/(V s)]. Estimate."""
    pedal_rate_limit_per_s: Positive = 1.5
    """Largest pedal rate [1/s]. Estimate."""
    full_speed_m_s: Positive = 5.0
    """Rim speed at full pedal [m/s]. Estimate."""
    pump_time_constant_s: Positive = 0.30
    """Displacement lag of the hydrostat [s]. Estimate."""
    torque_limit_n_m: Positive = 3000.0
    """Torque at which the relief valve opens, summed over the driven wheels, driving and braking [N m]. Estimate: above
    the grip on firm ground."""
    power_limit_kw: Positive = 14.0
    """Power at the wheels that the engine and the hydrostat can give [kW]. Estimate: 18.6 kW engine, 75 %."""
    connected: bool = True
    """Whether the range gear is engaged; if False the wheels roll freely."""
    differential_lock: bool = False
    """Whether both rear wheels are locked to turn at the same speed."""
    front_wheel_drive: bool = False
    """Whether the front axle is driven too, mechanically, through an open front differential."""
    front_lead: Annotated[float, Field(ge=0.8, le=1.25)] = 1.02
    """Rim speed of the driven front wheels over that of the rear wheels [-]. Estimate (1.01-1.05)."""
    stiffness_n_m_rad: Positive = 6.0e4
    """Stiffness of trapped oil and shafts, at the mean wheel angle [N m/rad]. Estimate."""
    damping_n_m_s_rad: NonNegative = 400.0
    """Damping of shafts and final drives, at the mean wheel speed [N m s/rad]. Estimate."""


class DriveLaw(NamedTuple):
    """A `Driveline` as the compiled kernel takes it."""

    dead_band: float
    """Half width of the dead band about neutral [V]."""
    gain: float
    """Pedal rate per volt beyond the dead band [1/(V s)]."""
    rate_limit: float
    """Largest pedal rate [1/s]."""
    full_speed: float
    """Rim speed at full pedal [m/s]."""
    lag: float
    """Share of its value that the pump keeps over a step, exp(-dt / time constant) [-]."""
    dt: float
    """Length of a step [s]."""


class DriveMemory(NamedTuple):
    """State of the drive between steps; written in place."""

    pedal: Array
    """Pedal position in [-1, 1], shape (1,) [-]."""
    speed: Array
    """Rim speed that the oil flow corresponds to, shape (1,) [m/s]."""


def drive_law(driveline: Driveline, dt: float) -> tuple[DriveLaw, DriveMemory]:
    """The kernel's parameters and its initial state, for steps of `dt` [s]."""
    law = DriveLaw(
        dead_band=driveline.pedal_dead_band_v,
        gain=driveline.pedal_rate_per_v_s,
        rate_limit=driveline.pedal_rate_limit_per_s,
        full_speed=driveline.full_speed_m_s,
        lag=exp(-dt / driveline.pump_time_constant_s),
        dt=dt,
    )
    return law, DriveMemory(np.zeros(1), np.zeros(1))


def reset_drive(memory: DriveMemory) -> None:
    """Pedal released, pump at zero."""
    memory.pedal[:], memory.speed[:] = 0.0, 0.0


@kernel
def drive_step(law: DriveLaw, memory: DriveMemory, voltage: float) -> float:
    """Advance pedal and pump by one step under `voltage` [V]; returns the rim speed asked for [m/s]."""
    v = voltage - NEUTRAL_V
    rate = 0.0
    if abs(v) > law.dead_band:
        rate = law.gain * (v - law.dead_band if v > 0 else v + law.dead_band)
    rate = min(max(rate, -law.rate_limit), law.rate_limit)
    memory.pedal[0] = min(max(memory.pedal[0] + rate * law.dt, -1.0), 1.0)
    target = memory.pedal[0] * law.full_speed
    memory.speed[0] = target + law.lag * (memory.speed[0] - target)
    return float(memory.speed[0])
