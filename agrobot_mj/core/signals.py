"""Messages between the stages of one tick, in SI units and radians.

Frames: ENU (x east, y north, z up); yaw from east, counter-clockwise; vehicle axes as in ISO 8855 (x forward, y left, z
up). Steering, yaw rate and lateral velocity are positive to the left. Pitch is positive with the nose down, and roll
with the left side up.
"""

from collections.abc import Mapping
from math import nan
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

TICK_S = 0.05
"""Duration of a tick, the sampling period of sensors and controllers, T_s in the paper [s]."""
ROUNDING_S = 1e-6
"""Tolerance in comparisons of times [s], well above rounding errors and well below a tick."""
NEUTRAL_V = 6.0
"""Valve voltage at which no oil flows [V]. The paper gives the range 0-12 V."""

WHEELS = ("fl", "fr", "rl", "rr")
"""Order of the wheels in all arrays: front left, front right, rear left, rear right."""

Outcome = Literal[
    "completed", "unfinished", "stopped", "rolled_over", "diverged", "left_terrain", "stuck", "jackknifed", "aborted",
    "host_lost", "not_engaged", "latched",
]  # fmt: skip
"""Possible outcomes of a run. For guidance along a path, `completed` means that the path was followed to its end."""

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Vector = np.ndarray[tuple[int], np.dtype[np.float64]]
Matrix = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""Types `Vector` and `Matrix`: C-contiguous arrays of floats with one and two dimensions, for compiled code."""
Index = np.ndarray[tuple[int], np.dtype[np.int64]]


class Column(NamedTuple):
    """Column of the log, which contains one signal."""

    name: str
    unit: str
    """SI unit of the signal. Angles are in rad, and dimensionless signals have the unit "-"."""
    description: str
    """Description of the signal in one line: quantity, frame and sign."""
    drawn: bool = True
    """Whether recordings plot the signal separately if no other plot contains it. The log contains all signals."""


class Truth(NamedTuple):
    """True state of the plant at time `t`; only sensors, logs and metrics may use it."""

    t: float
    """Time since the start [s]."""
    x: float
    """East coordinate of the CG [m]."""
    y: float
    """North coordinate of the CG [m]."""
    z: float
    """Vertical coordinate of the CG [m], positive upwards."""
    yaw: float
    """Heading [rad], counter-clockwise from east, wrapped to (-pi, pi]."""
    pitch: float
    """Pitch [rad], positive with the nose down."""
    roll: float
    """Roll [rad], positive with the left side up."""
    speed: float
    """Velocity of the CG along the heading, u in the paper [m/s]."""
    lateral_speed: float
    """Velocity of the CG to the left of the heading, v in the paper [m/s]."""
    yaw_rate: float
    """Yaw rate, gamma in the paper [rad/s], positive to the left."""
    steer: float
    """Steering angle of the virtual front wheel of the bicycle model [rad], positive to the left."""
    pedal: float
    """Position of the drive pedal from -1 (full reverse) to 1 (full forward) [-]."""
    rear_x: float
    """East coordinate of the rear-axle point R [m], which is on the ground below the centre of the rear axle."""
    rear_y: float
    """North coordinate of the rear-axle point R [m]."""
    antenna: tuple[float, float, float]
    """Position of the GNSS antenna in ENU coordinates [m]."""
    antenna_velocity: tuple[float, float, float]
    """Velocity of the GNSS antenna in ENU axes [m/s]."""
    steer_samples: Vector
    """Steering angle after each physics step of the last tick [rad], oldest first, shape (n,)."""
    pedal_samples: Vector
    """Pedal position after each physics step of the last tick [-], oldest first, shape (n,)."""
    wheel_speed: float = nan
    """Mean circumferential speed of the rear wheels [m/s]: angular velocity times free radius, positive forward."""
    body_rates: tuple[float, float, float] = (nan, nan, nan)
    """Angular velocity in chassis axes (x forward, y left, z up) [rad/s]."""
    knuckle_samples: Matrix = np.zeros((2, 0))
    """Steering angles of the left and right front wheel after each physics step of the last tick, shape (2, n) [rad],
    or an empty array for a plant without steering knuckles."""
    rear_velocity: tuple[float, float, float] = (nan, nan, nan)
    """Velocity of the rear-axle point R in ENU axes [m/s]."""
    implement: tuple[float, float] = (nan, nan)
    """Position (east, north) of the implement's working point [m], or NaN if there is no implement."""


class Fix(NamedTuple):
    """GNSS solution: position and velocity of the antenna, and optionally the heading measured with two antennas."""

    x: float
    """East coordinate of the antenna [m]."""
    y: float
    """North coordinate of the antenna [m]."""
    vx: float
    """East velocity of the antenna [m/s]."""
    vy: float
    """North velocity of the antenna [m/s]."""
    t: float = nan
    """Time of validity of the solution since the start of the run [s], or NaN if the receiver does not report it."""
    z: float = nan
    """Height of the antenna [m], or NaN if the receiver does not report the height."""
    heading: float = nan
    """Heading measured with two antennas [rad], counter-clockwise from east, or NaN if not measured or ambiguous."""


NO_FIX = Fix(nan, nan, nan, nan)
"""Fix with NaN in all fields, which represents a missing fix in compiled code."""


class Quality:
    """Quality of a GNSS solution, as in the column `gnss_quality`. DGPS (corrected code) is worse than FLOAT."""

    NONE, FLOAT, FIX, DGPS = range(4)


def worse(a: int, b: int) -> int:
    """Return the worse of two GNSS qualities."""
    return min(a, b, key=(Quality.NONE, Quality.DGPS, Quality.FLOAT, Quality.FIX).index)


class PointMass(NamedTuple):
    """Point mass attached to the chassis."""

    kg: float
    """Mass [kg], negative for removed ballast."""
    ahead: float
    """Distance ahead of the rear-axle point R on the ground [m]."""
    left: float
    """Distance to the left of the rear-axle point R [m]."""
    up: float
    """Height above the rear-axle point R [m]."""


class Distortion(NamedTuple):
    """Distortion of a measurement or a valve voltage on a faulty signal line. By default the signal is unchanged."""

    scale: float = 1.0
    """Transmitted signal divided by the true signal [-]; negative for a reversed sign."""
    offset: float = 0.0
    """Offset added to the scaled signal, in the unit of the signal."""
    delay_s: float = 0.0
    """Delay of the signal [s], a whole number of ticks."""
    stuck: Literal["", "last", "zero"] = ""
    """Value transmitted by a stuck line: its `last` value or `zero`; an empty string for a line that is not stuck."""
    lost: bool = False
    """Whether the signal is lost, so that the received value is NaN."""


SOUND = Distortion()

Frozen = Literal["", "nothing", "velocity", "live_velocity"]
"""Velocity from a receiver with a frozen position: zero, last or true velocity; "" for an intact receiver."""


class Conditions(NamedTuple):
    """Faults and disturbances that act in one tick. By default no fault is active."""

    gnss_quality: int = Quality.FIX
    """Maximum quality of the GNSS solution permitted by faults, a constant of `Quality`."""
    gnss_latency_s: float = 0.0
    """Additional latency of the GNSS receiver [s], a whole number of ticks."""
    gnss_offset: tuple[float, float] = (0.0, 0.0)  # Offset of the position of the solution, east and north [m]
    gnss_velocity_offset: tuple[float, float] = (0.0, 0.0)  # Offset of the velocity, east and north [m/s]
    gnss_frozen: Frozen = ""
    """Velocity from a receiver whose position is frozen (see `Frozen`), or "" if the position is not frozen."""
    heading: Distortion = SOUND  # Distortion of the heading measured by two antennas [rad]
    gyro: Distortion = SOUND  # Distortion of the yaw rate measured by the gyro [rad/s]
    wheel_speed: Distortion = SOUND  # Distortion of the measured wheel speed [m/s]
    steering_pot: Distortion = SOUND  # Distortion of the measured steering angle [rad]
    pedal_pot: Distortion = SOUND  # Distortion of the measured pedal position [-]
    imu_roll: Distortion = SOUND  # Distortion of the roll measured by the inertial unit [rad]
    imu_pitch: Distortion = SOUND  # Distortion of the pitch measured by the inertial unit [rad]
    valve: Distortion = SOUND  # Distortion of the voltage at the steering valve, relative to neutral [V]
    pedal_valve: Distortion = SOUND  # Distortion of the voltage at the pedal valve, relative to neutral [V]
    valve_gain: float = 1.0
    """Flow of the steering valve divided by its flow without a fault [-]."""
    valve_dead_band: float = 0.0
    """Increase in the half width of the steering valve's dead band [V]."""
    payload: tuple[PointMass, ...] = ()
    drawbar: float = 0.0
    """Drawbar pull of an implement at the hitch [N], against the direction of motion."""
    side_force: float = 0.0
    """Horizontal force on the CG [N], positive to the left of the heading."""
    grip: float = 1.0
    """Factor applied to the friction coefficient of the ground under all wheels [-]."""
    tyre_stiffness: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Vertical and slip stiffness of the tyres fl, fr, rl, rr, divided by their stiffness without a fault [-]."""
    tyre_rolling: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Factors applied to the rolling resistance of the tyres fl, fr, rl, rr [-]."""


NOMINAL = Conditions()


class Measurement(NamedTuple):
    """Measurements available to the controllers in one tick."""

    t: float
    """Time since the start [s]."""
    fix: Fix | None
    """GNSS solution delivered in this tick, or None if no solution was delivered."""
    quality: int
    """Quality of the most recently delivered GNSS solution, a constant of `Quality`."""
    steer: float
    """Filtered steering angle from the potentiometer [rad], positive to the left."""
    pedal: float
    """Filtered pedal position from the potentiometer [-], from -1 (full reverse) to 1 (full forward)."""
    gyro: float
    """Yaw rate from the gyro [rad/s], positive to the left, or NaN if not measured."""
    roll: float = nan  # Roll from the inertial unit [rad], left side up positive, or NaN if not measured
    pitch: float = nan  # Pitch from the inertial unit [rad], nose down positive, or NaN if not measured
    wheel_speed: float = nan
    """Speed of the driven wheels from their sensor [m/s], positive when driving forward, or NaN if not measured."""
    readings: Mapping[str, Any] = MappingProxyType({})
    """Measurements of all sensors by sensor name, as in the scenario table `[sensors]`."""


class Estimate(NamedTuple):
    """Estimated vehicle state used by the controllers."""

    x: float
    """East coordinate of the CG [m]."""
    y: float
    """North coordinate of the CG [m]."""
    yaw: float
    """Heading, or course of the rear-axle point R for an estimator of the course [rad], wrapped to (-pi, pi]."""
    speed: float
    """Velocity of the rear-axle point R along `yaw`, negative in reverse [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s], positive to the left."""
    rear_x: float
    """East coordinate of the rear-axle point R [m]."""
    rear_y: float
    """North coordinate of the rear-axle point R [m]."""
    covariance: Array
    """Covariance of (rear_x, rear_y, yaw), shape (3, 3) [m2, m rad, rad2]."""
    nis: float = nan
    """Normalised innovation squared (NIS) of the position [-], NaN without a fix. The mean for a consistent filter is
    2."""
    steer_bias: float = nan
    """Bias of the measured steering angle [rad], positive to the left: measured angle minus the angle that explains
    the motion. NaN if not estimated."""
    sideslip: float = 0.0
    """Course of the rear-axle point R minus the heading [rad]; 0 if `yaw` is the heading, or if not identifiable."""
    aligned: bool = True
    """Whether the filter has determined the yaw. Before this alignment `yaw` is the initial value."""
    fix_age: float = nan
    """Time since the newest accepted fix or, before the first fix, since the start [s]."""
    position_sigma: float = nan
    """Standard deviation of the position of the rear-axle point R in the direction of maximum uncertainty [m]."""
    nis_mean: float = nan
    """Normalised innovation squared of the position [-], smoothed over several seconds; about 2 for a consistent
    filter."""


class Reference(NamedTuple):
    """Desired state of the tractor's centre of gravity (CG) at one time.

    `yaw` is the heading of the tractor, forward and in reverse. The signed speed u = vx cos(yaw) + vy sin(yaw) along
    the heading is negative in reverse, and the velocity across the heading is zero. `curvature` is the yaw rate divided
    by u: wheels turned to the left give a positive curvature, forward and in reverse. Without reverse driving `yaw` is
    the direction of travel. At a cusp (reversal) u passes through zero while `yaw` is continuous.
    """

    x: float
    """East coordinate of the CG [m]."""
    y: float
    """North coordinate of the CG [m]."""
    vx: float
    """East velocity of the CG [m/s]."""
    vy: float
    """North velocity of the CG [m/s]."""
    yaw: float
    """Heading of the tractor, wrapped to (-pi, pi] [rad]."""
    curvature: float
    """Yaw rate divided by signed speed [1/m], positive to the left."""
    curvature_rate: float = 0.0
    """Time derivative of `curvature` [1/(m s)]; 0 at standstill and where the curvature is discontinuous."""


class PathPoint(NamedTuple):
    """Point of a path, for example the point nearest to the tractor."""

    s: float
    """Arc length from the start of the path to the point [m]."""
    t: float
    """Time at which the reference motion passes the point [s]."""
    x: float
    """East coordinate of the path point [m]."""
    y: float
    """North coordinate of the path point [m]."""
    yaw: float
    """Heading of a tractor on the path at this point, wrapped to (-pi, pi] [rad]."""
    curvature: float
    """Curvature of the path at this point [1/m], positive to the left."""
    speed: float
    """Speed of the reference motion along the heading [m/s], negative in reverse."""
    offset: float
    """Signed distance of the query point from the path [m], positive to the left of the path heading."""
    direction: float = 1.0
    """Direction of travel [-]: 1 forward, -1 in reverse; also defined where the reference motion is at rest."""


class Command(NamedTuple):
    """Command of a guidance law to the steering loop and the speed loop."""

    steer: float
    """Commanded angle of the virtual front wheel of the bicycle model [rad], positive to the left."""
    speed: float
    """Commanded velocity along the heading [m/s], negative in reverse."""
    steer_voltage: float | None = None
    """Voltage of the steering valve [V] from a guidance law that bypasses the steering loop, otherwise None."""
    pedal: float | None = None
    """Pedal position from -1 to 1 [-] that bypasses the speed loop to stop at unknown speed, otherwise None."""
    released: bool = False
    """Whether the pedal valve is unpowered, so that a spring returns the pedal independently of the pedal sensor."""


class Drive(NamedTuple):
    """Commands of the steering loop and the speed loop to the valves and the brake."""

    steer_voltage: float
    """Steering valve voltage [V] from 0 to 12, neutral at 6. Voltages above 6 steer to the left."""
    pedal_voltage: float
    """Pedal valve voltage [V] from 0 to 12, neutral at 6, or NaN without power. Voltages above 6 drive forward."""
    brake: float = 0.0
    """Brake torque divided by its maximum, from 0 to 1 [-]."""

    @property
    def powered_pedal(self) -> float:
        """Pedal valve voltage [V], or NaN (no power) while braking, so that the drive does not oppose the brake."""
        return nan if self.brake > 0.0 else self.pedal_voltage
