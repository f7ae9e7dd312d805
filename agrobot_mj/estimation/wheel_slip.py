"""Variation of the wheel slip, estimated from fixes and used as uncertainty without fixes.

An implement that enters the soil changes the slip within a second by ten times its random walk on firm ground. The
change appears in m, the low-pass filtered difference between wheel speed and fix speed. If m exceeds its own noise, m^2
/ `RESIDUAL_S` is the variance rate of a random walk, which is applied immediately so that the wheel scale can follow.
Without fixes the filter uses the mean of this variance rate over `MEMORY_S`, whose initial value depends on the
implement.
"""

from math import exp
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel_method

RESIDUAL_S = 2.0
"""Time constant for filtering the residual [s]. Assumed value: 40 fixes, which make slip changes of 1 % significant."""
MEMORY_S = 300.0  # Averaging time of the slip variation [s]. Assumed value: the duration of several swaths.
SIGNIFICANT = 9.0
"""Minimum squared residual, divided by its variance, that indicates a slip change [-]. Assumed value (three sigma)."""


class WheelSlip(NamedTuple):
    """Running estimate of the variation of the wheel slip, updated in each tick."""

    residual: float = 0.0  # Low-pass filtered difference between wheel speed and fix speed, divided by the speed [-]
    change: float = 0.0  # Current variance rate of the random walk of the wheel slip [1/s]
    memory: float = 0.0  # Mean of `change` over `MEMORY_S` [1/s]

    def after(self, residual: float, variance: float, scale_variance: float, dt: float) -> "WheelSlip":
        """Return the state `dt` [s] later, given a relative `residual`, its variance and the wheel-scale variance."""
        keep, decay = exp(-dt / RESIDUAL_S), exp(-dt / MEMORY_S)
        low = keep * self.residual + (1.0 - keep) * residual
        expected = variance * 0.5 * dt / RESIDUAL_S + scale_variance
        change = max(0.0, low * low - SIGNIFICANT * expected) / RESIDUAL_S
        return WheelSlip(low, change, decay * self.memory + (1.0 - decay) * change)

    def without_fix(self) -> "WheelSlip":
        """Return the state after a tick without a fix; the mean variance rate from earlier fixes is used."""
        return WheelSlip(0.0, self.memory, self.memory)


for _method in ("after", "without_fix"):
    kernel_method(_method)
