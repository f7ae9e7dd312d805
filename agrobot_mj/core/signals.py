"""The messages between the stages of one tick.

SI units and radians. Frames: ENU (x east, y north, z up); yaw from east, counter-clockwise; vehicle axes after
ISO 8855 (x forward, y left, z up), so steering, yaw rate and lateral velocity are left-positive, pitch is
nose-down-positive and roll is left-side-up-positive.
"""

from collections.abc import Mapping
from math import nan
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

TICK_S = 0.05
"""Sampling period of sensors and controllers [s]. Paper, T_s."""
ROUNDING_S = 1e-6
"""Tolerance on times, far above their rounding and far below a tick [s]."""
NEUTRAL_V = 6.0
"""Voltage at which a valve moves nothing [V]. Paper: range 0-12 V."""

WHEELS = ("fl", "fr", "rl", "rr")
"""Order of the wheels everywhere: front and rear, left and right."""

Outcome = Literal[
    "completed", "unfinished", "stopped", "rolled_over", "diverged", "left_terrain", "stuck", "jackknifed", "aborted",
    "host_lost", "not_engaged", "latched",
]  # fmt: skip
"""How a run can end; `completed` means that the path was driven, where the guidance follows it."""

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class Column(NamedTuple):
    """A signal in the log."""

    name: str
    unit: str
    """SI, with rad for angles; "-" without one."""
    description: str
    """One line: what it is, in which frame, with which sign."""
    drawn: bool = True
    """Whether recordings draw it on a plot of its own if no other plot shows it; the table has it in any case."""


class Truth(NamedTuple):
    """What the plant really does at time `t`; only sensors, logs and metrics may look."""

    t: float
    """Time since the start [s]."""
    x: float
    """CG, east [m]."""
    y: float
    """CG, north [m]."""
    z: float
    """CG, up [m]."""
    yaw: float
    """Heading from east, counter-clockwise, wrapped to (-pi, pi] [rad]."""
    pitch: float
    """Pitch, nose down positive [rad]."""
    roll: float
    """Roll, left side up positive [rad]."""
    speed: float
    """CG velocity along the heading, u in the paper [m/s]."""
    lateral_speed: float
    """CG velocity to the left of the heading, v in the paper [m/s]."""
    yaw_rate: float
    """Yaw rate, gamma in the paper [rad/s]."""
    steer: float
    """Front-wheel angle of the bicycle's virtual wheel, left positive [rad]."""
    pedal: float
    """Pedal position, -1 (full reverse) to 1 (full forward) [-]."""
    rear_x: float
    """R, the point below the centre of the rear axle, east [m]."""
    rear_y: float
    """R, north [m]."""
    antenna: tuple[float, float, float]
    """Position of the GNSS antenna, ENU [m]."""
    antenna_velocity: tuple[float, float, float]
    """Velocity of the GNSS antenna, ENU [m/s]."""
    steer_samples: Array
    """Steering angle after each physics step of the last tick, oldest first, shape (n,) [rad]."""
    pedal_samples: Array
    """Pedal position after each physics step of the last tick, oldest first, shape (n,) [-]."""
    wheel_speed: float = nan
    """Mean circumferential speed of the rear wheels: spin times free radius, forward positive [m/s]."""
    body_rates: tuple[float, float, float] = (nan, nan, nan)
    """Angular velocity about the chassis' own axes x forward, y left, z up [rad/s]."""
    knuckle_samples: Array | None = None
    """Angles of the left and right front wheel after each physics step of the last tick, shape (2, n) [rad]."""
    rear_velocity: tuple[float, float, float] = (nan, nan, nan)
    """Velocity of R, ENU [m/s]."""
    implement: tuple[float, float] = (nan, nan)
    """Place where the implement works, east and north; NaN without one [m]."""


class Fix(NamedTuple):
    """One GNSS solution at the antenna."""

    x: float
    """Position, east [m]."""
    y: float
    """Position, north [m]."""
    vx: float
    """Velocity, east [m/s]."""
    vy: float
    """Velocity, north [m/s]."""
    t: float = nan
    """Time at which the antenna was there, since the start; NaN if the receiver does not say [s]."""
    z: float = nan
    """Height of the antenna; NaN if the receiver does not say [m]."""
    heading: float = nan
    """Heading from two antennas, from east, counter-clockwise; NaN without them or without fixed ambiguities [rad]."""


class Quality:
    """GNSS solution quality, as logged in `gnss_quality`; DGPS, a corrected code solution, is worse than FLOAT."""

    NONE, FLOAT, FIX, DGPS = range(4)


def worse(a: int, b: int) -> int:
    """The worse one of two qualities."""
    return min(a, b, key=(Quality.NONE, Quality.DGPS, Quality.FLOAT, Quality.FIX).index)


class PointMass(NamedTuple):
    """A mass on the chassis."""

    kg: float
    """Mass, negative for ballast taken away [kg]."""
    ahead: float
    """Distance ahead of R, the point on the ground below the rear axle [m]."""
    left: float
    """Distance to the left of R [m]."""
    up: float
    """Height above R [m]."""


class Distortion(NamedTuple):
    """What a faulty line makes of its signal; by default nothing. A line carries a reading, or a valve's voltage."""

    scale: float = 1.0
    """Signal over the true one, negative with the sign swapped [-]."""
    offset: float = 0.0
    """What is added to the scaled signal, in its unit."""
    delay_s: float = 0.0
    """Time by which the signal arrives late, whole ticks [s]."""
    stuck: Literal["", "last", "zero"] = ""
    """Whether the line repeats its `last` value, or carries `zero`, whatever the signal does."""
    lost: bool = False
    """Whether nothing arrives: a reading is NaN."""


SOUND = Distortion()

Frozen = Literal["", "nothing", "velocity", "live_velocity"]
"""What a receiver with a frozen position says of its velocity: zero, the last one, or the true one; "" if it lives."""


class Conditions(NamedTuple):
    """Faults and disturbances acting in one tick; by default none."""

    gnss_quality: int = Quality.FIX
    """Quality of the solution at the antenna, one of `Quality`."""
    gnss_latency_s: float = 0.0
    """Latency on top of the receiver's own, whole ticks [s]."""
    gnss_offset: tuple[float, float] = (0.0, 0.0)
    gnss_velocity_offset: tuple[float, float] = (0.0, 0.0)
    """Offset of the solution's position [m] and velocity [m/s], east and north."""
    gnss_frozen: Frozen = ""
    """Whether the receiver repeats its last position, and what it says of its velocity."""
    heading: Distortion = SOUND
    gyro: Distortion = SOUND
    """Heading from two antennas [rad], and yaw rate from the gyro [rad/s]."""
    wheel_speed: Distortion = SOUND
    """Speed of the driven wheels from their sensor [m/s]."""
    steering_pot: Distortion = SOUND
    pedal_pot: Distortion = SOUND
    """Reading of the potentiometer of the steering [rad] and of the pedal [-]."""
    imu_roll: Distortion = SOUND
    imu_pitch: Distortion = SOUND
    """Roll and pitch from the inertial unit [rad]."""
    valve: Distortion = SOUND
    pedal_valve: Distortion = SOUND
    """Voltage that reaches the valve of the steering and that of the pedal, from neutral [V]."""
    valve_gain: float = 1.0
    """Remaining share of the steering valve's flow [-]."""
    valve_dead_band: float = 0.0
    """Increase of the steering valve's dead band, either side [V]."""
    payload: tuple[PointMass, ...] = ()
    """Masses rigidly added to the chassis."""
    drawbar: float = 0.0
    """Pull of an implement at the hitch, against the motion [N]."""
    side_force: float = 0.0
    """Horizontal force on the centre of mass, to the left of the heading [N]."""
    grip: float = 1.0
    """Scale of the ground's friction under all wheels [-]."""
    tyre_stiffness: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Remaining share of the vertical and slip stiffness of the tyres fl, fr, rl, rr [-]."""
    tyre_rolling: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Rolling resistance of the tyres fl, fr, rl, rr over that of healthy ones [-]."""


NOMINAL = Conditions()


class Measurement(NamedTuple):
    """What the controller's computer receives in one tick."""

    t: float
    """Time since the start [s]."""
    fix: Fix | None
    """GNSS solution delivered in this tick; None without one."""
    quality: int
    """Quality of that solution, of the newest one between two solutions; one of `Quality`."""
    steer: float
    """Steering angle from the potentiometer after its filter, left positive [rad]."""
    pedal: float
    """Pedal position from the potentiometer after its filter [-]."""
    gyro: float
    """Yaw rate from the gyro; NaN without one [rad/s]."""
    roll: float = nan
    pitch: float = nan
    """Roll and pitch from the inertial unit, left side up and nose down positive; NaN without one [rad]."""
    wheel_speed: float = nan
    """Speed of the driven wheels from their sensor, forward positive; NaN without one [m/s]."""
    readings: Mapping[str, Any] = MappingProxyType({})
    """Readings of all sensors, by their names in `[sensors]`."""


class Estimate(NamedTuple):
    """What the controllers believe."""

    x: float
    """CG, east [m]."""
    y: float
    """CG, north [m]."""
    yaw: float
    """Heading, or the course of R where the estimator finds that one, wrapped to (-pi, pi] [rad]."""
    speed: float
    """Velocity of R along `yaw`, negative in reverse [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    rear_x: float
    """R, east [m]."""
    rear_y: float
    """R, north [m]."""
    covariance: Array
    """Covariance of (rear_x, rear_y, yaw), shape (3, 3) [m2, m rad, rad2]."""
    nis: float = nan
    """Normalised innovation squared of the position, 2 on average if consistent; NaN without a fix [-]."""
    steer_bias: float = nan
    """What the steering angle reads beyond what the motion shows, left positive; NaN if not estimated [rad]."""
    sideslip: float = 0.0
    """Course of R less heading, where `yaw` is the course; 0 if not told apart [rad]."""
    aligned: bool = True
    """Whether the yaw has been found; until then it is what was given at the start."""
    fix_age: float = nan
    """Age of the newest fix that was accepted, time since the start before the first [s]."""
    position_sigma: float = nan
    """Standard deviation of R in the direction of its largest uncertainty [m]."""
    nis_mean: float = nan
    """NIS of the position smoothed over some seconds, 2 if consistent [-]."""


class Reference(NamedTuple):
    """The desired state of the CG at one time.

    The tractor heads along `yaw` whether it drives forward or in reverse. Its signed speed u = vx cos(yaw) + vy
    sin(yaw) is negative in reverse; the reference has no velocity across its heading. `curvature` is that of the way of
    the CG as seen along the heading, left positive, so that the yaw rate is u * curvature in both directions: wheels
    turned left mean a positive curvature, forward and in reverse. On paths without reverse driving `yaw` is the
    direction of travel. At a cusp u passes through zero while `yaw` is continuous.
    """

    x: float
    """East [m]."""
    y: float
    """North [m]."""
    vx: float
    """East velocity [m/s]."""
    vy: float
    """North velocity [m/s]."""
    yaw: float
    """Heading of the tractor, wrapped to (-pi, pi] [rad]."""
    curvature: float
    """Yaw rate over signed speed, left positive [1/m]."""
    curvature_rate: float = 0.0
    """Change of `curvature` in time; 0 at steps of the curvature and at standstill [1/(m s)]."""


class PathPoint(NamedTuple):
    """The point of a path that is nearest to a given point."""

    s: float
    """Distance along the path from its start [m]."""
    t: float
    """Time at which the reference passes [s]."""
    x: float
    """East [m]."""
    y: float
    """North [m]."""
    yaw: float
    """Heading of a tractor on the path there, wrapped to (-pi, pi] [rad]."""
    curvature: float
    """Left positive [1/m]."""
    speed: float
    """Speed of the reference along the heading, negative in reverse [m/s]."""
    offset: float
    """Signed distance of the given point from the path, left of the heading positive [m]."""
    direction: float = 1.0
    """Direction of travel there, also where the reference stands: 1 forward, -1 in reverse [-]."""


class Command(NamedTuple):
    """What a guidance law asks of the low-level loops."""

    steer: float
    """Front-wheel angle at the bicycle's virtual wheel, left positive [rad]."""
    speed: float
    """Velocity along the heading, negative in reverse [m/s]."""
    steer_voltage: float | None = None
    """Steering valve voltage of a law that drives the valve itself, bypassing the angle loop [V]."""
    pedal: float | None = None
    """Pedal position, -1 to 1, that bypasses the speed loop: a stop without a known speed [-]."""
    released: bool = False
    """Whether the pedal valve has no power, so that its spring brings the pedal back, whatever its sensor reads."""


class Drive(NamedTuple):
    """What the low-level loops send to the valves."""

    steer_voltage: float
    """Steering valve, 0-12 V, neutral at 6 V, above steers left [V]."""
    pedal_voltage: float
    """Pedal valve, 0-12 V, neutral at 6 V, above presses forward; NaN without power [V]."""
    brake: float = 0.0
    """Share of the brake's torque that is applied, 0 to 1 [-]."""

    @property
    def powered_pedal(self) -> float:
        """Voltage at the pedal valve [V]; NaN, without power, while the brake is applied: no pump drives against it."""
        return nan if self.brake > 0.0 else self.pedal_voltage
