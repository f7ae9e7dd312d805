"""Monitors of the supervisor: each has a signal, a limit, a maximum time above the limit, and a reason for a stop.

The first monitors compare position, steering angle, pedal and speed with the path and the commands, and check
the estimator state. The other monitors are independent of the estimator and detect:
- repeated fixes, and fixes that contradict their velocity or dead reckoning;
- wheels slower than the fixes;
- a yaw rate that contradicts the steering angle or the course of the fixes;
- a turn that the gyro does not measure;
- repeated, missing or inconsistent angles of the inertial unit.

If wheels and fixes agree on a higher speed, this speed replaces the estimated speed. The speed of pedal or wheels
may exceed the ground speed, because the wheels of a blocked tractor spin without a sensor fault.
"""

from math import atan, copysign, degrees, inf, isnan, nan, sqrt, tan
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from agrobot_mj.control.evidence import (
    COURSE_M_S,
    GAP_S,
    MOVING_M_S,
    AttitudeEvidence,
    Evidence,
    GyroEvidence,
    Sensed,
    TurnEvidence,
    course_error,
    drift_of,
    tilt_error,
)
from agrobot_mj.core.kernels import jit
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Estimate, Fix
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters

OVERSPEED_M_S = 0.15
"""Constant part of the limits on overspeed and speed difference [m/s]. Assumed value: 4 times the speed noise."""
AGREEING = 0.15
"""Maximum difference between wheel speed and fix speed that counts as agreement, divided by the wheel speed [-]; the
constant `OVERSPEED_M_S` is added. Assumed value that allows for wheel slip."""
SWAYING_M_S = 0.8
"""Speed [m/s] below which the limit of the course monitor increases as 1 / speed, because the oscillation of the
antenna then rotates the fix velocity more. Assumed value."""
CLOSER_M, STRAYING_M = 0.1, 0.5
"""Limits [m] for a tractor that has not yet been within `max_cross_track_m` of the path. `CLOSER_M`: decrease of the
minimum distance from the path that counts as an approach. `STRAYING_M`: accepted increase above the minimum distance.
Assumed values."""
TURNED_AWAY = 0.3
"""Accepted increase of the distance from the path during a turn towards the path, divided by the turning radius [-].
Assumed value."""
DRIFT_SIGMAS = 2.5
"""Margin of the drift limit, in standard deviations of the integration error [-]. Assumed value for low fix rates and
ridges."""
MAX_RATIO = 3.0
"""Maximum weight of the time above a limit [-]. The weight is the ratio of signal to limit. Assumed value."""


REASONS = (
    "no GNSS fix for {:.1f} s",
    "position standard deviation of {:.2f} m",
    "fixes contradict the estimate (NIS {:.0f})",
    "{:.2f} m off the path",
    "no closer to the path after {:.0f} s",
    "heading unknown after {:.0f} s",
    "wheel angle {:.0f} deg off the steering command",
    "speed of {:.1f} m/s above the command",
    "estimated speed {:.1f} m/s below wheels and fixes",
    "pedal position {:.2f} off the command",
    "pedal measurement changes by {:.1f} 1/s",
    "fixes repeat one position for {:.1f} s",
    "fixes {:.2f} m off the track integrated from their velocity",
    "fixes {:.2f} m off dead reckoning from wheels and gyro",
    "wheel speed {:.1f} m/s below the speed of the fixes",
    "turn rate implies a wheel angle {:.0f} deg off the measured one",
    "gyro repeats one value in a turn of {:.1f} deg/s",
    "course of the fixes {:.0f} deg off the gyro heading",
    "inertial unit repeats one angle for {:.1f} s",
    "roll or pitch {:.0f} deg off the tilt from the specific force",
    "no roll or pitch measurement for {:.1f} s",
)
"""Format strings of the reasons for a stop, one per monitor, with a placeholder for the signal."""
CUTTING = (7, 9, 10)  # Numbers of the monitors that cut the power of the pedal valve, because the pedal may be faulty


class MonitorSignals(NamedTuple):
    """Signals of the monitors, computed by the supervisor."""

    fix_age: float = 0.0  # Age of the newest fix that the estimator has accepted [s]
    place: float = 0.0  # Arc length of the nearest path point [m]
    curvature: float = 0.0  # Curvature of the path at the nearest point [1/m], positive left
    offset: float = 0.0  # Estimated distance from the path [m]
    closest: float = inf  # Minimum estimated distance from the path so far, updated in steps of at least `CLOSER_M` [m]
    closing_s: float = 0.0  # Time since the minimum distance from the path last decreased [s]
    mismatch: float = 0.0  # Commanded minus measured steering angle [rad], or 0 while the wheels approach the command
    evidence: Evidence = Evidence()  # Consistency checks of consecutive fixes
    gyro: GyroEvidence = GyroEvidence()  # Check of the gyro for repeated yaw rates
    turn: TurnEvidence = TurnEvidence()  # Check of the rotation of the fixes' course relative to the gyro
    attitude: AttitudeEvidence = AttitudeEvidence()  # Consistency checks of the angles of the inertial unit
    pedal_mismatch: float = 0.0
    """Pedal reference minus measured pedal position [-], or 0 while the pedal moves towards the reference."""
    pedal_rate: float = 0.0  # Rate of change of the measured pedal position since the last tick [1/s]
    allowed: float = 0.0  # Commanded speed [m/s]; decreases at most as fast as the tractor can decelerate
    tracked: bool = False  # Whether the heading has been known at least once
    aligning_s: float = 0.0  # Time since the heading was last known [s]
    readings: tuple[float, float] = (nan, nan)
    """Last measured steering angle [rad] and pedal position [-], or NaN before the first tick."""
    rate: float = 0.0  # Rate of the measured steering angle, smoothed over STEERING_RATE_S [rad/s]


class SupervisorLimits(Reporting):
    """Limits of the monitors. All defaults are conservative assumed values."""

    max_fix_age_s: Positive = 8.0
    """Maximum time since the newest accepted fix [s]. Assumed value (range 2-20): 5 s without a fix in a turn cause
    position errors of 0.2-1 m."""
    max_sigma_m: Positive = 1.0
    """Maximum estimated standard deviation of the position [m]. Assumed value (range 0.3-2)."""
    max_cross_track_m: Positive = 2.0
    """Maximum estimated cross-track error [m]. A larger initial error is accepted while it decreases. Assumed value
    (range 0.5-3): less than the width of a swath."""
    max_acquiring_s: Positive = 20.0
    """Maximum time without an approach to a path farther away than `max_cross_track_m` [s]. Assumed value (range
    10-60)."""
    max_nis: Positive = 120.0
    """Maximum smoothed normalised innovation squared (NIS) of the fixes [-]. Assumed value (range 30-150): the mean is
    2 for a consistent filter and 85 on 3 cm ridges at 2.5 m/s. Wrong fixes (NIS clipped to 200) cause 126 after 5 s."""
    max_steer_mismatch_deg: Positive = 12.0
    """Maximum difference between commanded and measured steering angle [deg]. Assumed value (range 5-20)."""
    steer_mismatch_s: Positive = 2.0
    """Maximum duration of a steering-angle mismatch [s]. Assumed value (range 1-4); lock to lock takes 3.5 s."""
    max_aligning_s: Positive = 15.0
    """Maximum time from the start until the heading is known [s]. Assumed value (range 5-30)."""
    max_realigning_s: Positive = 4.0
    """Maximum time without a known heading after alignment [s]. Assumed value (range 3-8); realignment takes 2 s."""
    max_overspeed: Positive = 1.25
    """Maximum ratio of speed to commanded speed [-]. Assumed value (range 1.2-1.4); fault-free runs reach 1.15."""
    overspeed_s: Positive = 0.3
    """Maximum duration of an overspeed [s]. Assumed value (range 0.2-1): one period of the speed oscillation on
    ridges."""
    max_pedal_mismatch: Positive = 0.08
    """Maximum difference between commanded and measured pedal position [-]. Assumed value (range 0.05-0.15): speed
    ramps cause a difference of 0.05."""
    pedal_mismatch_s: Positive = 0.14
    """Maximum duration of a pedal mismatch [s]. Assumed value (range 0.1-0.3); a runaway pedal reaches its stop in 0.5
    s."""
    max_pedal_rate_per_s: Positive = 2.2
    """Maximum plausible rate of the measured pedal position [1/s]. Assumed value (range 2-5); the pedal moves at 1.5
    1/s."""
    max_wheel_lag_m_s: Positive = 0.35
    """Maximum of fix speed minus wheel speed [m/s]. Assumed value (range 0.2-0.5), which covers antenna oscillation."""
    max_wheel_lag_share: NonNegative = 0.3
    """Increase of `max_wheel_lag_m_s` divided by fix speed [-]. Assumed value (range 0.2-0.4), which covers bumps."""
    wheel_lag_s: Positive = 0.3
    """Maximum time for which the wheel speed may be below the fix speed [s]. Assumed value (range 0.2-0.5): half the
    period of the antenna oscillation."""
    outvoted_s: Positive = 1.0
    """Maximum time for which the estimated speed may be below the speed on which wheels and fixes agree [s]. Assumed
    value (range 0.5-2), more than one period of the antenna oscillation."""
    max_angle_mismatch_deg: Positive = 8.0
    """Maximum difference between the measured steering angle and the angle derived from the yaw rate [deg]. Assumed
    value (range 6-15), which covers wear and sideslip."""
    max_angle_mismatch_share: NonNegative = 0.4
    """Increase of `max_angle_mismatch_deg` divided by the steering angle [-]. The steering angle is the larger of the
    measured angle and the angle derived from the yaw rate. Assumed value (range 0.3-0.6), which covers sliding wheels.
    """
    angle_mismatch_s: Positive = 1.0
    """Maximum duration of a mismatch between steering angle and yaw rate [s]. Assumed value (range 0.5-1.5), which
    covers the lag of wheels and tyres."""
    max_unseen_turn_deg_s: Positive = 2.0
    """Maximum yaw-rate change derived from the steering angle while the gyro repeats one value for `max_repeat_s`
    [deg/s]. Assumed value (range 1-4), above the gyro resolution of 0.1 deg/s."""
    max_repeat_s: Positive = 0.4
    """Maximum duration of a repeated position, roll or pitch while moving, or of a repeated yaw rate while turning [s].
    Assumed value (range 0.2-1): the noise of a working sensor prevents repetition."""
    max_course_mismatch_deg: Positive = 8.0
    """Maximum rotation of the direction of motion relative to the gyro heading [deg]: angle between the means of the
    fix velocity in the gyro frame over 2 s and 10 s. The limit increases below 0.8 m/s. Assumed value (range 6-15):
    ridges at 3 m/s cause 6 deg, and a gyro bias of 1 deg/s causes 8 deg."""
    max_fix_drift_m: Positive = 0.3
    """Maximum difference between fix positions and integrated fix velocities, accumulated over about 60 s [m]. The
    limit is higher for receivers with a low rate and on rough ground. Assumed value (range 0.3-1): white velocity noise
    of 3 cm/s causes 0.04 m.
    """
    max_reckoning_sigma: Positive = 5.0
    """Maximum distance of a fix from the position by dead reckoning over the last 30 s, in standard deviations [-].
    Assumed value (range 4-6): fault-free runs reach 2, or 4 on a slope of 15 deg at 2 m/s or with a towed implement."""
    reckoning_s: Positive = 0.6
    """Maximum duration of a deviation of the fixes from dead reckoning [s]. Assumed value (range 0.5-2), longer than
    the interval between two checked fixes."""
    max_tilt_mismatch_deg: Positive = 6.0
    """Maximum error of roll or pitch relative to the tilt derived from the specific force, averaged over 4 s [deg].
    Assumed value (range 4-10): an acceleration of 0.5 m/s2 causes 3 deg, and ridges of 3 cm at 3 m/s up to 4.5 deg.
    """
    max_attitude_age_s: Positive = 2.0
    """Maximum time without angles from the inertial unit [s]. Assumed value (range 1-5), shorter than a turn."""

    def limits(self, machine: TractorParameters) -> "Limits":
        """Return the limits for a tractor, as numbers for compiled kernels."""
        keys = (getattr(self, key) for key in SupervisorLimits.model_fields)
        return Limits._make((*keys, machine.tightest_radius, machine.wheelbase_m))


if TYPE_CHECKING:
    Limits: TypeAlias = Any
else:
    Limits = NamedTuple("Limits", [(key, float) for key in (*SupervisorLimits.model_fields, "radius", "wheelbase")])
"""Values of the keys of `SupervisorLimits`, followed by minimum turning radius and wheelbase of the tractor [m]."""


Checks = tuple[tuple[float, float, float], ...]
"""Signal, limit, and maximum duration above the limit [s] of each monitor; an unavailable signal is NaN."""


@jit
def checks(
    most: Limits, w: MonitorSignals, e: Estimate, m: Sensed, fix: Fix, steer: float, reckoned: tuple[float, float]
) -> Checks:
    """Return the signal, limit and maximum duration of all monitors, in order of priority.

    The first monitor that requires a stop determines the reason. `reckoned` contains the distance of a fix from dead
    reckoning and the standard deviation of this distance [m].
    """
    attitude = w.attitude
    return (
        *_of_estimate(most, w, e),
        *_of_motion(most, w, e, m),
        *_of_fixes(most, w.evidence, m, fix, reckoned),
        *_of_turns(most, w, e, m, steer),
        (max(attitude.repeats[0], attitude.repeats[1]), most.max_repeat_s, 0.0),
        (degrees(tilt_error(attitude)), most.max_tilt_mismatch_deg, 0.0),
        (attitude.silent_s, most.max_attitude_age_s, 0.0),
    )


@jit
def over(check: tuple[float, float, float], time: float, dt: float) -> float:
    """Return the weighted time for which a signal has exceeded its limit [s], after a tick of `dt` [s].

    The weight is the ratio of signal to limit. The result is 0 for a signal within the limit, and the unchanged `time`
    for a NaN signal.
    """
    signal, limit, _ = check
    if isnan(signal):
        return time
    return time + min(signal / limit, MAX_RATIO) * dt if signal > limit else 0.0


@jit
def _of_estimate(most: Limits, w: MonitorSignals, e: Estimate) -> Checks:
    acquired = w.closest <= most.max_cross_track_m
    aligning = most.max_realigning_s if w.tracked else most.max_aligning_s
    farthest = most.max_cross_track_m if acquired else w.closest + CLOSER_M + STRAYING_M + TURNED_AWAY * most.radius
    return (
        (w.fix_age, most.max_fix_age_s, 0.0),
        (e.position_sigma, most.max_sigma_m, 0.0),
        (e.nis_mean, most.max_nis, 0.0),
        (w.offset if w.tracked else 0.0, farthest, 0.0),
        (0.0 if acquired else w.closing_s, most.max_acquiring_s, 0.0),
        (w.aligning_s, aligning, 0.0),
    )


@jit
def _of_motion(most: Limits, w: MonitorSignals, e: Estimate, m: Sensed) -> Checks:
    u, agreed = abs(e.speed), _agreed_speed(w.evidence, m)
    return (
        (degrees(abs(w.mismatch)), most.max_steer_mismatch_deg, most.steer_mismatch_s),
        (max(u, agreed), most.max_overspeed * w.allowed + OVERSPEED_M_S, most.overspeed_s),
        (agreed - u, _wheel_lag(most, agreed), most.outvoted_s),
        (abs(w.pedal_mismatch), most.max_pedal_mismatch, most.pedal_mismatch_s),
        (abs(w.pedal_rate), most.max_pedal_rate_per_s, 0.0),
    )


@jit
def _of_fixes(most: Limits, proof: Evidence, m: Sensed, fix: Fix, reckoned: tuple[float, float]) -> Checks:
    speed, wheels = sqrt(fix.vx * fix.vx + fix.vy * fix.vy), copysign(1.0, m.pedal) * m.wheel_speed
    return (
        (proof.repeated_s, most.max_repeat_s, 0.0),
        (drift_of(proof), most.max_fix_drift_m + DRIFT_SIGMAS * sqrt(proof.variance), 0.0),
        (reckoned[0], most.max_reckoning_sigma * reckoned[1], most.reckoning_s),
        (speed - wheels, _wheel_lag(most, speed), most.wheel_lag_s),
    )


@jit
def _of_turns(most: Limits, w: MonitorSignals, e: Estimate, m: Sensed, steer: float) -> Checks:
    angle, turning = degrees(steer), _required_angle(most, e, m.gyro)
    tolerated = most.max_angle_mismatch_deg + most.max_angle_mismatch_share * max(abs(angle), abs(turning))
    course = most.max_course_mismatch_deg * max(1.0, SWAYING_M_S / max(abs(e.speed), COURSE_M_S))
    return (
        (abs(turning - angle), tolerated, most.angle_mismatch_s),
        (_unseen_turn(most, e, m, w.gyro), most.max_unseen_turn_deg_s, 0.0),
        (degrees(course_error(w.turn)), course, 0.0),
    )


@jit
def _wheel_lag(most: Limits, speed: float) -> float:
    return float(most.max_wheel_lag_m_s + most.max_wheel_lag_share * speed)


@jit
def _unseen_turn(most: Limits, e: Estimate, m: Sensed, gyro: GyroEvidence) -> float:
    """Return the yaw-rate change derived from the steering angle since the gyro value last changed [deg/s]."""
    if m.t - gyro.t < most.max_repeat_s:
        return 0.0
    return degrees(abs(e.speed * (tan(m.steer) - tan(gyro.steer)) / most.wheelbase))


@jit
def _required_angle(most: Limits, e: Estimate, gyro: float) -> float:
    """Return the steering angle [deg] for the measured or, without a gyro, estimated yaw rate; NaN at low speed."""
    rate = e.yaw_rate if isnan(gyro) else gyro
    return degrees(atan(most.wheelbase * rate / e.speed)) if abs(e.speed) > MOVING_M_S else nan


@jit
def _agreed_speed(proof: Evidence, m: Sensed) -> float:
    """Return the speed [m/s] on which wheels and newest fix agree, or 0 if the speeds differ or one is missing."""
    fixes, wheels = sqrt(proof.fix.vx * proof.fix.vx + proof.fix.vy * proof.fix.vy), abs(m.wheel_speed)
    if m.t - proof.t > GAP_S:
        return 0.0
    return min(fixes, wheels) if abs(fixes - wheels) < OVERSPEED_M_S + AGREEING * wheels else 0.0
