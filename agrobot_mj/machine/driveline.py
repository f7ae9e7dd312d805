"""Pedal valve, hydrostatic drive and brake: from the voltage of the pedal valve to the rim speed of the wheels.

The input is 0-12 V, neutral at 6 V. The electro-mechanical valve moves the pedal: the pedal rate has a dead band, a
gain and a limit. Without power a spring returns the pedal to neutral. The pump displacement follows the pedal with a
first-order lag. The output is the rim speed that corresponds to the oil flow.

The MuJoCo plant adds the spring of the trapped oil and the differential; the bicycle plant uses the rim speed as
vehicle speed. All numbers are assumed values for the two-pedal hydrostatic drive of a compact tractor. The default
torques, stiffness and damping are proportional to mass times wheel radius, so that tractors of the same shape climb and
hold the same slope. The default power is proportional to mass.
"""

from math import exp, isnan
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import NEUTRAL_V, Array
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.machine.tractor import COMPACT, TractorParameters

TORQUE_N_M, POWER_KW, STIFFNESS_N_M_RAD, DAMPING_N_M_S_RAD = 3000.0, 14.0, 6.0e4, 400.0
"""Maximum torque [N m], maximum power [kW], stiffness [N m/rad] and damping [N m s/rad] of the drive of the compact
tractor. Assumed values: the torque makes the wheels slip on firm ground; the power is 75 % of an 18.6 kW engine."""
BRAKING_M_S2 = 3.55
"""Deceleration by the brake [m/s2]: the minimum that [EU2015] requires of service brakes up to 30 km/h. At this
deceleration the brake holds the tractor on a slope of 21 deg (38 %); parking brakes must hold on a slope of 18 %."""


ReleaseDeg = Annotated[float, Field(gt=0, le=60)]  # Steering angle of the release of a lock or a drive [deg]


class Driveline(Spec):
    """Driveline from the pedal valve to the driven wheels."""

    pedal_dead_band_v: Annotated[float, Field(ge=0, lt=NEUTRAL_V)] = 0.30
    """Half width of the pedal valve's dead band about neutral [V]. Assumed value (range 0.2-0.6)."""
    pedal_rate_per_v_s: Positive = 0.50
    """Pedal rate per volt outside the dead band [1/(V s)]. Assumed value (range 0.3-1)."""
    pedal_rate_limit_per_s: Positive = 1.5
    """Maximum pedal rate [1/s]. Assumed value: full pedal travel takes 0.5-2 s."""
    pedal_return_per_s: Positive = 2.0
    """Rate at which the spring returns the pedal of an unpowered valve [1/s]. Assumed value (range 1-4)."""
    full_speed_m_s: Positive = 5.0
    """Rim speed at full pedal [m/s]. Assumed value (range 4-7 in the high gear of compact tractors)."""
    pump_time_constant_s: Positive = 0.30
    """Time constant with which the pump displacement follows the pedal [s]. Assumed value (range 0.2-0.5)."""
    torque_limit_n_m: Positive | None = None
    """Sum of the driven wheels' torques at which the relief valve opens, in driving and braking [N m]. Default: 3000
    for the compact tractor, which makes the wheels slip on firm ground; scaled with mass and rear wheel radius."""
    power_limit_kw: Positive | None = None
    """Maximum power at the wheels [kW]. Default: 14 for the compact tractor, scaled with the mass."""
    brake_torque_n_m: NonNegative | None = None
    """Torque of the service and parking brake [N m]: braking force times rear wheel radius; 0 for no brake. Default:
    computed from a deceleration of 3.55 m/s2 [EU2015]; 1118 for the compact tractor."""
    brake_front_share: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Fraction of the braking force that acts at the front wheels [-]. Default: rear brakes only, as on compact
    tractors. Assumed value: 0.5 for a brake at each wheel, or if braking engages the front-wheel drive [EPO1995]."""
    connected: bool = True
    """Whether the range gear is engaged. If the gear is in neutral, the wheels roll freely."""
    differential_lock: bool = False
    """Whether the rear differential is locked, so that both rear wheels turn at the same speed."""
    front_wheel_drive: bool = False
    """Whether a shaft also drives the front axle, through an open front differential."""
    lock_release_deg: ReleaseDeg | None = None
    """Steering angle above which the differential lock is released [deg]. The lock engages again 3 deg below this
    angle, or at half this angle if half is larger. Default: never released. Assumed value (range 5-15)."""
    front_release_deg: ReleaseDeg | None = None
    """Steering angle above which the front-wheel drive is released [deg]. The drive engages again 3 deg below this
    angle, or at half this angle if half is larger. Default: never released. Assumed value (range 20-30)."""
    front_engage_slip: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Slip of the rear wheels at which the front-wheel drive engages [-]. The drive is released at half this slip.
    Default: engaged at any slip. Assumed value (range 0.05-0.15)."""
    motor_front_share: Annotated[float, Field(ge=0.01, le=0.99)] | None = None
    """Fraction of the drive torque at the front wheels [-], for a machine with one motor per wheel. Both motors of an
    axle have the same torque, as with an open differential. Default: no motors at the front wheels. Assumed value:
    0.5 for robots with four equal wheels."""
    engine_droop: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    """Relative decrease of the rim speed from no load to full engine power [-]. Default: 0, for constant speed.
    Assumed value (range 0.05-0.1) for mechanical governors."""
    front_lead: Annotated[float, Field(ge=0.8, le=1.25)] = 1.02
    """Rim speed of the driven front wheels divided by the rim speed of the rear wheels [-]. Assumed value (range
    1.01-1.05)."""
    stiffness_n_m_rad: Positive | None = None
    """Stiffness of trapped oil and shafts, referred to the mean wheel angle [N m/rad]. Default: 6e4 for the compact
    tractor, scaled with mass and rear wheel radius."""
    damping_n_m_s_rad: NonNegative | None = None
    """Damping of shafts and final drives, referred to the mean wheel speed [N m s/rad]. Default: 400 for the compact
    tractor, scaled with mass and rear wheel radius."""

    @model_validator(mode="after")
    def _check_releases(self) -> "Driveline":
        for key, needs in (
            ("lock_release_deg", "differential_lock"),
            ("front_release_deg", "front_wheel_drive"),
            ("front_engage_slip", "front_wheel_drive"),
        ):
            if getattr(self, key) is not None and not getattr(self, needs):
                raise ValueError(f"{key}: has no effect without {needs}; set driveline.{needs} = true")
        if self.motor_front_share is not None and self.front_wheel_drive:
            raise ValueError("motor_front_share: cannot be combined with front_wheel_drive; omit one of the two keys")
        return self

    def strength(self, tractor: TractorParameters) -> "Strength":
        """Return maximum torque, power, brake torque, stiffness and damping; defaults scale with the machine size."""
        mass = tractor.mass_kg / COMPACT.mass_kg
        moment = mass * (tractor.rear_wheel_radius_m / COMPACT.rear_wheel_radius_m)
        weight = tractor.mass_kg * tractor.rear_wheel_radius_m
        return Strength(
            torque=_value_or_default(self.torque_limit_n_m, moment * TORQUE_N_M),
            power=1e3 * _value_or_default(self.power_limit_kw, mass * POWER_KW),
            brake=_value_or_default(self.brake_torque_n_m, weight * BRAKING_M_S2),
            stiffness=_value_or_default(self.stiffness_n_m_rad, moment * STIFFNESS_N_M_RAD),
            damping=_value_or_default(self.damping_n_m_s_rad, moment * DAMPING_N_M_S_RAD),
        )

    def brake_torques(self, tractor: TractorParameters) -> Array:
        """Return the brake torques at the wheels fl, fr, rl and rr [N m], shape (4,)."""
        total, radii = self.strength(tractor).brake, tractor.front_wheel_radius_m / tractor.rear_wheel_radius_m
        front, rear = self.brake_front_share * radii * total / 2, (1.0 - self.brake_front_share) * total / 2
        return np.array([front, front, rear, rear])


def _value_or_default(value: float | None, default: float) -> float:
    return default if value is None else value


class Strength(NamedTuple):
    """Maximum torque, power and brake torque of a driveline, and its stiffness and damping."""

    torque: float  # Torque at which the relief valve of the drive opens, summed over the driven wheels [N m]
    power: float  # Maximum driving power [W]
    brake: float  # Brake torque, braking force times rear wheel radius [N m]
    stiffness: float  # Stiffness of trapped oil and shafts [N m/rad]
    damping: float  # Damping of shafts and final drives [N m s/rad]


class DriveLaw(NamedTuple):
    """Parameters of a `Driveline` for the compiled function `drive_step`."""

    dead_band: float  # Half width of the dead band about neutral [V]
    gain: float  # Pedal rate per volt outside the dead band [1/(V s)]
    rate_limit: float  # Maximum pedal rate [1/s]
    spring: float  # Rate at which the return spring moves the unpowered pedal [1/s]
    full_speed: float  # Rim speed at full pedal [m/s]
    lag: float  # Fraction of the previous rim speed that remains after a step, exp(-dt / time constant) [-]
    dt: float  # Time step of the physics [s]


class DriveMemory(NamedTuple):
    """Position of the pedal and speed of the drive between two physics steps, in arrays that `drive_step` modifies."""

    pedal: Array  # Pedal position in [-1, 1], shape (1,) [-]
    speed: Array  # Rim speed that corresponds to the oil flow [m/s], shape (1,)


def drive_law(driveline: Driveline, dt: float) -> tuple[DriveLaw, DriveMemory]:
    """Return the parameters and the initial state of `drive_step`, for physics steps of `dt` [s]."""
    law = DriveLaw(
        dead_band=driveline.pedal_dead_band_v,
        gain=driveline.pedal_rate_per_v_s,
        rate_limit=driveline.pedal_rate_limit_per_s,
        spring=driveline.pedal_return_per_s,
        full_speed=driveline.full_speed_m_s,
        lag=exp(-dt / driveline.pump_time_constant_s),
        dt=dt,
    )
    return law, DriveMemory(np.zeros(1), np.zeros(1))


def reset_drive(memory: DriveMemory) -> None:
    """Set the pedal to neutral and the rim speed to zero."""
    memory.pedal[:], memory.speed[:] = 0.0, 0.0


@kernel
def drive_step(law: DriveLaw, memory: DriveMemory, voltage: float) -> float:
    """Advance the pedal and the pump by one physics step, and return the rim speed [m/s].

    `voltage` is the voltage of the pedal valve [V], or NaN without power.
    """
    v = voltage - NEUTRAL_V
    rate = 0.0
    if abs(v) > law.dead_band:
        rate = law.gain * (v - law.dead_band if v > 0 else v + law.dead_band)
    rate = min(max(rate, -law.rate_limit), law.rate_limit)
    if isnan(voltage):
        rate = min(max(-memory.pedal[0] / law.dt, -law.spring), law.spring)
    memory.pedal[0] = min(max(memory.pedal[0] + rate * law.dt, -1.0), 1.0)
    target = memory.pedal[0] * law.full_speed
    memory.speed[0] = target + law.lag * (memory.speed[0] - target)
    return float(memory.speed[0])
