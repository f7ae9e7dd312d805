from math import radians

import numpy as np
import pytest
from scipy.stats import chi2

from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.ekf import PoseEkf
from agrobot_mj.estimation.ekf_bias import BIAS, BiasEkf, Levels, f, jacobian

DT, WHEELBASE, SIGMA, PHI = 0.05, 1.4, 0.02, 0.99
LEVELS = Levels(0.01, radians(0.3), radians(0.1), 0.5, 30.0)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, 7.0])
@pytest.mark.parametrize("speed", [-1.0, 0.0, 1.2])
@pytest.mark.parametrize("bias", [0.0, -0.2])
def test_jacobian_equals_finite_differences(yaw, speed, bias):
    state, h = np.array([3.0, -2.0, yaw, bias, 0.5, -1.0]), 1e-6
    fixed = (speed, 0.3, WHEELBASE, DT, PHI)
    columns = [(f(state + h * e, *fixed) - f(state - h * e, *fixed)) / (2 * h) for e in np.eye(6)]
    assert np.allclose(jacobian(state, *fixed), np.transpose(columns), atol=1e-8)


def steering(k):
    return 0.15 * np.sign(np.sin(2 * np.pi * k * DT / 120))


def test_filter_without_additional_states_equals_ekf():
    rng = np.random.default_rng(1)
    ours, paper = BiasEkf(WHEELBASE, Levels(0.01, 0.005, 0.0, 0.0, 30.0)), PoseEkf(WHEELBASE, 0.01, 0.005)
    start = np.array([1.0, 2.0, 0.3])
    P = np.diag([0.01, 0.01, 0.02])
    a = (np.append(start, [0.0, 0.0, 0.0]), np.diag([0.01, 0.01, 0.02, 0.0, 1.0, 1.0]))
    b = (start, P)
    for k in range(2000):
        inputs = (1.2, steering(k), DT)
        fix = None if 500 < k < 600 else Fix(*rng.standard_normal(2), 0.0, 0.0)
        (*a, nis), (*b, paper_nis) = ours.step(*a, inputs, fix, SIGMA), paper.step(*b, inputs, fix, SIGMA)
        assert np.allclose(a[0][:3], b[0], rtol=0, atol=1e-9)
        assert np.allclose(a[1][:3, :3], b[1], rtol=0, atol=1e-12)
        assert nis == pytest.approx(paper_nis, rel=1e-6, nan_ok=True)


def observable_states(steer, sideslip):
    """Return the rank of the observability Gramian of x, y, yaw, bias (and sideslip) over two minutes."""
    n = 5 if sideslip else 4
    state, transition, gramian = np.zeros(6), np.eye(n), np.zeros((n, n))
    H = np.eye(2, n)
    for k in range(2400):
        F6 = jacobian(state, 1.2, steer(k), WHEELBASE, DT, 1.0)
        F = np.eye(n)
        F[:4, :4] = F6[:4, :4]
        if sideslip:
            F[:2, 4] = F6[:2, 2]  # same effect on R as the yaw
        gramian += transition.T @ H.T @ H @ transition
        transition = F @ transition
        state = f(state, 1.2, steer(k), WHEELBASE, DT, 1.0)
    scale = np.sqrt(np.diag(gramian))
    return np.linalg.matrix_rank(gramian / np.outer(scale, scale), tol=1e-9)


@pytest.mark.parametrize("steer", [lambda k: 0.0, steering], ids=["straight", "figure eight"])
def test_steering_bias_and_the_sum_of_yaw_and_sideslip_are_observable(steer):
    """On any path, the motion of R depends only on the sum of yaw and sideslip."""
    assert observable_states(steer, sideslip=False) == 4
    assert observable_states(steer, sideslip=True) == 4


def test_estimation_errors_match_the_reported_covariance():
    """Normalised squared errors at the end of independent runs and innovations are chi-square distributed."""
    runs, nees, nis, ticks = 100, 0.0, 0.0, 100
    sigmas = np.array([0.05, 0.05, 0.1, radians(1.0), 1.0, 1.0])
    phi = np.exp(-DT / LEVELS.correlation_time)
    own = np.sqrt(DT) * np.array([LEVELS.position_walk] * 2 + [LEVELS.yaw_walk, LEVELS.bias_walk, 0.0, 0.0])
    own[4:] = np.sqrt(1 - phi**2)
    for seed in range(runs):
        rng, filter_ = np.random.default_rng(seed), BiasEkf(WHEELBASE, LEVELS)
        belief = (np.array([1.0, 2.0, 0.3, 0.0, 0.0, 0.0]), np.diag(sigmas**2))
        truth = belief[0] + sigmas * rng.standard_normal(6)
        for _ in range(ticks):
            truth = f(truth, 1.2, 0.1, WHEELBASE, DT, phi) + own * rng.standard_normal(6)
            white = SIGMA * np.sqrt(1 - LEVELS.correlated_share**2) * rng.standard_normal(2)
            z = truth[:2] + LEVELS.correlated_share * SIGMA * truth[4:] + white
            *belief, innovation = filter_.step(*belief, (1.2, 0.1, DT), Fix(*z, 0.0, 0.0), SIGMA)
            nis += innovation
        error = belief[0] - truth
        nees += error @ np.linalg.solve(belief[1], error)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 6 * runs)
    assert low < nees < high
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 2 * runs * ticks)
    assert low < nis < high


def test_steering_potentiometer_offset_is_estimated():
    filter_, bias = BiasEkf(WHEELBASE, LEVELS), radians(2.0)
    belief = (np.zeros(6), np.diag(np.square([0.05, 0.05, 0.05, radians(1.0), 1.0, 1.0])))
    truth = np.zeros(6)
    for k in range(1200):
        truth = f(truth, 1.2, steering(k), WHEELBASE, DT, 1.0)
        *belief, _ = filter_.step(*belief, (1.2, steering(k) + bias, DT), Fix(truth[0], truth[1], 0.0, 0.0), SIGMA)
    assert belief[0][BIAS] == pytest.approx(bias, abs=radians(0.1))
    assert belief[0][2] == pytest.approx(truth[2], abs=radians(0.2))
