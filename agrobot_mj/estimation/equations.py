"""Compiled equations of a Kalman filter: prediction of the covariance, correction, and both in one call.

The results equal the results of `KalmanFilter` and `ExtendedKalmanFilter` of filterpy, which take 60 us in Python for
small matrices. Plain loops are faster here than calls to a linear algebra library. Shapes are (n,) for the mean, (n, n)
for the covariance and (m,) for a measurement; the units depend on the filter.
"""

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Array, Matrix, Vector


@jit
def prior(P: Array, F: Array, Q: Array) -> Matrix:
    """Return the predicted covariance F P F' + Q of the covariance P, with transition F and process noise Q (n, n)."""
    found = times(F, times(F, P).T.copy()).T.copy()
    for i in range(found.shape[0]):
        for j in range(found.shape[1]):
            found[i, j] += Q[i, j]
    return found


@jit
def posterior(x: Array, P: Array, H: Array, y: Array, R: Array) -> tuple[Vector, Matrix, float]:
    """Return the mean, covariance and NIS [-] after a correction by the innovation `y` (m,).

    H (m, n) is the Jacobian of the measurement and R (m, m) its noise covariance. NIS is the normalised innovation
    squared. Raise `LinAlgError` if the innovation covariance is singular.
    """
    PHT = times(H, P.T.copy()).T.copy()
    SI = inverse(times(H, PHT) + R)
    K = times(PHT, SI)
    KT = K.T.copy()
    I_KH = np.eye(x.size) - times(H.T, KT).T
    # Joseph form: symmetric and positive definite despite rounding
    P_post = times(times(I_KH, P), I_KH.T.copy()) + times(times(R.T, KT).T, KT)
    return x + product(K, y), P_post, (y * product(SI, y)).sum()


@jit
def tick(x: Array, P: Array, F: Array, Q: Array, y: Array, H: Array, R: Array) -> tuple[Vector, Matrix, float]:
    """Predict the covariance P, correct P and the predicted mean `x`, and return mean, covariance and NIS [-]."""
    return posterior(x, prior(P, F, Q), H, y, R)


@jit
def product(A: Array, x: Array) -> Vector:
    """Return the product of a matrix and a vector."""
    y = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for j in range(x.size):
            y[i] += A[i, j] * x[j]
    return y


@jit
def times(A: Array, B: Array) -> Matrix:
    """Return the matrix product A B, which is fastest if A contains zeros and the rows of B are contiguous."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            a = A[i, k]
            if a != 0.0:
                for j in range(B.shape[1]):
                    C[i, j] += a * B[k, j]
    return C


@jit
def inverse(S: Array) -> Matrix:
    """Return the inverse of a symmetric positive definite matrix by Gauss-Jordan elimination without pivoting."""
    n, A, found = S.shape[0], S.copy(), np.eye(S.shape[0])
    for k in range(n):
        pivot = A[k, k]
        if not np.isfinite(pivot):
            raise np.linalg.LinAlgError("array must not contain infs or NaNs")
        if pivot <= 0.0:
            raise np.linalg.LinAlgError("the innovation covariance is not positive definite")
        for j in range(n):  # loops, because slices add seconds of compile time
            A[k, j] /= pivot
            found[k, j] /= pivot
        for i in range(n):
            if i != k:
                factor = A[i, k]
                for j in range(n):
                    A[i, j] -= factor * A[k, j]
                    found[i, j] -= factor * found[k, j]
    return found
