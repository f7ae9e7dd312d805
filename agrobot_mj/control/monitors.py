"""Monitors of the supervisor: each a signal with its limit, the time for which it may be exceeded, and a reason.

The first ask what the estimator says of itself, and whether path, steering angle, pedal and speed are as commanded. The
others are evidence that does not go through the estimator: positions that repeat themselves, do not follow their own
velocity or contradict dead reckoning, wheels slower than the fixes, a turn that does not fit the steering angle or the
fixes' course, or that the gyro does not see, an inertial unit that repeats itself or falls silent. Where wheels and
fixes agree on a speed, the estimate of it is outvoted.
Pedal and wheels that are faster than the ground are none, so that a tractor which cannot move is not taken for one with
a sensor that lies.
"""

from math import atan, copysign, degrees, hypot, inf, nan, sqrt, tan
from typing import NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.control.evidence import (
    COURSE_M_S,
    GAP_S,
    MOVING_M_S,
    AttitudeEvidence,
    Evidence,
    GyroEvidence,
    TurnEvidence,
)
from agrobot_mj.control.reckoning import Reckoning
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Measurement
from agrobot_mj.core.spec import NonNegative, Positive

OVERSPEED_M_S = 0.15
"""Speed that is no overspeed at any command [m/s]. Assumed value: four times the noise of a reading."""
AGREEING = 0.15
"""Further difference at which the speeds of wheels and fixes agree, as a share of it [-]. Assumed value: slip."""
SWAYING_M_S = 0.8
"""Speed below which the sway of the antenna turns the course by more, in inverse proportion [m/s]. Assumed value."""
CLOSER_M, STRAYING_M = 0.1, 0.5
"""Fall of the distance from the path that counts as coming closer (half of `max_cross_track_m` if that is less), and
rise above the least one that does not count as leaving, for a tractor that has not yet been within `max_cross_track_m`
[m]. Assumed values."""
TURNED_AWAY = 0.3
"""Further rise, as a share of the tightest radius: a tractor that starts 45 deg off turns back on it [-]."""
DRIFT_SIGMAS = 2.5
"""Standard deviations of the travelled velocity by which the limit of the fixes' drift is larger [-]. Assumed value:
slow receivers on rough ground."""
HEAVIEST = 3.0
"""Largest ratio of a signal to its limit that counts in the time above the limit [-]. Assumed value."""


class Monitor(NamedTuple):
    """One limit of autonomous driving."""

    signal: float
    """Monitored signal; NaN where it is not known in this tick."""
    limit: float
    """Limit of the signal, in the same unit."""
    lasting_s: float
    """Time above the limit after which the tractor is stopped; half of it at twice the limit [s]."""
    reason: str
    """Reason for the stop, a format string with a place for the signal."""
    cut: bool = False
    """Whether the pedal is in doubt, so that its valve loses power."""

    def over(self, time: float, dt: float) -> float:
        """Time above the limit [s] after a tick of `dt` [s], weighted by the excess; unchanged if the signal is not
        known."""
        if self.signal != self.signal:
            return time
        return time + min(self.signal / self.limit, HEAVIEST) * dt if self.signal > self.limit else 0.0


class Watched(NamedTuple):
    """What the supervisor keeps track of for its monitors."""

    fix_age: float = 0.0
    """Age of the newest fix that the estimator has accepted [s]."""
    place: float = 0.0
    """Distance of the nearest point along the path [m]."""
    curvature: float = 0.0
    """Curvature of the path there, left positive [1/m]."""
    offset: float = 0.0
    """Estimated distance from the path [m]."""
    closest: float = inf
    """Least such distance so far, to `CLOSER_M` [m]."""
    closing_s: float = 0.0
    """Time since that distance last fell [s]."""
    mismatch: float = 0.0
    """Commanded less measured steering angle where the wheels do not follow, else 0 [rad]."""
    evidence: Evidence = Evidence()
    """Consistency of the fixes with each other."""
    gyro: GyroEvidence = GyroEvidence()
    """Since when the gyro gives its reading."""
    turn: TurnEvidence = TurnEvidence()
    """What the fixes' course turns beside the gyro."""
    attitude: AttitudeEvidence = AttitudeEvidence()
    """How alive the inertial unit is."""
    reckoning: Reckoning = Reckoning()
    """Where wheels and gyro lead."""
    pedal_mismatch: float = 0.0
    """Pedal reference less measured pedal where the pedal does not follow, else 0 [-]."""
    pedal_rate: float = 0.0
    """Rate of the measured pedal since the last tick [1/s]."""
    allowed: float = 0.0
    """Commanded speed, falling no faster than the tractor can follow [m/s]."""
    tracked: bool = False
    """Whether the heading has been known."""
    aligning_s: float = 0.0
    """Time since the heading was last known [s]."""


class SupervisorLimits(Reporting):
    """Limits of autonomous driving; every default is an estimate of what a cautious maker would set."""

    max_fix_age_s: Positive = 8.0
    """Age of the newest fix at which it stops [s]. Assumed value (2-20): after 5 in a turn it is 0.2-1 m off."""
    max_sigma_m: Positive = 1.0
    """Estimated standard deviation of the position at which it stops [m]. Assumed value (0.3-2)."""
    max_cross_track_m: Positive = 2.0
    """Cross-track error by the estimate at which it stops [m]. A tractor that starts farther off may come closer.
    Assumed value (0.5-3): below a swath's width."""
    max_acquiring_s: Positive = 20.0
    """Time without coming closer after which a tractor that started farther off stops [s]. Assumed value (10-60)."""
    max_nis: Positive = 120.0
    """Smoothed NIS of the fixes at which it stops [-]. Assumed value (30-150): an honest filter has 2, across ridges of
    3 cm at 2.5 m/s 85; five seconds of wild fixes, of which each counts 200 at most, make 126."""
    max_steer_mismatch_deg: Positive = 12.0
    """Difference of commanded and measured steering angle that is too much [deg]. Assumed value (5-20)."""
    steer_mismatch_s: Positive = 2.0
    """Duration of such a difference at which it stops [s]. Assumed value (1-4): from stop to stop the valve takes
    3.5."""
    max_aligning_s: Positive = 15.0
    """Time after which it gives up aligning and stops [s]. Assumed value (5-30)."""
    max_realigning_s: Positive = 4.0
    """Time after which it gives up aligning in the middle of work [s]. Assumed value (3-8): a search takes 2."""
    max_overspeed: Positive = 1.25
    """Speed over the commanded one at which it stops [-]. Assumed value (1.2-1.4): sound runs reach 1.15."""
    overspeed_s: Positive = 0.3
    """Duration of an overspeed at which it stops [s]. Assumed value (0.2-1): a swing on ridges."""
    max_pedal_mismatch: Positive = 0.08
    """Difference of demanded and measured pedal that is too much [-]. Assumed value (0.05-0.15): a ramp's is 0.05."""
    pedal_mismatch_s: Positive = 0.14
    """Duration of such a difference at which it stops [s]. Assumed value (0.1-0.3): a pedal runs away in 0.5."""
    max_pedal_rate_per_s: Positive = 2.2
    """Rate of the measured pedal beyond which its sensor is wrong [1/s]. Assumed value (2-5): the pedal moves at
    1.5."""
    max_wheel_lag_m_s: Positive = 0.35
    """Speed by which wheels may be slower than the fixes [m/s]. Assumed value (0.2-0.5): sway of the antenna."""
    max_wheel_lag_share: NonNegative = 0.3
    """Further lag of the wheels that is allowed, as a share of the fixes' speed [-]. Assumed value (0.2-0.4): wheels on
    a bump."""
    wheel_lag_s: Positive = 0.3
    """Duration of such a difference at which it stops [s]. Assumed value (0.2-0.5): over half a swing of the
    antenna."""
    outvoted_s: Positive = 1.0
    """Duration of as large a difference of the estimate from fixes and wheels that agree at which it stops [s].
    Assumed value (0.5-2): longer than a swing of the antenna."""
    max_angle_mismatch_deg: Positive = 8.0
    """Difference of the measured steering angle from the one that the yaw rate needs [deg]. Assumed value (6-15): a
    worn sensor, side slip."""
    max_angle_mismatch_share: NonNegative = 0.4
    """Further difference allowed, as a share of the larger angle [-]. Assumed value (0.3-0.6): wheels slide under an
    implement."""
    angle_mismatch_s: Positive = 1.0
    """Duration of such a difference at which it stops [s]. Assumed value (0.5-1.5): lag of wheels and tyres."""
    max_unseen_turn_deg_s: Positive = 2.0
    """Yaw rate that wheels which turn add, while the gyro repeats one reading for `max_repeat_s`, at which it stops
    [deg/s]. Assumed value (1-4): a gyro resolves 0.1 deg/s, and has noise."""
    max_repeat_s: Positive = 0.4
    """Time for which a moving tractor may be given one position, and a turning one one yaw rate [s]. Assumed value
    (0.2-1): fixes have noise."""
    max_course_mismatch_deg: Positive = 8.0
    """Turn of the fixes' course beside that of the gyro, mean of 2 s over that of 10 s, at which it stops [deg];
    more below 0.8 m/s. Assumed value (6-15): sound runs reach 6 (ridges at 3 m/s), a constant bias of 1 deg/s all of
    it."""
    max_fix_drift_m: Positive = 0.3
    """Distance of the fixes from where their own velocities lead, forgotten within 60 s, at which it stops, for fast
    receivers on smooth ground [m]. Assumed value (0.3-1): white velocity noise of 3 cm/s gives 0.04."""
    max_reckoning_sigma: Positive = 5.0
    """Distance of a fix from the dead reckoning of the last 30 s at which it stops, in standard deviations [-].
    Assumed value (4-6): sound runs reach 2, 4 on 15 deg at 2 m/s or with a drawn implement."""
    reckoning_s: Positive = 0.6
    """Duration of such a distance at which it stops [s]. Assumed value (0.5-2): more than one checked fix."""
    max_tilt_mismatch_deg: Positive = 6.0
    """Difference of roll or pitch from the tilt that the specific force shows, mean of 4 s, at which it stops [deg].
    Assumed value (4-10): a start at 0.5 m/s2 shows 3 for a moment, ridges of 3 cm at 3 m/s up to 4.5."""
    max_attitude_age_s: Positive = 2.0
    """Time for which an inertial unit may be silent [s]. Assumed value (1-5): the slope changes in a turn."""

    def monitors(self, watched: Watched, situation: Situation, measured: Measurement) -> tuple[Monitor, ...]:
        """All that is watched; of several that trip at once the first gives the reason."""
        return (
            *self._of_estimate(watched, situation),
            *self._of_motion(watched, situation, measured),
            *self._of_fixes(watched, measured),
            *self._of_turns(watched, situation, measured),
            *self._of_attitude(watched.attitude),
        )

    def _of_estimate(self, w: Watched, situation: Situation) -> tuple[Monitor, ...]:
        """What the estimator says of itself and of the path."""
        e, off = situation.estimate, w.offset if w.tracked else 0.0
        aligning = self.max_realigning_s if w.tracked else self.max_aligning_s
        acquired = w.closest <= self.max_cross_track_m
        turning = TURNED_AWAY * situation.machine.tightest_radius
        farthest = self.max_cross_track_m if acquired else w.closest + CLOSER_M + STRAYING_M + turning
        waiting = 0.0 if acquired else w.closing_s
        return (
            Monitor(w.fix_age, self.max_fix_age_s, 0.0, "no GNSS fix for {:.1f} s"),
            Monitor(e.position_sigma, self.max_sigma_m, 0.0, "position known to {:.2f} m only"),
            Monitor(e.nis_mean, self.max_nis, 0.0, "fixes contradict the estimate (NIS {:.0f})"),
            Monitor(off, farthest, 0.0, "{:.2f} m off the path"),
            Monitor(waiting, self.max_acquiring_s, 0.0, "comes no closer to the path in {:.0f} s"),
            Monitor(w.aligning_s, aligning, 0.0, "heading unknown after {:.0f} s"),
        )

    def _of_motion(self, w: Watched, situation: Situation, measured: Measurement) -> tuple[Monitor, ...]:
        """Steering, speed and pedal against their commands."""
        u, agreed = abs(situation.estimate.speed), _agreed_speed(w.evidence, measured)
        top, lag = self.max_overspeed * w.allowed + OVERSPEED_M_S, self._wheel_lag(agreed)
        steer, pedal = degrees(abs(w.mismatch)), abs(w.pedal_mismatch)
        return (
            Monitor(
                *(steer, self.max_steer_mismatch_deg, self.steer_mismatch_s),
                "wheels {:.0f} deg off the steering command",
            ),
            Monitor(
                *(max(u, agreed), top, self.overspeed_s),
                *("drives at {:.1f} m/s, faster than commanded", True),
            ),
            Monitor(agreed - u, lag, self.outvoted_s, "estimate {:.1f} m/s slower than wheels and fixes"),
            Monitor(
                *(pedal, self.max_pedal_mismatch, self.pedal_mismatch_s),
                *("pedal {:.2f} off its command", True),
            ),
            Monitor(abs(w.pedal_rate), self.max_pedal_rate_per_s, 0.0, "pedal reading jumps at {:.1f} 1/s", cut=True),
        )

    def _of_fixes(self, w: Watched, measured: Measurement) -> tuple[Monitor, ...]:
        """Fixes against each other, dead reckoning and the wheels."""
        fix, proof, reckoning = measured.fix, w.evidence, w.reckoning
        speed = nan if fix is None else hypot(fix.vx, fix.vy)
        wheels = copysign(1.0, measured.pedal) * measured.wheel_speed
        drift = self.max_fix_drift_m + DRIFT_SIGMAS * sqrt(proof.variance)
        apart = self.max_reckoning_sigma * reckoning.sigma
        return (
            Monitor(proof.repeated_s, self.max_repeat_s, 0.0, "fixes repeat one position for {:.1f} s"),
            Monitor(proof.drift, drift, 0.0, "fixes {:.2f} m off the way of their velocity"),
            Monitor(reckoning.apart, apart, self.reckoning_s, "fixes {:.2f} m off dead reckoning by wheels and gyro"),
            Monitor(
                *(speed - wheels, self._wheel_lag(speed), self.wheel_lag_s),
                "wheels {:.1f} m/s slower than the fixes",
            ),
        )

    def _of_turns(self, w: Watched, situation: Situation, measured: Measurement) -> tuple[Monitor, ...]:
        """The gyro against steering angle and fixes."""
        steer, turning = degrees(situation.steer), _angle_of_turn(situation, measured.gyro)
        angle = self.max_angle_mismatch_deg + self.max_angle_mismatch_share * max(abs(steer), abs(turning))
        speed = max(abs(situation.estimate.speed), COURSE_M_S)
        course = self.max_course_mismatch_deg * max(1.0, SWAYING_M_S / speed)
        return (
            Monitor(
                *(abs(turning - steer), angle, self.angle_mismatch_s),
                "tractor turns as with wheels {:.0f} deg off the measured angle",
            ),
            Monitor(
                *(self._unseen_turn(situation, measured, w.gyro), self.max_unseen_turn_deg_s, 0.0),
                "gyro repeats one reading in a turn of {:.1f} deg/s",
            ),
            Monitor(degrees(w.turn.apart), course, 0.0, "fixes turn {:.0f} deg beside the gyro"),
        )

    def _of_attitude(self, attitude: AttitudeEvidence) -> tuple[Monitor, ...]:
        """The inertial unit by itself."""
        return (
            Monitor(attitude.repeated_s, self.max_repeat_s, 0.0, "inertial unit repeats one angle for {:.1f} s"),
            Monitor(
                *(degrees(attitude.tilt), self.max_tilt_mismatch_deg, 0.0),
                "roll or pitch {:.0f} deg off the tilt that the specific force shows",
            ),
            Monitor(attitude.silent_s, self.max_attitude_age_s, 0.0, "no roll and pitch for {:.1f} s"),
        )

    def _wheel_lag(self, speed: float) -> float:
        """Difference of two speeds, one of them `speed`, that is allowed [m/s]."""
        return self.max_wheel_lag_m_s + self.max_wheel_lag_share * speed

    def _unseen_turn(self, situation: Situation, measured: Measurement, gyro: GyroEvidence) -> float:
        """Yaw rate that the wheels have added since the gyro last read something else [deg/s]."""
        if measured.t - gyro.t < self.max_repeat_s:
            return 0.0
        turned = tan(measured.steer) - tan(gyro.steer)
        return degrees(abs(situation.estimate.speed * turned / situation.machine.wheelbase_m))


def _angle_of_turn(situation: Situation, gyro: float) -> float:
    """Steering angle that the turn needs, from the gyro if there is one; NaN at a crawl [deg]."""
    u, rate = situation.estimate.speed, situation.estimate.yaw_rate if gyro != gyro else gyro
    return degrees(atan(situation.machine.wheelbase_m * rate / u)) if abs(u) > MOVING_M_S else nan


def _agreed_speed(proof: Evidence, measured: Measurement) -> float:
    """Speed on which wheels and the newest fix agree; 0 where they do not, or one is missing [m/s]."""
    if proof.fix is None or measured.t - proof.t > GAP_S:
        return 0.0
    fixes, wheels = hypot(proof.fix.vx, proof.fix.vy), abs(measured.wheel_speed)
    return min(fixes, wheels) if abs(fixes - wheels) < OVERSPEED_M_S + AGREEING * wheels else 0.0
