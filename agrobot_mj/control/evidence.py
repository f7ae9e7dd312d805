"""Consistency checks of the fixes, the gyro and the inertial unit, independent of the estimator.

Position jumps and drift appear in the difference between measured positions and integrated velocities of RTK fixes,
accumulated with exponential forgetting. A repeated position of a moving tractor, or a repeated yaw rate while the
wheels turn, indicates a stuck sensor. The course of the antenna rotates with the heading: it is above the rear axle.
"""

from cmath import exp as turn
from cmath import phase
from math import atan, copysign, exp, hypot, isfinite, nan
from typing import NamedTuple

from agrobot_mj.core.geometry import to_body
from agrobot_mj.core.signals import Fix, Measurement, Quality
from agrobot_mj.machine.tractor import GRAVITY

DRIFT_TIME_S = 60.0
"""Time constant of the exponential forgetting of the drift [s]. Assumed value: white velocity noise of 3 cm/s
accumulates to 4 cm at 20 Hz and 7 cm at 5 Hz, and a drift of 7 mm/s eventually reaches the limit."""
SWAY_S, TURN_TIME_S = 2.0, 10.0
"""Short and long time constants for averaging the difference between course and gyro angle [s]. Assumed values: several
periods of the antenna oscillation; a typical gyro bias of 0.3 deg/s separates the two means by 2.4 deg."""
TILT_TIME_S = 4.0
"""Averaging time of the tilt derived from the specific force [s]. Assumed value, twice the duration of a start."""
GAP_S = 0.5
"""Maximum time between two fixes for integrating their velocities [s]. Assumed value (10 missing fixes)."""
BEND_ERROR = 0.25
"""Integration error of the velocity, divided by time step and second difference of the velocity [-]. Assumed value:
1/12 is valid only for time steps much shorter than the period of the antenna oscillation."""
MOVING_M_S = 0.4
"""Minimum speed of a moving tractor [m/s]. Assumed value: ten times the velocity noise."""
COURSE_M_S = 0.25
"""Minimum speed for computing a course from the velocity [m/s]. Assumed value: eight times the velocity noise."""
HELD_S = 5.0
"""Maximum time without a course before the gyro comparison restarts [s]. Assumed value: a typical bias adds 1.5 deg."""


class Evidence(NamedTuple):
    """Consistency of consecutive fixes."""

    fix: Fix | None = None
    """Last fix; None before the first fix."""
    t: float = 0.0
    """Time of the last fix [s]."""
    quality: int = Quality.NONE
    """Quality of the last fix."""
    since: tuple[float, float] | None = None
    """East and north position predicted from the last RTK fix by integrating velocities [m]; None after a gap."""
    east: float = 0.0
    """Accumulated east difference between RTK positions and integrated velocities [m]."""
    north: float = 0.0
    """Accumulated north difference between RTK positions and integrated velocities [m]."""
    change: tuple[float, float] = (0.0, 0.0)
    """Velocity change between the last two fixes, east and north [m/s]."""
    variance: float = 0.0
    """Variance per axis of the accumulated differences, due to velocity changes between the fixes [m2]."""
    moving: bool = False
    """Whether the tractor was moving at the last change of the position."""
    repeated_s: float = 0.0
    """Time for which the measured position has been constant while the tractor was moving [s]."""

    @property
    def drift(self) -> float:
        """Distance between the measured position and the integral of the measured velocities [m]."""
        return hypot(self.east, self.north)

    def after(self, measured: Measurement) -> "Evidence":
        """Return the evidence after a tick; unchanged without a new fix."""
        fix, last = measured.fix, self.fix
        if fix is None:
            return self
        t = fix.t if isfinite(fix.t) else measured.t
        time, speed = t - self.t, hypot(fix.vx, fix.vy)
        if last is None or time > GAP_S:
            since = (fix.x, fix.y) if measured.quality == Quality.FIX else None
            return self._with_fix(measured, fix, t, speed > MOVING_M_S, 0.0)._replace(since=since)
        if time <= 0.0:
            return self
        repeated = self.moving and (fix.x, fix.y) == (last.x, last.y)
        moving = repeated or speed > MOVING_M_S
        found = self._with_fix(measured, fix, t, moving, self.repeated_s + time if repeated else 0.0)
        return found._travelled(fix, last, time)

    def _with_fix(self, measured: Measurement, fix: Fix, t: float, moving: bool, repeated_s: float) -> "Evidence":
        return self._replace(fix=fix, t=t, quality=measured.quality, moving=moving, repeated_s=repeated_s)

    def _travelled(self, fix: Fix, last: Fix, time: float) -> "Evidence":
        """Return the evidence with the accumulated differences updated for the `time` [s] between two fixes."""
        fixed = self.quality == Quality.FIX
        if self.since is None:
            return self._replace(since=(fix.x, fix.y) if fixed else None)
        x, y = self.since[0] + 0.5 * time * (fix.vx + last.vx), self.since[1] + 0.5 * time * (fix.vy + last.vy)
        keep, change = exp(-time / DRIFT_TIME_S), (fix.vx - last.vx, fix.vy - last.vy)
        bend = hypot(change[0] - self.change[0], change[1] - self.change[1])
        found = self._replace(change=change, variance=keep * keep * self.variance + (BEND_ERROR * time * bend) ** 2)
        east, north = keep * self.east, keep * self.north
        if not fixed:
            return found._replace(since=(x, y), east=east, north=north)
        return found._replace(since=(fix.x, fix.y), east=east + fix.x - x, north=north + fix.y - y)


class GyroEvidence(NamedTuple):
    """Last measured yaw rate and the time since which the gyro has repeated it."""

    reading: float = nan
    """Last measured yaw rate; NaN without a gyro [rad/s]."""
    t: float = 0.0
    """Time of the first of the equal measurements [s]."""
    steer: float = nan
    """Measured steering angle at the first of the equal measurements [rad]."""

    def after(self, measured: Measurement) -> "GyroEvidence":
        """Return the evidence after a tick; unchanged if the gyro repeats its yaw rate."""
        if measured.gyro == self.reading:
            return self
        return GyroEvidence(measured.gyro, measured.t, measured.steer)


class AttitudeEvidence(NamedTuple):
    """Checks of the inertial unit for repeated, missing and inconsistent angles."""

    angles: tuple[float, float] = (nan, nan)
    """Last measured roll and pitch angles; NaN before the first measurement [rad]."""
    changed: tuple[bool, bool] = (False, False)
    """Whether the roll and pitch angles have changed since the first measurement."""
    repeats: tuple[float, float] = (0.0, 0.0)
    """Time for which the roll and pitch angles have been constant while the tractor was moving [s]."""
    silent_s: float = 0.0
    """Time since the last measurement of roll and pitch; 0 before the first measurement [s]."""
    residual: tuple[float, float] = (0.0, 0.0)
    """Forward and left residual of the specific force, divided by g; mean over TILT_TIME_S [-].

    The residual is the specific force without gravity at the measured angles and without centripetal acceleration.
    Averaging forces instead of tilt angles suppresses vibration.
    """

    @property
    def repeated_s(self) -> float:
        """Maximum time for which the roll or pitch angle has been constant [s]."""
        return max(self.repeats)

    @property
    def tilt(self) -> float:
        """Maximum difference between measured roll or pitch and the tilt derived from the specific force [rad]."""
        return atan(max(map(abs, self.residual)))

    def after(self, measured: Measurement, moving: bool, dt: float) -> "AttitudeEvidence":
        """Return the evidence after a tick of `dt` [s]."""
        angles = measured.roll, measured.pitch
        if not all(map(isfinite, angles)):
            known = isfinite(self.angles[0])
            return self._replace(silent_s=self.silent_s + dt if known else 0.0)
        alike = [now == last for now, last in zip(angles, self.angles, strict=True)]
        first = not isfinite(self.angles[0])
        changed = [c or not (same or first) for c, same in zip(self.changed, alike, strict=True)]
        repeats = [
            (t + dt if moving else t) if c and same else 0.0
            for t, c, same in zip(self.repeats, changed, alike, strict=True)
        ]
        weight = dt / TILT_TIME_S
        ahead, left = (
            mean + weight * (now - mean) for mean, now in zip(self.residual, _force_residual(measured), strict=True)
        )
        return AttitudeEvidence(angles, (changed[0], changed[1]), (repeats[0], repeats[1]), 0.0, (ahead, left))


def _force_residual(measured: Measurement) -> tuple[float, float]:
    """Return forward and left specific force without gravity and centripetal part, divided by g; 0 if unknown [-]."""
    unit = measured.readings.get("imu")
    x, y = getattr(unit, "force_x", nan), getattr(unit, "force_y", nan)
    if not isfinite(x + y):
        return 0.0, 0.0
    bend = measured.wheel_speed * measured.gyro
    ahead, left, _ = to_body(measured.roll, measured.pitch, (0.0, 0.0, 1.0))
    return x / GRAVITY - ahead, (y - (bend if isfinite(bend) else 0.0)) / GRAVITY - left


class TurnEvidence(NamedTuple):
    """Rotation of the fixes' course relative to the gyro: short-term mean minus long-term mean.

    Velocity vectors rotated back by the gyro angle are averaged, so that the antenna oscillation cancels. Only RTK
    fixes of a moving tractor are used; each contributes at most GAP_S and is valid for HELD_S.
    """

    t: float = 0.0
    """Time of the last valid fix [s]."""
    turned: float = 0.0
    """Integral of the measured yaw rate [rad]."""
    known_s: float = 0.0
    """Time covered by valid fixes [s]."""
    late: complex = 0j
    """Mean over SWAY_S of the velocity rotated back by the gyro angle; 0 before the first fix [m/s]."""
    long: complex = 0j
    """Mean over TURN_TIME_S of the velocity rotated back by the gyro angle [m/s]."""

    @property
    def difference(self) -> float:
        """Absolute angle between the short-term and long-term mean velocities [rad]."""
        return abs(phase(self.late * self.long.conjugate()))

    def after(self, measured: Measurement, dt: float) -> "TurnEvidence":
        """Return the evidence after a tick of `dt` [s]; restart without a gyro or HELD_S after the last valid fix."""
        fix, turned, time = measured.fix, self.turned + measured.gyro * dt, measured.t - self.t
        if turned != turned or (time > HELD_S and self.known_s > 0.0):
            return TurnEvidence(measured.t)
        if fix is None or measured.quality != Quality.FIX or hypot(fix.vx, fix.vy) <= COURSE_M_S:
            return self._replace(turned=turned)
        latency = measured.t - fix.t if isfinite(fix.t) else 0.0
        ahead = copysign(1.0, measured.wheel_speed if isfinite(measured.wheel_speed) else measured.pedal)
        velocity = ahead * complex(fix.vx, fix.vy) * turn(-1j * (turned - latency * measured.gyro))
        if not self.late:
            return TurnEvidence(measured.t, turned, 0.0, velocity, velocity)
        step = min(time, GAP_S)
        known = self.known_s + step
        late = self.late + (velocity - self.late) * step / min(known, SWAY_S)
        long = self.long + (velocity - self.long) * step / min(known, TURN_TIME_S)
        return TurnEvidence(measured.t, turned, known, late, long)
