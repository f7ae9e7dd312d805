import numpy as np
import pytest
from scipy.linalg import expm

from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.velocity_kf import VelocityKf, process_noise, transition

DT, WALK = 0.05, 0.1
NOISE = np.diag(np.square([0.02, 0.03, 0.02, 0.03]))
RATES = np.kron(np.eye(2), [[0.0, 1.0], [0.0, 0.0]])  # System matrix of the continuous-time dynamics of (x, vx, y, vy)


def fixes(ticks, seed=0):
    """Yield noisy fixes of a turn at 1.2 m/s, a third of them missing (None), some for a second."""
    rng = np.random.default_rng(seed)
    for k in range(ticks):
        yaw = 0.12 * k * DT
        clean = [10 * np.sin(yaw), 1.2 * np.cos(yaw), 10 - 10 * np.cos(yaw), 1.2 * np.sin(yaw)]
        x, vx, y, vy = clean + np.sqrt(np.diag(NOISE)) * rng.standard_normal(4)
        missing = k % 60 in range(20, 40) or rng.random() < 0.1
        yield None if missing else Fix(x=x, y=y, vx=vx, vy=vy)


def test_transition_equals_the_matrix_exponential():
    assert np.allclose(transition(0.3), expm(RATES * 0.3), atol=1e-14)


def test_process_noise_equals_integrated_white_acceleration():
    """The reference is Gaussian quadrature with twenty points, exact for the quadratic integrand."""
    dt = 0.3
    places, weights = np.polynomial.legendre.leggauss(20)
    enter = np.kron(np.eye(2), [[0.0], [1.0]]) * WALK
    effects = [expm(RATES * t) @ enter for t in (places + 1) * dt / 2]
    integral = sum(weight * effect @ effect.T for weight, effect in zip(weights, effects, strict=True)) * dt / 2
    assert np.allclose(process_noise(WALK, dt), integral, rtol=1e-9)


def test_uncertainty_without_a_fix_is_independent_of_the_time_step():
    def grown(ticks):
        mean, covariance = np.array([0.0, 1.0, 0.0, 2.0]), np.diag([0.1, 0.2, 0.3, 0.4])
        for _ in range(ticks):
            mean, covariance = VelocityKf(WALK).step(mean, covariance, None, NOISE, 1.0 / ticks)
        return mean, covariance

    for one, many in zip(grown(1), grown(20), strict=True):
        assert np.allclose(one, many, rtol=1e-12)


def test_filter_equals_plain_numpy_with_missed_fixes():
    """The reference uses the short form P = (I - K H) P and solves a linear system instead of inverting."""
    ours, kf = (np.zeros(4), np.eye(4)), VelocityKf(WALK)
    x, P = np.zeros(4), np.eye(4)
    F = np.eye(4) + RATES * DT
    missed = 0
    for fix in fixes(2000):
        ours = kf.step(*ours, fix, NOISE, DT)
        x, P = F @ x, F @ P @ F.T + process_noise(WALK, DT)
        if fix is None:
            missed += 1
        else:
            K = np.linalg.solve(P + NOISE, P).T
            x, P = x + K @ (np.array([fix.x, fix.vx, fix.y, fix.vy]) - x), P - K @ P
        assert np.allclose(ours[0], x, rtol=0, atol=1e-9)
        assert np.allclose(ours[1], P, rtol=0, atol=1e-9)
    assert 500 < missed < 1500


def test_repeated_step_with_equal_arguments_gives_equal_results():
    kf, start = VelocityKf(WALK), (np.zeros(4), np.eye(4))
    fix = Fix(0.1, 0.2, 1.0, -1.0)
    first = kf.step(*start, fix, NOISE, DT)
    kf.step(np.ones(4), 3 * np.eye(4), None, NOISE, 2 * DT)
    again = kf.step(*start, fix, NOISE, DT)
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert np.array_equal(start[0], np.zeros(4))


def test_filter_reduces_velocity_noise():
    mean, covariance, kf, rng = np.zeros(4), np.eye(4), VelocityKf(WALK), np.random.default_rng(0)
    speeds = []
    for k in range(1000):
        x, vx, y, vy = [1.2 * k * DT, 1.2, 0.0, 0.0] + np.sqrt(np.diag(NOISE)) * rng.standard_normal(4)
        mean, covariance = kf.step(mean, covariance, Fix(x, y, vx, vy), NOISE, DT)
        speeds.append(mean[1])
    spread = np.std(speeds[100:])
    assert spread < 0.7 * 0.03
    assert spread < np.sqrt(covariance[1, 1]) < 0.03  # the filter assumes a random walk, which the truth lacks
    assert np.mean(speeds[100:]) == pytest.approx(1.2, abs=0.005)


def test_process_noise_of_two_steps_equals_the_noise_of_one_long_step():
    """The velocity variance grows linearly with time; two steps give the noise of one step of the total length."""
    walk, a, b = 0.3, 0.05, 0.12
    F = np.kron(np.eye(2), [[1.0, b], [0.0, 1.0]])
    both = F @ process_noise(walk, a) @ F.T + process_noise(walk, b)
    assert process_noise(walk, a + b) == pytest.approx(both, rel=1e-12)
    assert process_noise(walk, a)[[1, 3], [1, 3]] == pytest.approx(walk**2 * a)
