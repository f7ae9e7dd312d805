"""Base class of the pose filters: an extended Kalman filter step corrected by the position of a fix."""

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.kalman import Filter


class FixEkf(Filter):
    """Pose filter whose first states are x, y and yaw of the rear axle; subclasses define `step`."""

    def __init__(self, wheelbase: float) -> None:
        """Create the filter for a `wheelbase` L [m]."""
        self.wheelbase = wheelbase

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """Return mean (n,), covariance (n, n) and NIS after a tick, corrected by the fix at its end.

        NIS is the normalised innovation squared of the position, NaN without a fix. `inputs` are speed [m/s], steering
        angle [rad] and dt [s]; `sigma` is the standard deviation of the fix [m].
        """
        raise NotImplementedError

    def corrected(
        self, x: Array, P: Array, F: Array, Q: Array, fix: Fix | None, expected: Array, H: Array, R: Array
    ) -> tuple[Array, Array, float]:
        """Return the result of `step` for the predicted mean `x`, the previous covariance P and the fix.

        The fix has the noise R (2, 2) [m2], the Jacobian H (2, n) and the expected value `expected` (2,) [m].
        """
        y = None if fix is None else np.array((fix.x, fix.y)) - expected
        return self.tick(x, P, F, Q, y, H, R)
