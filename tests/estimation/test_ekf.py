from math import cos, degrees, nan, pi, radians, sin, sqrt, tan
from typing import NamedTuple

import numpy as np
import pytest
from pydantic import ValidationError

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array, Estimate, Fix, Measurement, Quality
from agrobot_mj.estimation import Ekf, EkfBias
from agrobot_mj.machine.tractor import TractorParameters

DT = 0.05
TRACTOR = TractorParameters()
STEER_NOISE = radians(0.06)  # Standard deviation of the filtered potentiometer measurement [rad]


class Step(NamedTuple):
    """True pose of the rear-axle point R, and the estimate in the same tick."""

    pose: Array
    yaw_rate: float
    estimate: Estimate

    @property
    def error(self):
        e = self.estimate
        return np.array(
            [e.rear_x - self.pose[0], e.rear_y - self.pose[1], wrap(e.yaw - self.pose[2])],
        )


def measure(t, pose, speed, steer, rng, sigma=0.02, quality=Quality.FIX, gyro=0.0):
    """Return a measurement with white noise only."""
    w = rng.standard_normal(5)
    vx, vy = speed * cos(pose[2]), speed * sin(pose[2])
    fix = Fix(pose[0] + sigma * w[0], pose[1] + sigma * w[1], vx + 0.03 * w[2], vy + 0.03 * w[3])
    fix = None if quality == Quality.NONE else fix
    return Measurement(t, fix, quality, steer + STEER_NOISE * w[4], 0.0, gyro)


def drive(
    estimator,
    duration,
    speed=1.2,
    steer=lambda t: 0.0,
    yaw=0.3,
    yaw_error=0.0,
    seed=1,
    quality=lambda t: Quality.FIX,
    sigma=0.02,
):
    """Run the estimator on circular arcs of R with white sensor noise. Return the steps."""
    rng, pose = stream(seed, "test"), np.array([5.0, -3.0, yaw])
    state, steps = estimator.init(*pose[:2], yaw + yaw_error, TRACTOR), []
    for k in range(round(duration / DT)):
        delta, t = steer(k * DT), (k + 1) * DT
        turn = speed * tan(delta) / TRACTOR.wheelbase_m * DT
        chord = speed * DT * np.sinc(turn / (2 * pi))
        middle = pose[2] + turn / 2
        pose = pose + np.array([chord * cos(middle), chord * sin(middle), turn])
        measurement = measure(t, pose, speed, delta, rng, sigma, quality(t), turn / DT)
        state, estimate = estimator.update(state, measurement, DT)
        steps.append(Step(pose, turn / DT, estimate))
    return steps


def errors(steps):
    return np.array([step.error for step in steps])


def turning(t):
    return 0.15 if t % 60 < 30 else -0.15


@pytest.mark.parametrize("yaw_error_deg", [5.0, -8.0, 12.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_wrong_initial_yaw_is_corrected_within_ten_seconds(yaw_error_deg, seed):
    steps = drive(Ekf(), 20, yaw_error=radians(yaw_error_deg), seed=seed)
    yaw_errors = np.abs(errors(steps)[:, 2])
    assert degrees(yaw_errors[0]) == pytest.approx(abs(yaw_error_deg), rel=0.3)
    assert degrees(yaw_errors[200:].max()) < 1.0


def test_initial_covariance_follows_from_the_initial_sigma_keys():
    keys = {"initial_position_sigma_m": 0.4, "initial_yaw_sigma_deg": 3.0}
    (first,) = drive(Ekf(**keys), DT, speed=0.0, quality=lambda t: Quality.NONE)
    expected = [0.4, 0.4, radians(3.0)]
    assert np.allclose(np.sqrt(np.diag(first.estimate.covariance)), expected, rtol=1e-3)


def test_estimated_position_is_more_accurate_than_fixes():
    rms = np.sqrt(np.mean(errors(drive(Ekf(), 60, steer=turning)[200:]) ** 2, axis=0))
    assert rms[:2].max() < 0.4 * 0.02
    assert degrees(rms[2]) < 0.4


def test_errors_from_white_noise_are_consistent_with_the_covariance():
    """The expected mean normalised squared position error is 2, or less because the truth has no random walk."""
    nees = []
    for seed in range(4):
        for step in drive(Ekf(), 60, steer=turning, seed=seed)[200:]:
            error, covariance = step.error[:2], step.estimate.covariance[:2, :2]
            nees.append(error @ np.linalg.solve(covariance, error))
    assert 1.0 < np.mean(nees) < 2.4


def test_covariance_remains_symmetric_and_positive_definite():
    def quality(t):
        return (Quality.NONE, Quality.FLOAT, Quality.FIX, Quality.FIX)[int(t / 5) % 4]

    for step in drive(Ekf(), 240, steer=turning, quality=quality):
        P = step.estimate.covariance
        assert np.abs(P - P.T).max() < 1e-12 * np.abs(P).max()
        assert np.linalg.eigvalsh(P).min() > 0


def test_position_uncertainty_grows_until_the_next_fix_reduces_it():
    steps = drive(Ekf(), 40, quality=lambda t: Quality.NONE if 20 < t <= 30 else Quality.FIX)
    spread = np.array([np.trace(step.estimate.covariance[:2, :2]) for step in steps])
    assert (np.diff(spread[402:600]) > 0).all()
    assert spread[599] > 10 * spread[399]
    assert spread[620] < 2 * spread[399]


def test_dead_reckoning_continues_the_estimate_during_a_fix_gap():
    """For ten seconds (12 m), the position error grows due to the speed and yaw errors at the start of the gap."""
    steps = drive(Ekf(), 30, quality=lambda t: Quality.NONE if 20 < t <= 30 else Quality.FIX)
    last = steps[-1]
    assert np.linalg.norm(last.error[:2]) < 4 * sqrt(np.trace(last.estimate.covariance[:2, :2]))
    assert np.linalg.norm(last.error[:2]) < 0.5


def test_fixes_of_float_quality_are_weighted_less_than_rtk_fixes():
    """With fix errors of 0.3 m, an estimator with the true quality is better than one that assumes RTK fixes."""

    def rms(quality):
        steps = drive(Ekf(), 60, sigma=0.3, quality=lambda t: quality)
        return np.sqrt(np.mean(errors(steps)[200:, :2] ** 2))

    assert rms(Quality.FLOAT) < 0.6 * rms(Quality.FIX)


def test_estimated_position_is_the_centre_of_gravity():
    for step in drive(Ekf(), 5, steer=turning)[::10]:
        e = step.estimate
        l_r = TRACTOR.cg_to_rear_axle
        assert e.x - e.rear_x == pytest.approx(l_r * cos(e.yaw), abs=1e-12)
        assert e.y - e.rear_y == pytest.approx(l_r * sin(e.yaw), abs=1e-12)


def test_yaw_wrapping_does_not_disturb_the_yaw_rate_estimate():
    steps = drive(Ekf(), 90, steer=lambda t: 0.15)
    yaws = np.array([step.estimate.yaw for step in steps])
    assert (np.abs(yaws) <= pi).all()
    assert np.abs(np.diff(yaws)).max() > 6.0
    assert max(abs(step.estimate.yaw_rate - step.yaw_rate) for step in steps[100:]) < 0.06


@pytest.mark.parametrize("speed", [0.0, 1.2, -0.8])
def test_estimated_speed_is_unbiased_and_negative_in_reverse(speed):
    speeds = np.array([step.estimate.speed for step in drive(Ekf(), 120, speed=speed)[100:]])
    n_independent = len(speeds) / 10
    assert speeds.mean() == pytest.approx(speed, abs=5 * 0.02 / sqrt(n_independent))
    assert speeds.std() < 0.02


@pytest.mark.parametrize("seed", [1, 2])
def test_yaw_rate_noise_on_a_straight_is_small(seed):
    rates = np.array([step.estimate.yaw_rate for step in drive(Ekf(), 60, seed=seed)[200:]])
    assert abs(rates.mean()) < 0.002
    assert rates.std() < 0.012


def test_yaw_rate_filter_reduces_noise_and_adds_lag():
    def noise_and_lag(time_constant):
        estimator = Ekf(yaw_rate_filter_s=time_constant)
        noise = np.std([step.estimate.yaw_rate for step in drive(estimator, 60)[200:]])
        turn_in = drive(estimator, 30, steer=lambda t: 0.3 if t >= 20 else 0.0)[400:]
        fraction = np.array([step.estimate.yaw_rate / step.yaw_rate for step in turn_in])
        return noise, DT * np.argmax(fraction > 0.63)

    (raw, no_lag), (smooth, lag) = noise_and_lag(0.0), noise_and_lag(0.3)
    assert smooth < 0.5 * raw
    assert no_lag == 0.0
    assert 0.15 < lag < 0.5


def test_yaw_rate_is_taken_from_the_configured_source():
    steps = {
        source: drive(Ekf(yaw_rate_source=source), 20, steer=lambda t: 0.15)[-1]
        for source in ("ekf", "kinematic", "gyro")
    }
    assert steps["gyro"].estimate.yaw_rate == steps["gyro"].yaw_rate
    kinematic = steps["kinematic"].estimate
    assert kinematic.yaw_rate == pytest.approx(kinematic.speed * tan(0.15) / 1.4, rel=5 * STEER_NOISE / 0.15)
    assert kinematic.yaw_rate != steps["ekf"].estimate.yaw_rate
    assert [Ekf(yaw_rate_source=s).needs for s in steps] == [{}, {}, {"gyro": 'yaw_rate_source: "gyro"'}]


def test_repeated_update_with_equal_arguments_gives_equal_results():
    estimator, rng = Ekf(), stream(1, "test")
    state = estimator.init(0.0, 0.0, 0.1, TRACTOR)
    first, second = (measure(t, np.array([t, 0.0, 0.0]), 1.2, 0.1, rng) for t in (DT, 2 * DT))
    state, _ = estimator.update(state, first, DT)
    _, estimate = estimator.update(state, second, DT)
    _, again = estimator.update(state, second, DT)
    plain = estimate._replace(covariance=None, steer_bias=None)
    assert plain == again._replace(covariance=None, steer_bias=None)
    assert np.array_equal(estimate.covariance, again.covariance)


@pytest.mark.parametrize("key", ["gnss_sigma_m", "yaw_walk_deg_rt_s", "initial_yaw_sigma_deg"])
def test_zero_noise_sigma_is_rejected(key):
    with pytest.raises(ValidationError, match=key):
        Ekf(**{key: 0.0})


@pytest.mark.parametrize("kind", [Ekf, EkfBias])
def test_compiled_tick_equals_filters_evaluated_in_python(kind):
    class InPython(kind):
        def pose_filter(self, tractor):
            return super().pose_filter(tractor)

    keys = {"terrain_compensation": True, "yaw_rate_source": "kinematic"}
    estimators = kind(**keys), InPython(**keys)
    states = [estimator.init(1.0, 2.0, 0.3, TRACTOR) for estimator in estimators]
    assert [state.filters is None for state in states] == [True, False]
    rng = stream(3, "test")
    for k in range(100):
        quality = (Quality.NONE, Quality.FLOAT, Quality.FIX)[k % 3]
        measurement = measure(k * DT, (1.0 + 0.06 * k, 2.0, 0.0), 1.2, 0.1, rng, quality=quality)
        measurement = measurement._replace(roll=0.1 * (k % 5), pitch=nan if k % 7 == 0 else -0.05)
        found = [e.update(s, measurement, DT) for e, s in zip(estimators, states, strict=True)]
        states = [state for state, _ in found]
        assert str(found[0][1]) == str(found[1][1])
