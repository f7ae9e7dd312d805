"""What the filters share: a tick of the compiled `equations`, and filterpy's filter with its matrices on request.

filterpy's own `predict` and `update` take 60 us in Python for matrices this small, and to import it half a second, for
SciPy's densities: no run does. A test compares.
"""

from copy import copy
from math import nan
from typing import Any

from agrobot_mj.core.signals import Array
from agrobot_mj.estimation.equations import posterior, prior, tick


class Workspace:
    """A filter that keeps nothing from tick to tick but, for `kf`, the matrices of the last one."""

    def __init__(self, states: int, measured: int, linear: bool = False) -> None:
        self.sizes, self.linear = {"dim_x": states, "dim_z": measured}, linear
        self._last: dict[str, Array] = {}

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """A workspace that may work at the same time; matrices are replaced, never written into."""
        return copy(self)

    @property
    def kf(self) -> Any:
        """filterpy's `KalmanFilter` or `ExtendedKalmanFilter` with the matrices of the last tick."""
        from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter

        kf = (KalmanFilter if self.linear else ExtendedKalmanFilter)(**self.sizes)
        for name, matrix in self._last.items():
            setattr(kf, name, matrix)
        return kf

    def predict(self, x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
        """Prior of mean `x` (n,), and the covariance P (n, n) taken through the transition F with process noise Q."""
        P = prior(P, F, Q)
        self._last = {"x": x, "P": P, "F": F, "Q": Q}
        return x, P

    def update(self, x: Array, P: Array, y: Array, H: Array, R: Array) -> tuple[Array, Array, float]:
        """Posterior of an innovation y (m,) that sees H (m, n) with noise R (m, m), and its NIS [-]."""
        x, P, S, nis = posterior(x, P, H, y, R)
        self._last = {**self._last, "x": x, "P": P, "y": y, "H": H, "R": R, "S": S}
        return x, P, nis

    def tick(
        self, x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array
    ) -> tuple[Array, Array, float]:
        """`predict`, then `update` unless there is no innovation: mean, covariance and NIS, NaN without one [-]."""
        if y is None:
            return *self.predict(x, P, F, Q), nan
        x, P, S, nis = tick(x, P, F, Q, y, H, R)
        self._last = {"x": x, "P": P, "F": F, "Q": Q, "y": y, "H": H, "R": R, "S": S}
        return x, P, nis
