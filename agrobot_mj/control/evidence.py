"""Consistency checks of GNSS fixes, gyro and inertial unit, independent of the estimator.

Position jumps and drift appear in the difference between measured positions and integrated velocities of RTK fixes,
accumulated with exponential forgetting. A repeated position of a moving tractor, or a repeated yaw rate while the
wheels turn, indicates a stuck sensor. The antenna is above the rear axle, so that its course rotates with the heading.
"""

from cmath import exp as turn
from cmath import phase
from math import atan, copysign, exp, isfinite, isnan, nan, sqrt
from typing import NamedTuple

from agrobot_mj.core.geometry import to_body
from agrobot_mj.core.kernels import kernel_method, shared
from agrobot_mj.core.signals import NO_FIX, Fix, Measurement, Quality
from agrobot_mj.machine.tractor import GRAVITY

DRIFT_TIME_S = 60.0
"""Time constant of the exponential forgetting of the drift [s]. Assumed value: white velocity noise of 3 cm/s causes an
accumulated error of 4 cm at 20 Hz and 7 cm at 5 Hz. A drift of 7 mm/s eventually reaches the limit."""
SWAY_S, TURN_TIME_S = 2.0, 10.0
"""Short and long time constants [s] for averaging the difference between course and gyro angle. Assumed values: the
short time covers several oscillations of the antenna; a gyro bias of 0.3 deg/s separates the two means by 2.4 deg."""
TILT_TIME_S = 4.0
"""Averaging time of the tilt derived from the specific force [s]. Assumed value: twice the typical duration of an
acceleration."""
GAP_S = 0.5
"""Maximum time between two fixes over which their velocities are integrated [s]. Assumed value: 10 periods at 20 Hz."""
BEND_ERROR = 0.25
"""Error of the velocity integration, divided by the time step and the second difference of the velocity [-]. Assumed
value, above the theoretical value of 1/12 for time steps much shorter than the antenna oscillation."""
MOVING_M_S = 0.4  # Minimum speed of a moving tractor [m/s]. Assumed value: 13 times the velocity noise.
COURSE_M_S = 0.25
"""Minimum fix speed for deriving a course from the velocity [m/s]. Assumed value: eight times the velocity noise."""
HELD_S = 5.0
"""Time without a valid course after which the gyro comparison restarts [s]. Assumed value: a gyro bias of 0.3 deg/s
then causes an angle error of 1.5 deg."""


RTK_FIXED = Quality.FIX  # Quality of an RTK-fixed GNSS solution, as an integer for compiled kernels


class Sensed(NamedTuple):
    """Measurements of a tick except the GNSS fix, as numbers for compiled kernels; a missing measurement is NaN."""

    t: float  # Time since the start [s]
    steer: float  # Measured steering angle [rad]
    pedal: float  # Measured pedal position [-]
    gyro: float  # Yaw rate measured by the gyro [rad/s]
    roll: float  # Roll measured by the inertial unit [rad]
    pitch: float  # Pitch measured by the inertial unit [rad]
    wheel_speed: float  # Measured wheel speed [m/s]
    specific_force: tuple[float, float, float]  # Specific force from the inertial unit [m/s2], forward, left and up


def sensor_numbers(m: Measurement) -> tuple[Sensed, Fix, int]:
    """Return numbers for compiled kernels: the measurements of a tick, and separately the fix (NaN if missing) and its
    quality."""
    unit = m.readings.get("imu")
    force = (nan, nan, nan) if unit is None else tuple(getattr(unit, f"force_{axis}", nan) for axis in "xyz")
    sensed = Sensed(m.t, m.steer, m.pedal, m.gyro, m.roll, m.pitch, m.wheel_speed, force)  # type: ignore[arg-type]
    return sensed, m.fix or NO_FIX, m.quality


class Evidence(NamedTuple):
    """State of the consistency checks of consecutive fixes."""

    fix: Fix = NO_FIX  # Last fix, or NaN before the first fix
    t: float = 0.0  # Time of the last fix [s]
    since: tuple[float, float] = (nan, nan)
    """East and north position predicted from the last RTK fix by integrating velocities [m], or NaN after a gap."""
    east: float = 0.0  # Accumulated east difference between RTK positions and integrated velocities [m]
    north: float = 0.0  # Accumulated north difference between RTK positions and integrated velocities [m]
    change: tuple[float, float] = (0.0, 0.0)  # Velocity change between the last two fixes [m/s], east and north
    variance: float = 0.0
    """Variance per axis of `east` and `north` due to errors of the integration between fixes [m2]."""
    moving: bool = False  # Whether the tractor was moving at the last change of the position
    repeated_s: float = 0.0  # Time for which the measured position has been constant while the tractor was moving [s]

    def after(self, m: Sensed, fix: Fix, quality: int) -> "Evidence":
        """Return the state of the checks after a tick, or the unchanged state if the tick has no new fix."""
        last, t, fixed = self.fix, fix.t if isfinite(fix.t) else m.t, quality == RTK_FIXED
        time, speed = t - self.t, sqrt(fix.vx * fix.vx + fix.vy * fix.vy)
        if isnan(fix.x) or (not isnan(last.x) and time <= 0.0):
            return self
        here = (fix.x, fix.y) if fixed else (nan, nan)
        if isnan(last.x) or time > GAP_S:
            moving = speed > MOVING_M_S
            return Evidence(fix, t, here, self.east, self.north, self.change, self.variance, moving, 0.0)
        repeated = self.moving and fix.x == last.x and fix.y == last.y
        moving, repeated_s = repeated or speed > MOVING_M_S, self.repeated_s + time if repeated else 0.0
        if isnan(self.since[0]):
            return Evidence(fix, t, here, self.east, self.north, self.change, self.variance, moving, repeated_s)
        x, y = self.since[0] + 0.5 * time * (fix.vx + last.vx), self.since[1] + 0.5 * time * (fix.vy + last.vy)
        keep, change = exp(-time / DRIFT_TIME_S), (fix.vx - last.vx, fix.vy - last.vy)
        bend_x, bend_y = change[0] - self.change[0], change[1] - self.change[1]
        bent = BEND_ERROR * time * sqrt(bend_x * bend_x + bend_y * bend_y)
        variance, east, north = keep * keep * self.variance + bent * bent, keep * self.east, keep * self.north
        if not fixed:
            return Evidence(fix, t, (x, y), east, north, change, variance, moving, repeated_s)
        return Evidence(fix, t, here, east + fix.x - x, north + fix.y - y, change, variance, moving, repeated_s)


class GyroEvidence(NamedTuple):
    """State of the check for repeated yaw rates: the last measured yaw rate and the time of its first occurrence."""

    reading: float = nan  # Last measured yaw rate [rad/s], or NaN if there is no gyro
    t: float = 0.0  # Time of the first measurement of the repeated yaw rate [s]
    steer: float = nan  # Measured steering angle at the first measurement of the repeated yaw rate [rad]

    def after(self, m: Sensed) -> "GyroEvidence":
        """Return the state of the check after a tick, or the unchanged state if the gyro repeats its yaw rate."""
        return self if m.gyro == self.reading else GyroEvidence(m.gyro, m.t, m.steer)


class AttitudeEvidence(NamedTuple):
    """State of the checks for repeated, missing and inconsistent angles of the inertial unit."""

    angles: tuple[float, float] = (nan, nan)
    """Last measured roll and pitch angles [rad], or NaN before the first measurement."""
    changed: tuple[bool, bool] = (False, False)
    """Whether the roll angle and the pitch angle have changed since their first measurements."""
    repeats: tuple[float, float] = (0.0, 0.0)
    """Time for which the roll angle and the pitch angle have each been constant while the tractor was moving [s]."""
    silent_s: float = 0.0  # Time since the last measurement of roll and pitch [s], or 0 before the first measurement
    residual: tuple[float, float] = (0.0, 0.0)
    """Forward and left residual of the specific force divided by g [-], averaged over TILT_TIME_S.

    The residual is the specific force without its parts due to gravity (at the measured angles) and centripetal
    acceleration. Averaging forces instead of tilt angles suppresses vibration.
    """

    def after(self, m: Sensed, moving: bool, dt: float) -> "AttitudeEvidence":
        """Return the state after a tick of `dt` [s]. Constant angles count as repeated only if `moving`."""
        first = not isfinite(self.angles[0])
        if not isfinite(m.roll + m.pitch):
            silent_s = 0.0 if first else self.silent_s + dt
            return AttitudeEvidence(self.angles, self.changed, self.repeats, silent_s, self.residual)
        same = m.roll == self.angles[0], m.pitch == self.angles[1]
        changed = self.changed[0] or not (same[0] or first), self.changed[1] or not (same[1] or first)
        step, weight, now = dt if moving else 0.0, dt / TILT_TIME_S, _force_residual(m)
        repeats = (
            self.repeats[0] + step if changed[0] and same[0] else 0.0,
            self.repeats[1] + step if changed[1] and same[1] else 0.0,
        )
        ahead = self.residual[0] + weight * (now[0] - self.residual[0])
        left = self.residual[1] + weight * (now[1] - self.residual[1])
        return AttitudeEvidence((m.roll, m.pitch), changed, repeats, 0.0, (ahead, left))


@shared
def _force_residual(m: Sensed) -> tuple[float, float]:
    x, y, _ = m.specific_force
    if not isfinite(x + y):
        return 0.0, 0.0
    bend = m.wheel_speed * m.gyro
    ahead, left, _ = to_body(m.roll, m.pitch, (0.0, 0.0, 1.0))
    return x / GRAVITY - ahead, (y - (bend if isfinite(bend) else 0.0)) / GRAVITY - left


class TurnEvidence(NamedTuple):
    """State of the course check: short-term and long-term means of the fix velocity in the frame of the gyro angle.

    Velocity vectors are rotated back by the gyro angle and averaged, so that the antenna oscillation cancels. Only RTK
    fixes of a moving tractor are used, weighted with the time since the previous fix (at most GAP_S).
    """

    t: float = 0.0  # Time of the last valid fix [s]
    turned: float = 0.0  # Integral of the measured yaw rate [rad]
    known_s: float = 0.0  # Time covered by valid fixes [s]
    late: complex = 0j
    """Fix velocity rotated back by the gyro angle `turned`, mean over SWAY_S [m/s]; 0 before the first valid fix."""
    long: complex = 0j  # Fix velocity rotated back by the gyro angle `turned`, mean over TURN_TIME_S [m/s]

    def after(self, m: Sensed, fix: Fix, quality: int, dt: float) -> "TurnEvidence":
        """Return the state after a tick of `dt` [s]. The means restart if the gyro is missing or HELD_S after the last
        valid fix."""
        turned, time = self.turned + m.gyro * dt, m.t - self.t
        if isnan(turned) or (time > HELD_S and self.known_s > 0.0):
            return TurnEvidence(m.t, 0.0, 0.0, 0j, 0j)
        speed = sqrt(fix.vx * fix.vx + fix.vy * fix.vy)
        if isnan(speed) or quality != RTK_FIXED or speed <= COURSE_M_S:
            return TurnEvidence(self.t, turned, self.known_s, self.late, self.long)
        latency = m.t - fix.t if isfinite(fix.t) else 0.0
        ahead = copysign(1.0, m.wheel_speed if isfinite(m.wheel_speed) else m.pedal)
        velocity = ahead * complex(fix.vx, fix.vy) * turn(-1j * (turned - latency * m.gyro))
        if self.late == 0j:
            return TurnEvidence(m.t, turned, 0.0, velocity, velocity)
        step = min(time, GAP_S)
        known = self.known_s + step
        late = self.late + (velocity - self.late) * step / min(known, SWAY_S)
        long = self.long + (velocity - self.long) * step / min(known, TURN_TIME_S)
        return TurnEvidence(m.t, turned, known, late, long)


kernel_method("after")


@shared
def drift_of(evidence: Evidence) -> float:
    """Return the accumulated distance [m] between measured positions and positions integrated from fix velocities."""
    return sqrt(evidence.east * evidence.east + evidence.north * evidence.north)


@shared
def tilt_error(attitude: AttitudeEvidence) -> float:
    """Return the larger of the roll and pitch errors [rad], relative to the tilt derived from the specific force."""
    return atan(max(abs(attitude.residual[0]), abs(attitude.residual[1])))


@shared
def course_error(turn: TurnEvidence) -> float:
    """Return the absolute angle [rad] between the short-term and long-term means of the fix velocity."""
    return abs(phase(turn.late * turn.long.conjugate()))
