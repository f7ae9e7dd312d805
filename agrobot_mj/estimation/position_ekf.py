"""What the pose filters share: a tick of filterpy's extended Kalman filter that corrects by the position of a fix.

filterpy's object is a workspace only: `tick` is a function of its arguments, and a missing fix is `update(None)`.
"""

from collections.abc import Callable
from math import nan

import numpy as np

from agrobot_mj.core.copying import Workspace
from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.kalman import CompiledEkf


class FixEkf(Workspace, CompiledEkf):
    """The filter; a kind overrides `predict_x`, filterpy's hook."""

    def __init__(self, states: int) -> None:
        super().__init__(dim_x=states, dim_z=2)

    def tick(
        self,
        belief: tuple[Array, Array],
        inputs: tuple[float, float, float],
        fix: Fix | None,
        sees: tuple[Callable[[Array], Array], Callable[[Array], Array]],
        noise: Array,
    ) -> tuple[Array, Array, float]:
        """Mean (n,), covariance (n, n) and NIS after a tick, from the belief before it and the fix at its end.

        NIS is the normalised innovation squared of the position, NaN without a fix. `inputs` are speed [m/s], steer
        [rad] and dt [s]; `sees` are the Jacobian (2, n) of the measurement and the measurement (2,) of a state; `noise`
        (2, 2) is the covariance of the fix [m2].
        """
        self.x, self.P = belief
        z = None if fix is None else np.array((fix.x, fix.y))
        self.advance(inputs, z, *sees, R=noise)
        return self.x, self.P, nan if z is None else self.nis
