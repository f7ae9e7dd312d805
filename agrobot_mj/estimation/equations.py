"""The two equations of a Kalman filter that a tick spends its time in, compiled.

The same operations in the same order as filterpy's `KalmanFilter` and `ExtendedKalmanFilter`, whose Python takes some
60 us for matrices this small. Mean (n,), covariance (n, n), measurement (m,); the units are the filter's.
"""

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Array


@jit
def prior(P: Array, F: Array, Q: Array) -> Array:
    """Covariance after a transition F (n, n) with process noise Q (n, n)."""
    P_prior: Array = F @ P @ F.T + Q
    return P_prior


@jit
def posterior(x: Array, P: Array, H: Array, y: Array, R: Array) -> tuple[Array, Array, float]:
    """Mean, covariance and normalised innovation squared after the innovation `y` (m,).

    H (m, n) is the Jacobian of the measurement, R (m, m) the covariance of its noise. Raises `LinAlgError` where the
    innovation has no finite covariance that can be inverted.
    """
    PHT = P @ H.T
    SI = np.linalg.inv(H @ PHT + R)
    K = PHT @ SI
    I_KH = np.eye(x.size) - K @ H
    P_post = I_KH @ P @ I_KH.T + K @ R @ K.T  # Joseph's form: symmetric and positive whatever the rounding
    return x + K @ y, P_post, (y @ SI) @ y
