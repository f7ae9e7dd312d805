"""Evidence for the supervisor that needs no estimator: what fixes and the gyro say of themselves.

Position less travelled velocity is a sum that forgets what lies behind; a receiver that jumps or drifts does not keep
it small, where it claims to be fixed. And a position that a moving tractor is given twice, to the last digit, is an old
one, whatever quality it claims; so is a yaw rate while the wheels turn. SI units.
"""

from math import exp, hypot, isfinite, nan
from typing import NamedTuple

from agrobot_mj.core.signals import Fix, Measurement, Quality

DRIFT_TIME_S = 20.0
"""Time in which the sum forgets [s]. Estimate: 3 cm/s of white velocity noise grow to 3 cm in it."""
GAP_S = 0.5
"""Time between two fixes beyond which nothing is known of the way between them [s]. Estimate: ten lost fixes."""
MOVING_M_S = 0.4
"""Speed from which on a tractor moves: ten times the noise of a velocity [m/s]. Estimate."""


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
