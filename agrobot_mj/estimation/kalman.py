"""filterpy's Kalman filters, with their matrix algebra compiled.

filterpy's own `predict` and `update` take 60 us in Python for matrices this small; `equations` takes their place, and a
test compares. Importing filterpy costs 0.4 to 0.65 s of processor time, for SciPy's densities. It is paid where the
first filter is built, so that commands without a filter do not pay.
"""

from copy import copy
from math import nan
from typing import Any

from agrobot_mj.core.signals import Array
from agrobot_mj.estimation.equations import posterior, prior, tick


class Workspace:
    """A filter of filterpy used as a workspace: nothing in it is carried over to the next tick."""

    kf: Any
    """`KalmanFilter` or `ExtendedKalmanFilter`; its x, P, F, Q, y, H, R and S are those of the last tick."""

    def __init__(self, states: int, measured: int, linear: bool = False) -> None:
        from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter

        self.kf = (KalmanFilter if linear else ExtendedKalmanFilter)(dim_x=states, dim_z=measured)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """A workspace that may work at the same time; matrices are replaced, never written into."""
        made = copy(self)
        made.kf = copy(self.kf)
        return made

    def predict(self, x: Array, P: Array, F: Array, Q: Array) -> None:
        """Prior of mean `x` (n,), the covariance P (n, n) taken through the transition F with process noise Q."""
        self.kf.x, self.kf.P, self.kf.F, self.kf.Q = x, prior(P, F, Q), F, Q

    def update(self, x: Array, P: Array, y: Array, H: Array, R: Array) -> float:
        """Posterior of an innovation y (m,) that sees H (m, n) with noise R (m, m); its NIS [-]."""
        kf = self.kf
        kf.y, kf.H, kf.R = y, H, R
        kf.x, kf.P, kf.S, nis = posterior(x, P, H, y, R)
        return float(nis)

    def tick(self, x: Array, P: Array, F: Array, Q: Array, y: Array | None, H: Array, R: Array) -> float:
        """`predict`, then `update` unless there is no innovation: its NIS, NaN without one [-]."""
        if y is None:
            self.predict(x, P, F, Q)
            return nan
        kf = self.kf
        kf.F, kf.Q, kf.y, kf.H, kf.R = F, Q, y, H, R
        kf.x, kf.P, kf.S, nis = tick(x, P, F, Q, y, H, R)
        return float(nis)
