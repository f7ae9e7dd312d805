"""What the filters share: a tick of the compiled `equations`, and the same tick by filterpy, to which tests hold it.

filterpy's own `predict` and `update` take 60 us in Python for matrices this small, and to import it half a second, for
SciPy's densities: no run does.
"""

from math import nan
from typing import Any, Self

from agrobot_mj.core.signals import Array
from agrobot_mj.estimation import equations


class Filter:
    """A filter that keeps nothing from tick to tick, so that copies of a state may share it."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


def tick(x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array) -> tuple[Array, Array, float]:
    """Mean, covariance and NIS [-] after a tick, from the prior mean `x` (n,) and the covariance P (n, n) before it.

    The transition F (n, n) has process noise Q (n, n). The innovation y (m,) sees H (m, n) with noise R (m, m);
    without one the NIS is NaN.
    """
    if y is None:
        return x, equations.prior(P, F, Q), nan
    return equations.tick(x, P, F, Q, y, H, R)


def filterpy_tick(
    x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array
) -> tuple[Array, Array, float]:
    """`tick` by filterpy's extended Kalman filter."""
    from filterpy.kalman import ExtendedKalmanFilter

    kf = ExtendedKalmanFilter(dim_x=len(x), dim_z=len(H))
    kf.x, kf.P, kf.F, kf.Q, kf.predict_x = x, P, F, Q, lambda u: None  # x is predicted already
    kf.predict()
    kf.update(None if y is None else H @ x + y, lambda x: H, lambda x: H @ x, R)
    return kf.x, kf.P, nan if y is None else float(kf.y @ kf.SI @ kf.y)
