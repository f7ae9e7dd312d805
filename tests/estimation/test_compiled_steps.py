"""The compiled steps of the filters against filterpy's own, which they stand in for."""

import numpy as np
import pytest

from agrobot_mj.estimation.equations import applied, innovation, inverse, posterior, prior, times
from agrobot_mj.estimation.kalman import CompiledEkf, CompiledKalman, ExtendedKalmanFilter, KalmanFilter


def covariance(rng, n):
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


@pytest.mark.parametrize(("n", "m"), [(3, 2), (4, 4), (6, 2), (10, 7), (11, 1)])
def test_a_hundred_ticks_are_those_of_filterpy(n, m):
    """Extended filter with a curved model, a third of the measurements missing."""
    rng = np.random.default_rng(n)
    H, R, Q = rng.standard_normal((m, n)), covariance(rng, m), covariance(rng, n)
    F = np.eye(n) + 0.1 * rng.standard_normal((n, n)) / n

    def curved(base):
        class Curved(base):
            def predict_x(self, u):
                self.F, self.Q, self.x = F, Q, F @ self.x + u * np.sin(self.x)

        made = Curved(dim_x=n, dim_z=m)
        made.x, made.P = np.ones(n), np.eye(n)
        return made

    ours, theirs, joined = curved(CompiledEkf), curved(ExtendedKalmanFilter), curved(CompiledEkf)
    for k in range(100):
        z = None if k % 3 == 0 else rng.standard_normal(m)
        for filter_ in (ours, theirs):
            filter_.predict(0.1)
            filter_.update(z, lambda x: H, lambda x: H @ x, R=R)
        joined.advance(0.1, z, lambda x: H, lambda x: H @ x, R=R)
        assert np.array_equal(joined.x, ours.x)
        assert np.array_equal(joined.P, ours.P)
        assert np.allclose(ours.x, theirs.x, rtol=1e-9, atol=1e-9)
        assert np.allclose(ours.P, theirs.P, rtol=1e-9, atol=1e-9)
        if z is not None:
            assert ours.nis == pytest.approx(theirs.y @ theirs.SI @ theirs.y, rel=1e-9)
            assert joined.nis == ours.nis


def test_the_linear_filter_is_that_of_filterpy():
    rng = np.random.default_rng(0)
    F, Q, R = np.eye(4) + 0.1 * rng.standard_normal((4, 4)), covariance(rng, 4), covariance(rng, 4)
    ours, theirs, joined = (kind(dim_x=4, dim_z=4) for kind in (CompiledKalman, KalmanFilter, CompiledKalman))
    for filter_ in (ours, theirs, joined):
        filter_.H, filter_.x, filter_.P = np.eye(4), np.zeros(4), np.eye(4)
    for k in range(50):
        z = None if k % 4 == 0 else rng.standard_normal(4)
        for filter_ in (ours, theirs):
            filter_.predict(F=F, Q=Q)
            filter_.update(z, R=R)
        joined.advance(F, Q, z, R)
        assert np.array_equal(joined.x, ours.x)
        assert np.array_equal(joined.P, ours.P)
        assert np.allclose(ours.x, theirs.x, rtol=1e-10)
        assert np.allclose(ours.P, theirs.P, rtol=1e-10)


def test_compiled_equations_are_the_plain_ones():
    """The same Python run by the interpreter, to the last bit; and what numpy makes of the matrices."""
    rng = np.random.default_rng(3)
    P, F, H, R = covariance(rng, 5), rng.standard_normal((5, 5)), rng.standard_normal((2, 5)), covariance(rng, 2)
    x, y = rng.standard_normal(5), rng.standard_normal(2)
    arguments = {prior: (x, P, F, covariance(rng, 5)), posterior: (x, P, H, y, R), innovation: (y, H, x), inverse: (P,)}
    for compiled, given in arguments.items():
        plain = getattr(compiled, "py_func", compiled)
        for one, other in zip(compiled(*given), plain(*given), strict=True):
            assert np.array_equal(one, other)
    assert np.allclose(times(F, P), F @ P, rtol=1e-14, atol=1e-14)
    assert np.allclose(applied(H, x), H @ x, rtol=1e-14, atol=1e-14)
    assert np.allclose(inverse(P), np.linalg.inv(P), rtol=1e-10)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_an_innovation_without_a_covariance_is_refused(bad):
    one = np.eye(2)
    with pytest.raises(np.linalg.LinAlgError, match=r"infs or NaNs|not positive"):
        posterior(np.zeros(2), 0 * one, one, np.ones(2), np.diag((bad, bad)))
