"""The compiled steps of the filters against filterpy's own, whose place they take."""

from copy import deepcopy

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter

from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.ekf import PoseEkf
from agrobot_mj.estimation.ekf_bias import BiasEkf, Levels
from agrobot_mj.estimation.equations import applied, inverse, posterior, prior, times
from agrobot_mj.estimation.kalman import Workspace
from agrobot_mj.estimation.velocity_kf import VelocityKf


def covariance(rng, n):
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


def extended(states, measured, predicted):
    """filterpy's extended filter, with the model of a prior mean."""
    kf = ExtendedKalmanFilter(dim_x=states, dim_z=measured)
    kf.predict_x = lambda u: setattr(kf, "x", predicted(kf.x, u))
    return kf


def close(ours, theirs):
    return np.allclose(ours.x, theirs.x, rtol=1e-9, atol=1e-9) and np.allclose(ours.P, theirs.P, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("n", "m"), [(3, 2), (4, 4), (6, 2), (10, 7), (11, 1)])
def test_a_hundred_ticks_equal_filterpys(n, m):
    """Extended filter with a curved model, a third of the measurements missing."""
    rng = np.random.default_rng(n)
    H, R, Q = rng.standard_normal((m, n)), covariance(rng, m), covariance(rng, n)
    F = np.eye(n) + 0.1 * rng.standard_normal((n, n)) / n

    def curved(x, u):
        return F @ x + u * np.sin(x)

    split, joined, theirs = Workspace(n, m), Workspace(n, m), extended(n, m, curved)
    theirs.x, theirs.P, theirs.F, theirs.Q = np.ones(n), np.eye(n), F, Q
    belief = np.ones(n), np.eye(n)
    for k in range(100):
        z = None if k % 3 == 0 else rng.standard_normal(m)
        theirs.predict(0.1)
        theirs.update(z, lambda x: H, lambda x: H @ x, R=R)
        x = curved(belief[0], 0.1)
        y = None if z is None else z - H @ x
        apart = split.predict(x, belief[1], F, Q)
        *belief, nis = joined.tick(x, belief[1], F, Q, y, H, R)
        if y is not None:
            *apart, same = split.update(*apart, y, H, R)
            assert same == nis == pytest.approx(theirs.y @ theirs.SI @ theirs.y, rel=1e-9)
            assert np.allclose(joined.kf.S, theirs.S, rtol=1e-9)
        assert all(map(np.array_equal, belief, apart))
        assert close(joined.kf, theirs)
        assert close(split.kf, theirs)


def test_the_velocity_filter_equals_filterpys():
    rng, ours, theirs = np.random.default_rng(0), VelocityKf(0.1), KalmanFilter(dim_x=4, dim_z=4)
    assert type(ours.kf) is KalmanFilter
    R = covariance(rng, 4)
    belief = theirs.x, theirs.P = np.zeros(4), np.eye(4)
    for k in range(50):
        fix = None if k % 4 == 0 else Fix(*rng.standard_normal(4))
        belief = ours.step(*belief, fix, R, 0.05)
        theirs.predict(F=ours.kf.F, Q=ours.kf.Q)
        theirs.update(fix and np.array((fix.x, fix.vx, fix.y, fix.vy)), R=R, H=np.eye(4))
        assert close(ours.kf, theirs)


@pytest.mark.parametrize(
    "ours", [PoseEkf(1.4, 0.01, 0.005), BiasEkf(1.4, Levels(0.01, 0.005, 0.002, 0.5, 30.0))], ids=["ekf", "ekf_bias"]
)
def test_the_pose_filters_equal_filterpys(ours):
    n, rng = ours.kf.dim_x, np.random.default_rng(1)
    assert type(ours.kf) is ExtendedKalmanFilter
    theirs = extended(n, 2, lambda x, inputs: ours.step(x, np.eye(n), inputs, None, 0.02)[0])
    belief = theirs.x, theirs.P = np.zeros(n), 0.01 * np.eye(n)
    for k in range(200):
        fix, inputs = None if k % 3 == 1 else Fix(*(0.06 * k + rng.standard_normal(2)), 0.0, 0.0), (1.2, 0.1, 0.05)
        *belief, _ = ours.step(*belief, inputs, fix, 0.02)
        kf = deepcopy(ours).kf
        theirs.F, theirs.Q = kf.F, kf.Q
        theirs.predict(inputs)
        H = None if fix is None else kf.H
        theirs.update(fix and np.array((fix.x, fix.y)), lambda x, H=H: H, lambda x, H=H: H @ x, R=kf.R)
        assert close(kf, theirs)


def test_compiled_equations_equal_the_plain_ones():
    """The same Python run by the interpreter, to the last bit; and what numpy makes of the matrices."""
    rng = np.random.default_rng(3)
    P, F, H, R = covariance(rng, 5), rng.standard_normal((5, 5)), rng.standard_normal((2, 5)), covariance(rng, 2)
    x, y = rng.standard_normal(5), rng.standard_normal(2)
    arguments = {prior: (P, F, covariance(rng, 5)), posterior: (x, P, H, y, R), inverse: (P,)}
    for compiled, given in arguments.items():
        plain = getattr(compiled, "py_func", compiled)
        for one, other in zip(compiled(*given), plain(*given), strict=True):
            assert np.array_equal(one, other)
    assert np.allclose(times(F, P), F @ P, rtol=1e-14, atol=1e-14)
    assert np.allclose(applied(H, x), H @ x, rtol=1e-14, atol=1e-14)
    assert np.allclose(inverse(P), np.linalg.inv(P), rtol=1e-10)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_refuses_an_innovation_without_a_covariance(bad):
    one = np.eye(2)
    with pytest.raises(np.linalg.LinAlgError, match=r"infs or NaNs|not positive"):
        posterior(np.zeros(2), 0 * one, one, np.ones(2), np.diag((bad, bad)))
