"""The compiled filter steps give the results of filterpy."""

from copy import deepcopy
from math import nan

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.ekf import PoseEkf
from agrobot_mj.estimation.ekf_bias import BiasEkf, Levels
from agrobot_mj.estimation.equations import inverse, posterior, prior, product, times
from agrobot_mj.estimation.kalman import Filter, filterpy_ekf, filterpy_kf, tick
from agrobot_mj.estimation.velocity_kf import VelocityKf, process_noise, transition


def covariance(rng, n):
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


def close(ours, reference):
    return all(np.allclose(*pair, rtol=1e-9, atol=1e-9, equal_nan=True) for pair in zip(ours, reference, strict=True))


@pytest.mark.parametrize("filterpy", [filterpy_kf, filterpy_ekf])
@pytest.mark.parametrize(("n", "m"), [(3, 2), (4, 4), (6, 2), (10, 7), (11, 1)])
def test_one_hundred_filter_steps_equal_filterpy(n, m, filterpy):
    """The model is nonlinear, and a third of the measurements are missing."""
    rng = np.random.default_rng(n)
    H, R, Q = rng.standard_normal((m, n)), covariance(rng, m), covariance(rng, n)
    F = np.eye(n) + 0.1 * rng.standard_normal((n, n)) / n
    ours = reference = np.ones(n), np.eye(n), nan
    for k in range(100):
        z = None if k % 3 == 0 else rng.standard_normal(m)
        results = []
        for step, (mean, P, _) in ((tick, ours), (filterpy, reference)):
            x = F @ mean + 0.1 * np.sin(mean)
            results.append(step(x, P, F, Q, None if z is None else z - H @ x, H, R))
        ours, reference = results
        assert close(ours, reference)


@pytest.fixture
def ticks(monkeypatch):
    """Record the arguments of every filter tick, and compare the result of the tick with the result of filterpy."""
    recorded = []

    def compared(*arguments):
        recorded.append(arguments)
        result = tick(*arguments)
        assert close(result, filterpy_ekf(*arguments))
        return result

    monkeypatch.setattr(Filter, "tick", staticmethod(compared))
    return recorded


def test_velocity_filter_equals_filterpy(ticks):
    rng, ours, reference = np.random.default_rng(0), VelocityKf(0.1), KalmanFilter(dim_x=4, dim_z=4)
    R = covariance(rng, 4)
    belief = reference.x, reference.P = np.zeros(4), np.eye(4)
    for k in range(50):
        fix = None if k % 4 == 0 else Fix(*rng.standard_normal(4))
        belief = ours.step(*belief, fix, R, 0.05)
        reference.predict(F=transition(0.05), Q=process_noise(0.1, 0.05))
        reference.update(fix and np.array((fix.x, fix.vx, fix.y, fix.vy)), R=R, H=np.eye(4))
        assert close(belief, (reference.x, reference.P))
    assert len(ticks) == 50


@pytest.mark.parametrize(
    "ours", [PoseEkf(1.4, 0.01, 0.005), BiasEkf(1.4, Levels(0.01, 0.005, 0.002, 0.5, 30.0))], ids=["ekf", "ekf_bias"]
)
def test_pose_filters_equal_filterpy(ticks, ours):
    n, rng = 3 if isinstance(ours, PoseEkf) else 6, np.random.default_rng(1)
    belief = np.zeros(n), 0.01 * np.eye(n)
    for k in range(200):
        fix = None if k % 3 == 1 else Fix(*(0.06 * k + rng.standard_normal(2)), 0.0, 0.0)
        *belief, _ = deepcopy(ours).step(*belief, (1.2, 0.1, 0.05), fix, 0.02)
    assert [arguments[4] is None for arguments in ticks] == [k % 3 == 1 for k in range(200)]


def test_compiled_and_uncompiled_filter_equations_agree():
    """Results are bit-identical to the uncompiled Python code, and close to NumPy results."""
    rng = np.random.default_rng(3)
    P, F, H, R = covariance(rng, 5), rng.standard_normal((5, 5)), rng.standard_normal((2, 5)), covariance(rng, 2)
    x, y = rng.standard_normal(5), rng.standard_normal(2)
    arguments = {prior: (P, F, covariance(rng, 5)), posterior: (x, P, H, y, R), inverse: (P,)}
    for compiled, given in arguments.items():
        plain = getattr(compiled, "py_func", compiled)
        for one, other in zip(compiled(*given), plain(*given), strict=True):
            assert np.array_equal(one, other)
    assert np.allclose(times(F, P), F @ P, rtol=1e-14, atol=1e-14)
    assert np.allclose(product(H, x), H @ x, rtol=1e-14, atol=1e-14)
    assert np.allclose(inverse(P), np.linalg.inv(P), rtol=1e-10)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_singular_innovation_covariance_is_rejected(bad):
    one = np.eye(2)
    with pytest.raises(np.linalg.LinAlgError, match=r"infs or NaNs|not positive"):
        posterior(np.zeros(2), 0 * one, one, np.ones(2), np.diag((bad, bad)))
