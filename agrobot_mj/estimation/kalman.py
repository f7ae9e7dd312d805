"""Kalman filter step of the estimators, either compiled (3 us) or computed by the package filterpy (60 us)."""

from collections.abc import Callable
from math import nan
from typing import Any, Self

from agrobot_mj.core.signals import Array
from agrobot_mj.estimation import equations

Step = Callable[[Array, Array, Array, Array, Array | None, Array, Array], tuple[Array, Array, float]]
"""Type of the Kalman filter steps `tick`, `filterpy_kf` and `filterpy_ekf`."""


def tick(x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array) -> tuple[Array, Array, float]:
    """Return mean, covariance and NIS [-] after a step, from the predicted mean `x` (n,) and the previous covariance P.

    The transition F (n, n) has the process noise Q (n, n). The innovation y (m,) has the Jacobian H (m, n) and the
    measurement noise R (m, m). The NIS is NaN without an innovation.
    """
    if y is None:
        return x, equations.prior(P, F, Q), nan
    return equations.tick(x, P, F, Q, y, H, R)


def filterpy_kf(
    x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array
) -> tuple[Array, Array, float]:
    """Return the result of the function `tick`, computed by the class `KalmanFilter` of filterpy."""
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(dim_x=len(x), dim_z=len(H))
    kf.x, kf.P = x, P
    kf.predict(F=F, Q=Q)
    kf.x = x  # `x` already is the prior mean
    kf.update(None if y is None else H @ x + y, R=R, H=H)
    return kf.x, kf.P, nan if y is None else float(kf.y @ kf.SI @ kf.y)


def filterpy_ekf(
    x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array
) -> tuple[Array, Array, float]:
    """Return the result of the function `tick`, computed by the class `ExtendedKalmanFilter` of filterpy."""
    from filterpy.kalman import ExtendedKalmanFilter

    kf = ExtendedKalmanFilter(dim_x=len(x), dim_z=len(H))
    kf.x, kf.P, kf.F, kf.Q, kf.predict_x = x, P, F, Q, lambda u: None  # `x` already is the prior mean
    kf.predict()
    kf.update(None if y is None else H @ x + y, lambda x: H, lambda x: H @ x, R)
    return kf.x, kf.P, nan if y is None else float(kf.y @ kf.SI @ kf.y)


class Filter:
    """Base class of filters without internal state, so that all copies of an estimator state share one filter."""

    tick: Step = staticmethod(tick)
    """Kalman filter step: the compiled `tick` or a filterpy step."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self
