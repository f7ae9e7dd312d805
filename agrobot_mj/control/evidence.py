"""Evidence for the supervisor that needs no estimator: what fixes and the gyro say of themselves.

Position less travelled velocity is a sum that forgets what lies behind; a receiver that jumps or drifts does not keep
it small, where it claims to be fixed. And a position that a moving tractor is given twice, to the last digit, is an old
one, whatever quality it claims; so is a yaw rate while the wheels turn. The antenna is above the rear axle: its course
turns as the tractor does. SI units.
"""

from math import atan2, exp, hypot, isfinite, nan, pi, remainder
from typing import NamedTuple

from agrobot_mj.core.signals import Fix, Measurement, Quality

DRIFT_TIME_S = 20.0
"""Time in which the sum forgets [s]. Estimate: 3 cm/s of white velocity noise grow to 3 cm in it."""
SWAY_S, TURN_TIME_S = 2.0, 10.0
"""Times over which the difference of turns is averaged [s]. Estimates: some swings of the antenna; with a usual bias of
0.3 deg/s the means are 2.4 deg apart."""
GAP_S = 0.5
"""Time between two fixes beyond which nothing is known of the way between them [s]. Estimate: ten lost fixes."""
MOVING_M_S = 0.4
"""Speed from which on a tractor moves: ten times the noise of a velocity [m/s]. Estimate."""
COURSE_M_S = 0.25
"""Speed from which on a velocity has a course: eight times its noise [m/s]. Estimate."""
HELD_S = 5.0
"""Time without a course for which turns remain comparable: a usual bias adds 1.5 deg [s]. Estimate."""


class Evidence(NamedTuple):
    """Consistency of the newest fixes with each other."""

    fix: Fix | None = None
    """Last fix; None before the first."""
    t: float = 0.0
    """Time of that fix [s]."""
    quality: int = Quality.NONE
    """Quality of that fix."""
    east: float = 0.0
    """Position less travelled velocity, east [m]."""
    north: float = 0.0
    """Position less travelled velocity, north [m]."""
    moving: bool = False
    """Whether the tractor was moving when the position last changed."""
    repeated_s: float = 0.0
    """Time for which the position has not changed although the tractor was moving [s]."""

    @property
    def drift(self) -> float:
        """Distance between the position and the integral of the fixes' velocities [m]."""
        return hypot(self.east, self.north)

    def after(self, measured: Measurement) -> "Evidence":
        """Evidence after a tick; one without a new fix changes nothing."""
        fix, last = measured.fix, self.fix
        if fix is None:
            return self
        t = fix.t if isfinite(fix.t) else measured.t
        time, speed = t - self.t, hypot(fix.vx, fix.vy)
        if last is None or time > GAP_S:
            return Evidence(fix, t, measured.quality, moving=speed > MOVING_M_S)
        if time <= 0.0:
            return self
        repeated = self.moving and (fix.x, fix.y) == (last.x, last.y)
        found = Evidence(
            fix=fix,
            t=t,
            quality=measured.quality,
            moving=repeated or speed > MOVING_M_S,
            repeated_s=self.repeated_s + time if repeated else 0.0,
        )
        if not self.quality == measured.quality == Quality.FIX:
            return found
        keep = exp(-time / DRIFT_TIME_S)
        return found._replace(
            east=keep * self.east + fix.x - last.x - 0.5 * time * (fix.vx + last.vx),
            north=keep * self.north + fix.y - last.y - 0.5 * time * (fix.vy + last.vy),
        )


class GyroEvidence(NamedTuple):
    """Since when the gyro gives the reading that it gives."""

    reading: float = nan
    """Last reading; NaN without one [rad/s]."""
    t: float = 0.0
    """Time of the first of the readings that are alike [s]."""
    steer: float = nan
    """Measured steering angle at that time [rad]."""

    def after(self, measured: Measurement) -> "GyroEvidence":
        """Evidence after a tick; one with the same reading changes nothing."""
        if measured.gyro == self.reading:
            return self
        return GyroEvidence(measured.gyro, measured.t, measured.steer)


class TurnEvidence(NamedTuple):
    """What the course of the fixes turns beside the gyro: its mean of late over one of longer.

    What is known holds for HELD_S without a fix of good quality in motion; a fix counts for GAP_S at most.
    """

    t: float = 0.0
    """Time of the last such fix [s]."""
    turned: float = 0.0
    """Integral of the gyro [rad]."""
    difference: float = nan
    """Course of that fix less what the gyro had turned when it was taken; NaN before the first [rad]."""
    known_s: float = 0.0
    """Time for which the fixes count [s]."""
    late: float = 0.0
    """Mean of the difference over SWAY_S [rad]."""
    long: float = 0.0
    """Its mean over TURN_TIME_S [rad]."""

    @property
    def apart(self) -> float:
        """How far course and gyro have turned apart [rad]."""
        return abs(self.late - self.long)

    def after(self, measured: Measurement, dt: float) -> "TurnEvidence":
        """Evidence after a tick of `dt` [s]; it starts over without gyro, and after HELD_S."""
        fix, turned, time = measured.fix, self.turned + measured.gyro * dt, measured.t - self.t
        if turned != turned or (time > HELD_S and self.known_s > 0.0):
            return TurnEvidence(measured.t)
        if fix is None or measured.quality != Quality.FIX or hypot(fix.vx, fix.vy) <= COURSE_M_S:
            return self._replace(turned=turned)
        age = measured.t - fix.t if isfinite(fix.t) else 0.0
        difference = atan2(fix.vy, fix.vx) - turned + age * measured.gyro
        if self.difference != self.difference:
            return TurnEvidence(measured.t, turned, difference, 0.0, difference, difference)
        # in reverse the course is half a turn off
        difference = self.difference + remainder(difference - self.difference, pi)
        step = min(time, GAP_S)
        known = self.known_s + step
        late = self.late + (difference - self.late) * step / min(known, SWAY_S)
        long = self.long + (difference - self.long) * step / min(known, TURN_TIME_S)
        return TurnEvidence(measured.t, turned, difference, known, late, long)
