"""Inertial unit, which measures roll and pitch with gyros and accelerometers.

Gyros propagate the attitude from tick to tick. Accelerometers correct the attitude with the time constant tau, using
the specific force f along the level axes, divided by g, like the levelling loop of an inertial navigation system.
Shocks cause no bias in this loop, because accelerations along a level axis average to zero. Shocks bias an
inclinometer, which measures the direction of f: a bump pushes the tractor up and back at the same time. The unit
interprets accelerations as tilt: in a frame that rotates with the yaw rate r the error settles at e / (1 + (tau r)^2),
with e = a / g for a lateral acceleration a. With aiding, the unit subtracts speed times yaw rate and the change of
speed; the accelerations from sideslip, heave and the lever arm remain. The mean of f over a tick is computed from the
velocities at the start and end of the tick.

Each axis has additional errors: constant bias, slow first-order Gauss-Markov error (thermal drift) [Brown2012] and
white noise. Angles are in rad as in ISO 8855 (positive for left side up and nose down), and keys in deg.
"""

from math import atan2, exp, hypot, nan, radians
from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.core.geometry import from_heading, to_body, to_heading, to_level, wrap
from agrobot_mj.core.kernels import jit
from agrobot_mj.core.randomness import GaussMarkov, Shares, normal, shares, stream, wandered_plane
from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.core.vectors import Vector, cross
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.sensors.base import CompiledSensor, Noise, SensedMotion


class Attitude(NamedTuple):
    """Measurement of the inertial unit: roll, pitch and specific force; NaN if there is no inertial unit."""

    roll: float  # Roll [rad], left side up positive
    pitch: float  # Pitch, nose down positive [rad]
    force_x: float = nan  # Specific force along the chassis x axis [m/s2], mean over the tick, forward positive
    force_y: float = nan  # Specific force along the chassis y axis [m/s2], mean over the tick, left positive
    force_z: float = nan  # Specific force along the chassis z axis [m/s2], mean over the tick, up positive


class UnitMotion(NamedTuple):
    """Motion of unit and tractor at the end of a tick, from which the next tick computes the acceleration."""

    velocity: Vector  # Velocity of the inertial unit, ENU [m/s]
    speed: float  # Speed of the tractor along its heading [m/s]
    yaw: float  # Heading of the tractor [rad]


class ImuLaw(NamedTuple):
    """Parameters of the inertial unit, as numbers for compiled kernels."""

    dt: float  # Length of a tick [s]
    aided: bool  # Whether the unit subtracts accelerations computed from speed and yaw rate
    inclined: bool  # Whether the unit is an inclinometer, without levelling by gyros
    keep: float  # Fraction of the tilt error that remains after a tick [-]
    shown: float  # Tilt error that an acceleration causes in a tick, divided by the acceleration [rad s2/m]
    place: Vector  # Position of the unit relative to the ground below the rear axle: ahead, left and up [m]
    sigma: float  # Standard deviation of the white noise of each axis [deg]
    slow: float  # Standard deviation of the slow error of each axis [deg]
    kept: Shares  # Weights of the last value and of white noise in the slow error [-]
    bias: tuple[float, float]  # Constant errors of roll and pitch [deg]


class ImuValues(NamedTuple):
    """State of the inertial unit between two ticks."""

    error: tuple[float, float]  # Slow error of roll and pitch, divided by its standard deviation [-]
    tilt: tuple[float, float] = (0.0, 0.0)  # Error of roll and pitch from accelerations interpreted as tilt [rad]
    last: UnitMotion = UnitMotion((nan, nan, nan), nan, nan)
    """Motion at the end of the last tick, or NaN before the first tick."""


@jit
def attitude(p: ImuLaw, s: ImuValues, streams: tuple[int], motion: SensedMotion) -> tuple[ImuValues, Attitude]:
    """Return the new state and the measurement: roll and pitch [rad], and specific force [m/s2]."""
    error = wandered_plane(s.error, p.kept, streams[0])
    e_r = p.bias[0] + p.slow * error[0] + p.sigma * normal(streams[0])
    e_p = p.bias[1] + p.slow * error[1] + p.sigma * normal(streams[0])
    now = _unit_motion(p, motion)
    last = now if s.last.yaw != s.last.yaw else s.last
    turned = wrap(now.yaw - last.yaw)
    pull = _acceleration(last, now, turned, p.dt)
    known = _aiding_acceleration(p, last, now, turned)
    roll, pitch = _tilt_errors(p, s.tilt, (pull[0] - known[0], pull[1] - known[1], pull[2]), turned, motion)
    force = _force(pull, motion)
    reading = Attitude(
        motion.roll + roll + radians(e_r), motion.pitch + pitch + radians(e_p), force[0], force[1], force[2]
    )
    return ImuValues(error, (roll, pitch), now), reading


@jit
def _unit_motion(p: ImuLaw, motion: SensedMotion) -> UnitMotion:
    """Return the velocity of the inertial unit at its mounting position, with speed and heading of the tractor."""
    swing = cross(motion.body_rates, p.place)
    forward, left, up = to_level(motion.roll, motion.pitch, swing)
    east, north = from_heading(motion.yaw, forward, left)
    v = motion.rear_velocity
    return UnitMotion((v[0] + east, v[1] + north, v[2] + up), motion.speed, motion.yaw)


@jit
def _acceleration(last: UnitMotion, now: UnitMotion, turned: float, dt: float) -> Vector:
    """Return the mean acceleration of the unit in a tick [m/s2], forward, left and up in the level frame."""
    east, north = now.velocity[0] - last.velocity[0], now.velocity[1] - last.velocity[1]
    forward, left = to_heading(last.yaw + turned / 2, east / dt, north / dt)
    return forward, left, (now.velocity[2] - last.velocity[2]) / dt


@jit
def _aiding_acceleration(p: ImuLaw, last: UnitMotion, now: UnitMotion, turned: float) -> tuple[float, float]:
    """Return the acceleration [m/s2] that aiding computes from speed and yaw rate, forward and to the left, or 0
    without aiding."""
    if not p.aided:
        return 0.0, 0.0
    return (now.speed - last.speed) / p.dt, (now.speed + last.speed) / 2 * turned / p.dt


@jit
def _tilt_errors(
    p: ImuLaw, tilt: tuple[float, float], pull: Vector, turned: float, motion: SensedMotion
) -> tuple[float, float]:
    """Return the errors of roll and pitch [rad] after a tick in which aiding does not compensate the acceleration
    `pull`."""
    if p.inclined:
        f_x, f_y, f_z = _force(pull, motion)
        return atan2(f_y, f_z) - motion.roll, atan2(-f_x, hypot(f_y, f_z)) - motion.pitch
    # ideal gyros keep the error fixed in space: it rotates in the tractor frame
    roll, pitch = to_heading(turned, tilt[0], tilt[1])
    return p.keep * roll + p.shown * pull[1], p.keep * pitch - p.shown * pull[0]


@jit
def _force(pull: Vector, motion: SensedMotion) -> Vector:
    """Return the specific force [m/s2] in chassis axes for the acceleration `pull` [m/s2] in the level frame."""
    return to_body(motion.roll, motion.pitch, (pull[0], pull[1], pull[2] + GRAVITY))


class Imu(CompiledSensor):
    """Inertial unit on the chassis (`[sensors.imu]`); absent on the paper's tractor."""

    sized: ClassVar = {"up_m": {"length": 1}}
    law = attitude
    absent = Attitude(nan, nan)

    enabled: bool = False
    """Whether the inertial unit is present; otherwise roll and pitch are NaN."""
    aiding: Literal["none", "speed"] = "speed"
    """Aiding: `speed` to subtract accelerations computed from speed and yaw rate, or `none` for no aiding."""
    time_constant_s: NonNegative = 3.0
    """Time constant of the levelling by accelerometers [s], or 0 for an inclinometer. Assumed value (range 1-20)."""
    ahead_m: float = 0.0
    """Distance of the unit ahead of the rear axle [m]. Assumed value for a unit above the axle."""
    left_m: float = 0.0
    """Lateral offset of the unit [m], positive to the left. Assumed value for a unit on the centre line."""
    up_m: float = 1.0
    """Height of the unit above the ground below the rear axle [m]. Assumed value (range 0.5-3, from cab floor to cab
    roof)."""
    sigma_deg: NonNegative = 0.1
    """Standard deviation of the white noise of each axis [deg]. Assumed value (range 0.02-0.2) for the mean over a
    tick."""
    wander_sigma_deg: NonNegative = 0.2
    """Standard deviation of the slow error of each axis [deg]. Assumed value (range 0.1-0.5 in guidance systems)."""
    wander_time_s: Positive = 60.0
    """Correlation time of the slow error [s]. Assumed value (tens of seconds to minutes)."""
    roll_bias_deg: float = 0.0
    """Constant roll error due to mounting [deg]. Default: 0. Assumed value without calibration (up to 0.5)."""
    pitch_bias_deg: float = 0.0
    """Constant pitch error due to mounting [deg]. Default: 0. Assumed value without calibration (up to 0.5)."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of roll, pitch and specific force, or an empty tuple if the unit is absent."""
        force = "specific force at the unit {}, mean of the tick, without noise"
        found = (
            Column("imu_roll", "rad", "roll from the inertial unit, left side up positive"),
            Column("imu_pitch", "rad", "pitch from the inertial unit, nose down positive"),
            Column("imu_force_x", "m/s2", force.format("forward"), drawn=False),
            Column("imu_force_y", "m/s2", force.format("to the left"), drawn=False),
            Column("imu_force_z", "m/s2", force.format("up, in the chassis' axes"), drawn=False),
        )
        return found if self.enabled else ()

    def parameters(self, dt: float) -> ImuLaw:
        """Return the parameters of the kernel `attitude` for ticks of length `dt` [s]."""
        keep = exp(-dt / self.time_constant_s) if self.time_constant_s else 0.0
        return ImuLaw(
            dt=dt,
            aided=self.aiding == "speed",
            inclined=self.time_constant_s == 0.0,
            keep=keep,
            shown=(1.0 - keep) / GRAVITY,
            place=(self.ahead_m, self.left_m, self.up_m),
            sigma=self.sigma_deg,
            slow=self.wander_sigma_deg,
            kept=shares(dt, self.wander_time_s),
            bias=(self.roll_bias_deg, self.pitch_bias_deg),
        )

    def init(self, seed: int) -> Noise:
        """Return the initial state, with a slow error sampled from its stationary distribution."""
        error = GaussMarkov.stationary(stream(seed, "imu"), 2)
        return Noise((error.generator,), ImuValues(error.value))

    def report(self, reading: Attitude) -> tuple[float, ...]:
        """Return roll, pitch and specific force, or an empty tuple if the unit is absent."""
        return reading if self.enabled else ()
