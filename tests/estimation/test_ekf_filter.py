from math import hypot, pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.ekf import PoseEkf, f, jacobian

DT, WHEELBASE = 0.05, 1.4
SIGMA = 0.02
NOISE = np.diag(np.square([SIGMA, SIGMA]))
POSITION_WALK, YAW_WALK = 0.01, 0.005
Q = DT * np.diag(np.square([POSITION_WALK, POSITION_WALK, YAW_WALK]))


def ekf(position_walk=POSITION_WALK, yaw_walk=YAW_WALK):
    return PoseEkf(WHEELBASE, position_walk, yaw_walk)


def inputs(k):
    """Return speed and steering angle of a figure-eight, as in the paper's experiment."""
    return 1.2 + 0.3 * np.sin(0.01 * k), 0.15 * np.sign(np.sin(2 * pi * k * DT / 120))


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, 7.0])
@pytest.mark.parametrize("speed", [-1.0, 0.0, 1.2, 4.0])
def test_jacobian_equals_finite_differences(yaw, speed):
    pose, h = np.array([3.0, -2.0, yaw]), 1e-6
    columns = [
        (f(pose + h * e, speed, 0.3, WHEELBASE, DT) - f(pose - h * e, speed, 0.3, WHEELBASE, DT)) / (2 * h)
        for e in np.eye(3)
    ]
    assert np.allclose(jacobian(yaw, speed, DT), np.transpose(columns), atol=1e-8)


def test_state_transition_is_one_euler_step_of_the_kinematic_model():
    """The error relative to the exact solution is proportional to the square of the step."""
    start, speed, steer = np.array([1.0, 2.0, 0.7]), 1.2, 0.4

    def error(dt):
        def rates(_, p):
            return [speed * np.cos(p[2]), speed * np.sin(p[2]), speed * np.tan(steer) / WHEELBASE]

        exact = solve_ivp(rates, (0, dt), start, rtol=1e-12, atol=1e-12).y[:, -1]
        return np.abs(f(start, speed, steer, WHEELBASE, dt) - exact).max()

    assert error(0.05) < 1e-3
    assert error(0.1) / error(0.05) == pytest.approx(4.0, rel=0.05)


def test_filter_equals_plain_numpy_with_missed_fixes():
    """The reference uses the short form P = (I - K H) P and a separate implementation of the model."""
    rng, filter_ = np.random.default_rng(1), ekf()
    ours = (np.zeros(3), np.diag([0.01, 0.01, 0.01]))
    (x, y, psi), P = (0.0, 0.0, 0.0), ours[1]
    true_pose, missed = np.array([0.02, -0.01, 0.05]), 0
    for k in range(4800):
        u, delta = inputs(k)
        true_pose = f(true_pose, u, delta, WHEELBASE, DT)
        z = true_pose[:2] + 0.02 * rng.standard_normal(2)
        fix = None if k % 600 in range(300, 400) or rng.random() < 0.1 else Fix(*z, 0.0, 0.0)
        *ours, _ = filter_.step(*ours, (u, delta, DT), fix, SIGMA)

        dx, dy = DT * u * np.cos(psi), DT * u * np.sin(psi)
        F = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1]])
        x, y, psi = x + dx, y + dy, psi + DT * u * np.tan(delta) / WHEELBASE
        P = F @ P @ F.T + Q
        if fix is None:
            missed += 1
        else:
            K = np.linalg.solve(P[:2, :2] + NOISE, P[:2]).T
            x, y, psi = [x, y, psi] + K @ [fix.x - x, fix.y - y]
            P = P - K @ P[:2]
        assert np.allclose(ours[0], [x, y, psi], rtol=0, atol=1e-9)
        assert np.allclose(ours[1], P, rtol=0, atol=1e-9)
    assert 500 < missed < 2400
    assert hypot(x - true_pose[0], y - true_pose[1]) < 0.03


def test_filter_with_known_yaw_is_a_linear_kalman_filter():
    """With a known yaw each axis is a scalar filter driven by the speed, with an analytic steady-state gain."""
    rng, filter_, yaw, u = np.random.default_rng(2), ekf(yaw_walk=0.0), 0.6, 1.2
    mean, covariance = np.array([0.0, 0.0, yaw]), np.diag([0.01, 0.01, 0.0])
    axes, p = np.zeros(2), 0.01
    for k in range(400):
        z = np.array([np.cos(yaw), np.sin(yaw)]) * u * DT * (k + 1) + 0.02 * rng.standard_normal(2)
        mean, covariance, _ = filter_.step(mean, covariance, (u, 0.0, DT), Fix(*z, 0.0, 0.0), SIGMA)
        p += Q[0, 0]
        gain = p / (p + NOISE[0, 0])
        prior = axes + u * DT * np.array([np.cos(yaw), np.sin(yaw)])
        axes, p = prior + gain * (z - prior), (1 - gain) * p
        assert np.allclose(mean, [*axes, yaw], rtol=0, atol=1e-12)
        assert np.allclose(covariance, np.diag([p, p, 0.0]), rtol=0, atol=1e-15)
    q, r = Q[0, 0], NOISE[0, 0]
    assert p == pytest.approx((-q + np.sqrt(q * q + 4 * q * r)) / 2, rel=1e-9)


def walk(ticks, seed):
    """Yield true pose, mean, covariance and NIS per tick, for a truth that follows the filter's model."""
    rng, filter_ = np.random.default_rng(seed), ekf()
    covariance = np.diag(np.square([0.05, 0.05, 0.1]))
    mean = np.array([1.0, 2.0, 0.3])
    true_pose = mean + np.sqrt(np.diag(covariance)) * rng.standard_normal(3)
    for k in range(ticks):
        u, delta = inputs(k)
        true_pose = f(true_pose, u, delta, WHEELBASE, DT) + np.sqrt(np.diag(Q)) * rng.standard_normal(3)
        fix = Fix(*(true_pose[:2] + 0.02 * rng.standard_normal(2)), 0.0, 0.0)
        mean, covariance, nis = filter_.step(mean, covariance, (u, delta, DT), fix, SIGMA)
        yield true_pose, mean, covariance, nis


def test_innovations_match_their_predicted_covariance():
    nis = sum(step[3] for step in walk(2000, seed=3))
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 2 * 2000)
    assert low < nis < high


def test_estimation_errors_match_the_reported_covariance():
    """The normalised squared pose error at the end of independent runs is chi-square distributed."""
    runs, nees = 100, 0.0
    for seed in range(runs):
        *_, (true_pose, mean, covariance, _) = walk(60, seed)
        error = mean - true_pose
        nees += error @ np.linalg.solve(covariance, error)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 3 * runs)
    assert low < nees < high


def test_yaw_is_not_wrapped_inside_the_filter():
    filter_ = ekf()
    belief = (np.array([0.0, 0.0, 3.1]), 1e-4 * np.eye(3))
    for _ in range(200):
        mean, covariance, nis = filter_.step(*belief, (1.2, 0.4, DT), None, SIGMA)
        assert 0 < mean[2] - belief[0][2] < 0.05
        assert np.isnan(nis)
        belief = mean, covariance
    assert belief[0][2] > 6.0


def test_repeated_step_with_equal_arguments_gives_equal_results():
    filter_, start, fix = ekf(), (np.zeros(3), np.eye(3)), Fix(0.1, 0.2, 0.0, 0.0)
    first = filter_.step(*start, (1.2, 0.1, DT), fix, SIGMA)
    filter_.step(np.ones(3), 3 * np.eye(3), (2.0, 0.3, 2 * DT), None, SIGMA)
    again = filter_.step(*start, (1.2, 0.1, DT), fix, SIGMA)
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert first[2] == again[2]
    assert np.array_equal(start[0], np.zeros(3))
