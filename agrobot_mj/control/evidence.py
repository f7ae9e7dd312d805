"""Evidence for the supervisor that needs no estimator: what fixes and the gyro say of themselves.

Position less travelled velocity is a sum that forgets what lies behind; a receiver that jumps or drifts does not keep
it small, where it claims to be fixed. And a position that a moving tractor is given twice, to the last digit, is an old
one, whatever quality it claims; so is a yaw rate while the wheels turn. The antenna is above the rear axle: its course
turns as the tractor does. SI units.
"""

from cmath import exp as turn
from cmath import phase
from math import atan, copysign, exp, hypot, isfinite, nan
from typing import NamedTuple

from agrobot_mj.core.geometry import to_body
from agrobot_mj.core.signals import Fix, Measurement, Quality
from agrobot_mj.machine.tractor import GRAVITY

DRIFT_TIME_S = 60.0
"""Time in which the sum forgets [s]. Assumed value: 3 cm/s of white velocity noise grow to 4 cm in it at 20 Hz, to 7 cm
at 5 Hz; a drift of 7 mm/s is as large as the limit in the end."""
SWAY_S, TURN_TIME_S = 2.0, 10.0
"""Times over which the difference of turns is averaged [s]. Assumed values: some swings of the antenna; with a usual
bias of
0.3 deg/s the means are 2.4 deg apart."""
TILT_TIME_S = 4.0
"""Time over which the tilt that the specific force shows is averaged [s]. Assumed value: twice as long as a tractor
takes to pick up speed."""
GAP_S = 0.5
"""Time between two fixes beyond which their velocities do not show the way between them [s]. Assumed value: ten lost
fixes."""
BEND_SHARE = 0.25
"""Error of a travelled velocity over time step times second difference of the velocity [-]. Assumed value (1/12 where a
step is short against the sway of the antenna)."""
MOVING_M_S = 0.4
"""Speed from which on a tractor moves: ten times the noise of a velocity [m/s]. Assumed value."""
COURSE_M_S = 0.25
"""Speed from which on a velocity has a course: eight times its noise [m/s]. Assumed value."""
HELD_S = 5.0
"""Time without a course for which turns remain comparable: a usual bias adds 1.5 deg [s]. Assumed value."""


class Evidence(NamedTuple):
    """Consistency of the newest fixes with each other."""

    fix: Fix | None = None
    """Last fix; None before the first."""
    t: float = 0.0
    """Time of that fix [s]."""
    quality: int = Quality.NONE
    """Quality of that fix."""
    since: tuple[float, float] | None = None
    """Position of the last RTK fix less what velocities have travelled since, east and north; None after a gap [m]."""
    east: float = 0.0
    """Position of RTK fixes less travelled velocity, east [m]."""
    north: float = 0.0
    """Position of RTK fixes less travelled velocity, north [m]."""
    change: tuple[float, float] = (0.0, 0.0)
    """Change of the velocity between the last two fixes, east and north [m/s]."""
    variance: float = 0.0
    """Variance of the sums from changes of the velocity between fixes, both axes [m2]."""
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
            since = (fix.x, fix.y) if measured.quality == Quality.FIX else None
            return self._seen(measured, fix, t, speed > MOVING_M_S, 0.0)._replace(since=since)
        if time <= 0.0:
            return self
        repeated = self.moving and (fix.x, fix.y) == (last.x, last.y)
        moving = repeated or speed > MOVING_M_S
        found = self._seen(measured, fix, t, moving, self.repeated_s + time if repeated else 0.0)
        return found._travelled(fix, last, time)

    def _seen(self, measured: Measurement, fix: Fix, t: float, moving: bool, repeated_s: float) -> "Evidence":
        return self._replace(fix=fix, t=t, quality=measured.quality, moving=moving, repeated_s=repeated_s)

    def _travelled(self, fix: Fix, last: Fix, time: float) -> "Evidence":
        """Sums after the `time` [s] between two fixes."""
        fixed = self.quality == Quality.FIX
        if self.since is None:
            return self._replace(since=(fix.x, fix.y) if fixed else None)
        x, y = self.since[0] + 0.5 * time * (fix.vx + last.vx), self.since[1] + 0.5 * time * (fix.vy + last.vy)
        keep, change = exp(-time / DRIFT_TIME_S), (fix.vx - last.vx, fix.vy - last.vy)
        bend = hypot(change[0] - self.change[0], change[1] - self.change[1])
        found = self._replace(change=change, variance=keep * keep * self.variance + (BEND_SHARE * time * bend) ** 2)
        east, north = keep * self.east, keep * self.north
        if not fixed:
            return found._replace(since=(x, y), east=east, north=north)
        return found._replace(since=(fix.x, fix.y), east=east + fix.x - x, north=north + fix.y - y)


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


class AttitudeEvidence(NamedTuple):
    """How alive the inertial unit is: readings that used to change and no longer do, or no longer come."""

    angles: tuple[float, float] = (nan, nan)
    """Last roll and pitch; NaN before the first [rad]."""
    changed: tuple[bool, bool] = (False, False)
    """Whether each has changed yet."""
    repeats: tuple[float, float] = (0.0, 0.0)
    """Time for which each has not changed since, although the tractor was moving [s]."""
    silent_s: float = 0.0
    """Time for which one of them has been missing since the first reading [s]."""
    apart: tuple[float, float] = (0.0, 0.0)
    """Specific force less those of the bend and of gravity at these angles, over g: forward and left, mean over
    TILT_TIME_S [-]. The tilt of each force instead of their mean would count vibration."""

    @property
    def repeated_s(self) -> float:
        """Time for which one of them has not changed [s]."""
        return max(self.repeats)

    @property
    def tilt(self) -> float:
        """Larger difference of roll or pitch from the tilt that the specific force shows [rad]."""
        return atan(max(map(abs, self.apart)))

    def after(self, measured: Measurement, moving: bool, dt: float) -> "AttitudeEvidence":
        """Evidence after a tick of `dt` [s]."""
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
        share = dt / TILT_TIME_S
        ahead, left = (
            mean + share * (now - mean) for mean, now in zip(self.apart, _unexplained(measured), strict=True)
        )
        return AttitudeEvidence(angles, (changed[0], changed[1]), (repeats[0], repeats[1]), 0.0, (ahead, left))


def _unexplained(measured: Measurement) -> tuple[float, float]:
    """Specific force less those of the bend and of gravity at roll and pitch, over g: forward and left; 0 without a
    measured force [-]."""
    unit = measured.readings.get("imu")
    x, y = getattr(unit, "force_x", nan), getattr(unit, "force_y", nan)
    if not isfinite(x + y):
        return 0.0, 0.0
    bend = measured.wheel_speed * measured.gyro
    ahead, left, _ = to_body(measured.roll, measured.pitch, (0.0, 0.0, 1.0))
    return x / GRAVITY - ahead, (y - (bend if isfinite(bend) else 0.0)) / GRAVITY - left


class TurnEvidence(NamedTuple):
    """Turn of the fixes' course beside the gyro: its mean of late over one of longer.

    Velocities are averaged, turned back by the gyro, and not their angles: the antenna's sway has no mean. Fixes of
    good quality in motion hold for HELD_S; each counts for GAP_S at most.
    """

    t: float = 0.0
    """Time of the last such fix [s]."""
    turned: float = 0.0
    """Integral of the gyro [rad]."""
    known_s: float = 0.0
    """Time for which the fixes count [s]."""
    late: complex = 0j
    """Mean of the velocity over SWAY_S, turned back by the gyro; 0 before the first fix [m/s]."""
    long: complex = 0j
    """Its mean over TURN_TIME_S [m/s]."""

    @property
    def apart(self) -> float:
        """Angle by which course and gyro have turned apart [rad]."""
        return abs(phase(self.late * self.long.conjugate()))

    def after(self, measured: Measurement, dt: float) -> "TurnEvidence":
        """Evidence after a tick of `dt` [s]; it starts over without gyro, and after HELD_S."""
        fix, turned, time = measured.fix, self.turned + measured.gyro * dt, measured.t - self.t
        if turned != turned or (time > HELD_S and self.known_s > 0.0):
            return TurnEvidence(measured.t)
        if fix is None or measured.quality != Quality.FIX or hypot(fix.vx, fix.vy) <= COURSE_M_S:
            return self._replace(turned=turned)
        age = measured.t - fix.t if isfinite(fix.t) else 0.0
        ahead = copysign(1.0, measured.wheel_speed if isfinite(measured.wheel_speed) else measured.pedal)
        velocity = ahead * complex(fix.vx, fix.vy) * turn(-1j * (turned - age * measured.gyro))
        if not self.late:
            return TurnEvidence(measured.t, turned, 0.0, velocity, velocity)
        step = min(time, GAP_S)
        known = self.known_s + step
        late = self.late + (velocity - self.late) * step / min(known, SWAY_S)
        long = self.long + (velocity - self.long) * step / min(known, TURN_TIME_S)
        return TurnEvidence(measured.t, turned, known, late, long)
