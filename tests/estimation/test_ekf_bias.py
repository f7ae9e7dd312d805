"""`ekf_bias` compared with the paper's estimator, alone and in closed loop."""

from math import degrees, hypot, nan, radians

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.kernels import fetched, held
from agrobot_mj.core.signals import Fix, Measurement, Quality
from agrobot_mj.estimation import Ekf, EkfBias
from agrobot_mj.estimation.pose_estimator import PoseState
from agrobot_mj.estimation.velocity_kf import rotate_velocity
from agrobot_mj.machine.tractor import TractorParameters

DT, TRACTOR = 0.05, TractorParameters()
LOSS = {"fault": [{"kind": "gnss_loss", "start_s": 25.0, "end_s": 30.0}]}


def measurements(n, radius=10.0, lost=()):
    """Yield noise-free measurements on a circle."""
    for k in range(1, n):
        angle = 1.2 * k * DT / radius
        fix = Fix(radius * np.sin(angle), radius * (1 - np.cos(angle)), 1.2 * np.cos(angle), 1.2 * np.sin(angle))
        yield Measurement(k * DT, None if k in lost else fix, Quality.FIX, np.arctan(1.4 / radius), 0.0, nan)


def test_ekf_bias_without_additional_states_equals_ekf():
    plain = EkfBias(
        turning_velocity=False,
        steer_bias_walk_deg_rt_s=0.0,
        initial_steer_bias_sigma_deg=0.0,
        gnss_correlated_fraction=0.0,
    )
    states = [estimator.init(0.0, 0.0, 0.05, TRACTOR) for estimator in (plain, Ekf())]
    for measurement in measurements(600, lost=range(300, 340)):
        states[0], ours = plain.update(states[0], measurement, DT)
        states[1], paper = Ekf().update(states[1], measurement, DT)
        assert ours[:7] == pytest.approx(paper[:7], abs=1e-9)
        assert np.allclose(ours.covariance, paper.covariance, atol=1e-12)
        assert ours.steer_bias == 0.0
        assert np.isnan(paper.steer_bias)


@pytest.mark.parametrize("kind", [Ekf, EkfBias])
def test_innovation_statistic_is_reported_only_with_a_fix(kind):
    estimator = kind()
    state, lost = estimator.init(0.0, 0.0, 0.0, TRACTOR), range(10, 20)
    for k, measurement in enumerate(measurements(40, lost=lost), start=1):
        state, estimate = estimator.update(state, measurement, DT)
        assert np.isnan(estimate.nis) == (k in lost)


def test_rotated_velocity_keeps_magnitude_and_covariance_eigenvalues():
    mean, P = np.array([1.0, 1.2, 2.0, 0.5]), np.diag([0.01, 0.02, 0.03, 0.05])
    after, Q = rotate_velocity(mean, P, 0.3)
    assert after[[0, 2]] == pytest.approx([1.0, 2.0])
    assert hypot(after[1], after[3]) == pytest.approx(1.3)
    assert np.arctan2(after[3], after[1]) == pytest.approx(np.arctan2(0.5, 1.2) + 0.3)
    assert np.linalg.eigvalsh(Q) == pytest.approx(np.linalg.eigvalsh(P))


def test_speed_estimate_is_kept_in_a_bend_without_a_fix():
    """In ten seconds on a circle of 10 m the heading changes by 1.2 rad; a constant velocity would lose speed."""

    def speed(estimator):
        state = estimator.init(0.0, 0.0, 0.0, TRACTOR)
        for measurement in measurements(600, lost=range(400, 600)):
            state, estimate = estimator.update(state, measurement, DT)
        return estimate.speed

    assert speed(EkfBias()) == pytest.approx(1.2, abs=0.02)
    assert speed(Ekf()) < 0.7


def slope(**estimator):
    return run(
        load_scenario(
            "straight_line",
            {
                "duration_s": 32.0,
                "terrain": {"kind": "slope", "grade_deg": 10.0, "direction_deg": 90.0},
                "sensors.imu.enabled": True,
                "estimator": {"terrain_compensation": True, **estimator},
                **LOSS,
            },
        )
    )


def test_course_on_a_side_slope_is_kept_during_a_gnss_loss():
    """During five seconds without a fix, the steering angle that compensates the slope is not interpreted as a turn."""
    coasts, courses = [], []
    for kind in ("ekf", "ekf_bias"):
        log = slope(kind=kind)
        t = log.column("t")
        last = int(np.argmax(t > 29.94))
        coasts.append(abs((log.column("rear_y_hat") - log.column("rear_y"))[last]))
        before = (t > 15) & (t < 25)
        courses.append(degrees(np.mean(log.column("yaw_hat")[before])))
    assert coasts[1] < 0.5 * coasts[0]
    assert courses[0] > 1.0
    assert abs(courses[1]) < 0.4
    steer, bias = np.mean(log.column("steer")[before]), np.mean(log.column("steer_bias_hat")[before])
    assert bias == pytest.approx(steer, abs=radians(0.15))


def test_position_errors_on_level_ground_match_the_covariance():
    """The normalised squared error of a consistent filter is 2. The paper's EKF treats correlated error as motion."""

    def nees(kind):
        given = {"duration_s": 120.0, "plant.kind": "bicycle", "estimator.kind": kind}
        logs = [run(load_scenario("figure_eight", {**given, "seed": seed})) for seed in range(2)]
        return np.mean([log.column("position_nees")[400:].mean() for log in logs])

    assert 1.0 < nees("ekf_bias") < 3.0
    assert nees("ekf") > 4.0


@pytest.mark.parametrize("bias_deg", [2.0, -2.0])
@pytest.mark.parametrize("side", [1, -1])
def test_yaw_rate_in_a_bend_uses_the_bias_corrected_steering_angle(side, bias_deg):
    """The yaw rate follows the wheels, not the biased sensor. Bends in both directions check the signs."""
    estimator, radius = EkfBias(yaw_rate_source="kinematic"), 10.0
    state = estimator.init(0.0, 0.0, 0.0, TRACTOR)
    for measurement in measurements(1200, side * radius):
        biased = measurement._replace(steer=measurement.steer + radians(bias_deg))
        state, estimate = estimator.update(state, biased, DT)
    assert degrees(estimate.steer_bias) == pytest.approx(bias_deg, abs=0.15)
    assert estimate.yaw_rate == pytest.approx(side * 1.2 / radius, rel=0.02)


@pytest.mark.parametrize("side", [1, -1])
def test_velocity_without_fixes_rotates_with_corrected_steering_angle(side):
    estimator, radius, bias = EkfBias(), 10.0, radians(4.0)
    state = estimator.init(0.0, 0.0, 0.0, TRACTOR)
    pose, P = np.array([0.0, 0.0, 0.0, bias, 0.0, 0.0]), np.diag([1e-6, 1e-6, 1e-6, 1e-9, 1e-6, 1e-6])
    start = PoseState(np.array([0.0, 1.2, 0.0, 0.0]), fetched(state.numbers).motion_covariance, pose, P)
    state = state._replace(numbers=held(start))
    for measurement in measurements(51, side * radius, lost=range(51)):
        biased = measurement._replace(steer=measurement.steer + bias)
        state, estimate = estimator.update(state, biased, DT)
    turned_by = side * 1.2 * 50 * DT / radius
    _, vx, _, vy = fetched(state.numbers).motion
    assert np.arctan2(vy, vx) == pytest.approx(turned_by, rel=0.01)
    assert estimate.yaw == pytest.approx(turned_by, rel=0.01)
    assert estimate.speed == pytest.approx(1.2, rel=1e-3)
