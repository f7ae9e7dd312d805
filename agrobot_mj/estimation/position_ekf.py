"""What the pose filters share: a tick of an extended Kalman filter that corrects by the position of a fix."""

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.kalman import Filter


class FixEkf(Filter):
    """The filter, whose states begin with x, y and yaw at R; a kind gives `step`."""

    def __init__(self, wheelbase: float) -> None:
        """For a `wheelbase` L [m]."""
        self.wheelbase = wheelbase

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """Mean (n,), covariance (n, n) and NIS after a tick, given the fix at its end; a function of its arguments.

        NIS is the normalised innovation squared of the position, NaN without a fix. `inputs` are speed [m/s], steer
        [rad] and dt [s]; `sigma` is the standard deviation of the fix [m].
        """
        raise NotImplementedError

    def corrected(
        self, x: Array, P: Array, F: Array, Q: Array, fix: Fix | None, seen: Array, H: Array, R: Array
    ) -> tuple[Array, Array, float]:
        """What `step` returns, from the predicted mean, the covariance before it, and the fix.

        The fix has noise R (2, 2) [m2] and sees H (2, n) of the state, `seen` (2,) [m] of the mean.
        """
        y = None if fix is None else np.array((fix.x, fix.y)) - seen
        return self.tick(x, P, F, Q, y, H, R)
