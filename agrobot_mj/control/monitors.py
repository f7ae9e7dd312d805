"""Monitors of the supervisor: each has a signal, a limit, the time for which it may be exceeded, and a reason.

The first monitors check the state of the estimator, and path, steering angle, pedal and speed against their commands.
The others are independent of the estimator. They detect fixes that repeat, contradict their own velocity or contradict
dead reckoning; wheels slower than the fixes; a yaw rate that contradicts the steering angle or the course of the fixes,
or that the gyro misses; an inertial unit with repeated or missing angles. Where wheels and fixes agree on a speed, they
overrule the estimate. Pedal and wheels faster than the ground are not monitored: a blocked tractor is not a
sensor fault.
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
"""Tolerated overspeed at every command [m/s]. Assumed value: four times the noise of a measurement."""
AGREEING = 0.15
"""Maximum relative difference of agreeing wheel and fix speeds, added to OVERSPEED_M_S [-]. Assumed value: slip."""
SWAYING_M_S = 0.8
"""Speed below which antenna oscillation raises the course limit, as the inverse speed [m/s]. Assumed value."""
CLOSER_M, STRAYING_M = 0.1, 0.5
"""Distances for a tractor that has never been within `max_cross_track_m` [m]: decrease that counts as approaching the
path (at most half of this limit), and tolerated increase above the minimum distance. Assumed values."""
TURNED_AWAY = 0.3
"""Further tolerated increase for a tractor that starts 45 deg off, divided by the minimum turning radius [-]."""
DRIFT_SIGMAS = 2.5
"""Number of standard deviations of the integrated velocity added to the drift limit [-]. Assumed value, for slow
receivers and ridges."""
MAX_RATIO = 3.0
"""Maximum ratio of signal to limit that weights the time above the limit [-]. Assumed value."""


class Monitor(NamedTuple):
    """One limit of autonomous driving."""

    signal: float
    """Monitored signal; NaN if unknown in this tick."""
    limit: float
    """Limit of the signal, in the unit of the signal."""
    lasting_s: float
    """Time above the limit before the tractor is stopped; half of it at twice the limit [s]."""
    reason: str
    """Format string of the reason for the stop, with a placeholder for the signal."""
    cut: bool = False
    """Whether the pedal may be faulty, so that its valve loses power."""

    def over(self, time: float, dt: float) -> float:
        """Return the time above the limit [s] after `dt` [s], weighted by the excess; unchanged if `signal` is NaN."""
        if self.signal != self.signal:
            return time
        return time + min(self.signal / self.limit, MAX_RATIO) * dt if self.signal > self.limit else 0.0


class MonitorSignals(NamedTuple):
    """Signals that the supervisor computes for its monitors."""

    fix_age: float = 0.0
    """Age of the newest fix accepted by the estimator [s]."""
    place: float = 0.0
    """Arc length of the nearest path point [m]."""
    curvature: float = 0.0
    """Curvature of the path at the nearest point, positive left [1/m]."""
    offset: float = 0.0
    """Estimated distance from the path [m]."""
    closest: float = inf
    """Minimum estimated distance from the path so far, accurate to `CLOSER_M` [m]."""
    closing_s: float = 0.0
    """Time since the minimum distance last decreased [s]."""
    mismatch: float = 0.0
    """Commanded minus measured steering angle if the wheels do not follow the command, else 0 [rad]."""
    evidence: Evidence = Evidence()
    """Consistency of the fixes with each other."""
    gyro: GyroEvidence = GyroEvidence()
    """Repetition of the gyro's yaw rate."""
    turn: TurnEvidence = TurnEvidence()
    """Difference between the rotation of the fixes' course and of the gyro."""
    attitude: AttitudeEvidence = AttitudeEvidence()
    """Consistency of the inertial unit's angles."""
    reckoning: Reckoning = Reckoning()
    """Dead reckoning by wheels and gyro."""
    pedal_mismatch: float = 0.0
    """Pedal reference minus measured pedal if the pedal does not follow, else 0 [-]."""
    pedal_rate: float = 0.0
    """Rate of the measured pedal since the last tick [1/s]."""
    allowed: float = 0.0
    """Commanded speed, decreasing no faster than the tractor can follow [m/s]."""
    tracked: bool = False
    """Whether the heading has ever been known."""
    aligning_s: float = 0.0
    """Time since the heading was last known [s]."""


class SupervisorLimits(Reporting):
    """Limits of autonomous driving; each default is an assumed value of a cautious manufacturer."""

    max_fix_age_s: Positive = 8.0
    """Maximum age of the newest fix [s]. Assumed value (2-20): after 5 s in a turn the error is 0.2-1 m."""
    max_sigma_m: Positive = 1.0
    """Maximum estimated standard deviation of the position [m]. Assumed value (0.3-2)."""
    max_cross_track_m: Positive = 2.0
    """Maximum estimated cross-track error; larger initial errors may decrease first [m]. Assumed value (0.5-3): below
    the width of a swath."""
    max_acquiring_s: Positive = 20.0
    """Maximum time without approaching the path, if started outside `max_cross_track_m` [s]. Assumed value (10-60)."""
    max_nis: Positive = 120.0
    """Maximum smoothed normalised innovation squared (NIS) of the fixes [-]. Assumed value (30-150): a consistent
    filter has 2, or 85 across 3 cm ridges at 2.5 m/s; 5 s of wrong fixes, each limited to 200, give 126."""
    max_steer_mismatch_deg: Positive = 12.0
    """Maximum difference between commanded and measured steering angle [deg]. Assumed value (5-20)."""
    steer_mismatch_s: Positive = 2.0
    """Maximum duration of a steering-angle mismatch [s]. Assumed value (1-4): the valve needs 3.5 s lock to lock."""
    max_aligning_s: Positive = 15.0
    """Maximum time until the heading is known after the start [s]. Assumed value (5-30)."""
    max_realigning_s: Positive = 4.0
    """Maximum time without a known heading during work [s]. Assumed value (3-8): a search takes 2."""
    max_overspeed: Positive = 1.25
    """Maximum speed divided by the commanded speed [-]. Assumed value (1.2-1.4): fault-free runs reach 1.15."""
    overspeed_s: Positive = 0.3
    """Maximum duration of an overspeed [s]. Assumed value (0.2-1): one oscillation on ridges."""
    max_pedal_mismatch: Positive = 0.08
    """Maximum difference between commanded and measured pedal [-]. Assumed value (0.05-0.15): 0.05 in a ramp."""
    pedal_mismatch_s: Positive = 0.14
    """Maximum duration of a pedal mismatch [s]. Assumed value (0.1-0.3): a runaway pedal needs 0.5."""
    max_pedal_rate_per_s: Positive = 2.2
    """Maximum plausible rate of the measured pedal [1/s]. Assumed value (2-5): the pedal moves at 1.5."""
    max_wheel_lag_m_s: Positive = 0.35
    """Maximum speed of the fixes minus that of the wheels [m/s]. Assumed value (0.2-0.5): antenna oscillation."""
    max_wheel_lag_share: NonNegative = 0.3
    """Further tolerated speed difference as a fraction of the fix speed [-]. Assumed value (0.2-0.4): bumps."""
    wheel_lag_s: Positive = 0.3
    """Maximum duration of a too low wheel speed [s]. Assumed value (0.2-0.5): half an antenna oscillation."""
    outvoted_s: Positive = 1.0
    """Maximum time for which the estimated speed may be too low where wheels and fixes agree [s]. Assumed value
    (0.5-2): longer than an oscillation of the antenna."""
    max_angle_mismatch_deg: Positive = 8.0
    """Maximum steering-angle difference between sensor and yaw rate [deg]. Assumed value (6-15): wear, side slip."""
    max_angle_mismatch_share: NonNegative = 0.4
    """Further tolerated fraction of the larger angle [-]. Assumed value (0.3-0.6): wheels slide under an implement."""
    angle_mismatch_s: Positive = 1.0
    """Maximum duration of a mismatch of angle and yaw rate [s]. Assumed value (0.5-1.5): lag of wheels and tyres."""
    max_unseen_turn_deg_s: Positive = 2.0
    """Maximum yaw-rate change, derived from the steering angle, while the gyro repeats one value for `max_repeat_s`
    [deg/s]. Assumed value (1-4): a gyro resolves 0.1 deg/s, and has noise."""
    max_repeat_s: Positive = 0.4
    """Maximum time of a repeated position while moving, or of a repeated yaw rate while turning [s]. Assumed value
    (0.2-1): real measurements have noise."""
    max_course_mismatch_deg: Positive = 8.0
    """Maximum rotation of the fixes' course relative to the gyro, mean of 2 s minus mean of 10 s [deg]; larger below
    0.8 m/s. Assumed value (6-15): fault-free runs reach 6 (ridges at 3 m/s); a constant bias of 1 deg/s reaches 8."""
    max_fix_drift_m: Positive = 0.3
    """Maximum difference between position and integrated velocity of the fixes, forgotten within 60 s, for fast
    receivers on smooth ground [m]. Assumed value (0.3-1): white velocity noise of 3 cm/s gives 0.04."""
    max_reckoning_sigma: Positive = 5.0
    """Maximum distance of a fix from the dead reckoning of the last 30 s, in standard deviations [-]. Assumed value
    (4-6): fault-free runs reach 2, or 4 on 15 deg at 2 m/s or with a towed implement."""
    reckoning_s: Positive = 0.6
    """Maximum duration of a difference from dead reckoning [s]. Assumed value (0.5-2): more than one checked fix."""
    max_tilt_mismatch_deg: Positive = 6.0
    """Maximum difference between roll or pitch and the tilt derived from the specific force, mean of 4 s [deg]. Assumed
    value (4-10): a start at 0.5 m/s2 briefly causes 3, ridges of 3 cm at 3 m/s up to 4.5."""
    max_attitude_age_s: Positive = 2.0
    """Maximum time without angles from the inertial unit [s]. Assumed value (1-5): the slope changes in a turn."""

    def monitors(self, watched: MonitorSignals, situation: Situation, measured: Measurement) -> tuple[Monitor, ...]:
        """Return all monitors; if several exceed their limits at once, the first gives the reason."""
        return (
            *self._of_estimate(watched, situation),
            *self._of_motion(watched, situation, measured),
            *self._of_fixes(watched, measured),
            *self._of_turns(watched, situation, measured),
            *self._of_attitude(watched.attitude),
        )

    def _of_estimate(self, w: MonitorSignals, situation: Situation) -> tuple[Monitor, ...]:
        e, off = situation.estimate, w.offset if w.tracked else 0.0
        aligning = self.max_realigning_s if w.tracked else self.max_aligning_s
        acquired = w.closest <= self.max_cross_track_m
        turning = TURNED_AWAY * situation.machine.tightest_radius
        farthest = self.max_cross_track_m if acquired else w.closest + CLOSER_M + STRAYING_M + turning
        waiting = 0.0 if acquired else w.closing_s
        return (
            Monitor(w.fix_age, self.max_fix_age_s, 0.0, "no GNSS fix for {:.1f} s"),
            Monitor(e.position_sigma, self.max_sigma_m, 0.0, "position uncertain by {:.2f} m"),
            Monitor(e.nis_mean, self.max_nis, 0.0, "fixes contradict the estimate (NIS {:.0f})"),
            Monitor(off, farthest, 0.0, "{:.2f} m off the path"),
            Monitor(waiting, self.max_acquiring_s, 0.0, "not closer to the path after {:.0f} s"),
            Monitor(w.aligning_s, aligning, 0.0, "heading unknown after {:.0f} s"),
        )

    def _of_motion(self, w: MonitorSignals, situation: Situation, measured: Measurement) -> tuple[Monitor, ...]:
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
                *("speed of {:.1f} m/s, faster than commanded", True),
            ),
            Monitor(agreed - u, lag, self.outvoted_s, "estimate {:.1f} m/s slower than wheels and fixes"),
            Monitor(
                *(pedal, self.max_pedal_mismatch, self.pedal_mismatch_s),
                *("pedal {:.2f} off its command", True),
            ),
            Monitor(
                abs(w.pedal_rate), self.max_pedal_rate_per_s, 0.0, "pedal measurement jumps at {:.1f} 1/s", cut=True
            ),
        )

    def _of_fixes(self, w: MonitorSignals, measured: Measurement) -> tuple[Monitor, ...]:
        fix, proof, reckoning = measured.fix, w.evidence, w.reckoning
        speed = nan if fix is None else hypot(fix.vx, fix.vy)
        wheels = copysign(1.0, measured.pedal) * measured.wheel_speed
        drift = self.max_fix_drift_m + DRIFT_SIGMAS * sqrt(proof.variance)
        farthest = self.max_reckoning_sigma * reckoning.sigma
        return (
            Monitor(proof.repeated_s, self.max_repeat_s, 0.0, "fixes repeat one position for {:.1f} s"),
            Monitor(proof.drift, drift, 0.0, "fixes {:.2f} m off the path of their velocity"),
            Monitor(
                reckoning.distance, farthest, self.reckoning_s, "fixes {:.2f} m off dead reckoning by wheels and gyro"
            ),
            Monitor(
                *(speed - wheels, self._wheel_lag(speed), self.wheel_lag_s),
                "wheels {:.1f} m/s slower than the fixes",
            ),
        )

    def _of_turns(self, w: MonitorSignals, situation: Situation, measured: Measurement) -> tuple[Monitor, ...]:
        steer, turning = degrees(situation.steer), _required_angle(situation, measured.gyro)
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
                "gyro repeats one value in a turn of {:.1f} deg/s",
            ),
            Monitor(degrees(w.turn.difference), course, 0.0, "course of the fixes {:.0f} deg off the gyro"),
        )

    def _of_attitude(self, attitude: AttitudeEvidence) -> tuple[Monitor, ...]:
        return (
            Monitor(attitude.repeated_s, self.max_repeat_s, 0.0, "inertial unit repeats one angle for {:.1f} s"),
            Monitor(
                *(degrees(attitude.tilt), self.max_tilt_mismatch_deg, 0.0),
                "roll or pitch {:.0f} deg off the tilt of the specific force",
            ),
            Monitor(attitude.silent_s, self.max_attitude_age_s, 0.0, "no roll and pitch for {:.1f} s"),
        )

    def _wheel_lag(self, speed: float) -> float:
        """Return the tolerated difference between `speed` and another measured speed [m/s]."""
        return self.max_wheel_lag_m_s + self.max_wheel_lag_share * speed

    def _unseen_turn(self, situation: Situation, measured: Measurement, gyro: GyroEvidence) -> float:
        """Return the yaw-rate change, from the steering angle, since the gyro's value last changed [deg/s]."""
        if measured.t - gyro.t < self.max_repeat_s:
            return 0.0
        turned = tan(measured.steer) - tan(gyro.steer)
        return degrees(abs(situation.estimate.speed * turned / situation.machine.wheelbase_m))


def _required_angle(situation: Situation, gyro: float) -> float:
    """Return the steering angle for the yaw rate of the gyro (or the estimate without gyro); NaN at low speed [deg]."""
    u, rate = situation.estimate.speed, situation.estimate.yaw_rate if gyro != gyro else gyro
    return degrees(atan(situation.machine.wheelbase_m * rate / u)) if abs(u) > MOVING_M_S else nan


def _agreed_speed(proof: Evidence, measured: Measurement) -> float:
    """Return the speed on which wheels and newest fix agree; 0 if they disagree or one is missing [m/s]."""
    if proof.fix is None or measured.t - proof.t > GAP_S:
        return 0.0
    fixes, wheels = hypot(proof.fix.vx, proof.fix.vy), abs(measured.wheel_speed)
    return min(fixes, wheels) if abs(fixes - wheels) < OVERSPEED_M_S + AGREEING * wheels else 0.0
