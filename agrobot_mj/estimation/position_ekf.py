"""Extended Kalman filter step of the pose filters, with correction by the position of a fix."""

from math import isnan, nan
from typing import Any, ClassVar, NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Array, Fix, Matrix, Vector
from agrobot_mj.estimation.equations import prior, product, tick
from agrobot_mj.estimation.kalman import Filter

Inputs = tuple[float, float, float]  # Speed [m/s], steering angle [rad] and dt [s]


class Linearised(NamedTuple):
    """Motion and measurement model of a pose filter with n states, linearised for one tick."""

    x: Vector  # Predicted mean, shape (n,)
    F: Matrix  # Transition, shape (n, n)
    Q: Matrix  # Process noise, shape (n, n)
    H: Matrix  # Jacobian of the position of a fix, shape (2, n)
    R: Matrix  # Noise covariance of the position of a fix [m2], shape (2, 2)


@jit
def correct(m: Linearised, P: Matrix, fix: Fix) -> tuple[Vector, Matrix, float]:
    """Return mean, covariance and NIS [-] after a tick; `P` is the covariance before the tick. A missing fix is NaN."""
    if isnan(fix.x):
        return m.x, prior(P, m.F, m.Q), nan
    return tick(m.x, P, m.F, m.Q, np.array((fix.x, fix.y)) - product(m.H, m.x), m.H, m.R)


class FixEkf(Filter):
    """Base class of the pose filters, whose first states are x, y and yaw of the rear axle."""

    model: ClassVar[Any]
    """Compiled function that linearises the filter model. Arguments: parameters `law`, mean, inputs and fix noise
    [m]."""
    law: Any

    def step(
        self, mean: Vector, covariance: Array, inputs: Inputs, fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """Return the mean (n,), covariance (n, n) and NIS after a tick, corrected by the fix at its end.

        The NIS is the normalised innovation squared of the position, or NaN without a fix.
        """
        x, F, Q, H, R = type(self).model(self.law, mean, inputs, sigma)
        y = None if fix is None else np.array((fix.x, fix.y)) - product(H, x)
        return self.tick(x, covariance, F, Q, y, H, R)
