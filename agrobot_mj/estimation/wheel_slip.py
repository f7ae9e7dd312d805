"""Variation of the wheel slip, estimated from fixes for the uncertainty during a loss of fixes.

An implement that enters the soil changes the slip within a second by ten times its random walk on firm ground. This
appears in m, the low-pass filtered residual of the wheel speed against the speed of the fixes. Above its own noise, m
gives the variance m^2 / tau of a random walk, applied at once so that the wheel scale can follow. During a loss of
fixes the filter uses the mean of this variance over `MEMORY_S`, which starts at the value expected for the work.
"""

from math import exp, sqrt
from typing import NamedTuple

RESIDUAL_S = 2.0
"""Time constant of the low-pass filter of the residual [s]. Assumed value: 40 fixes; a change of 1 % is significant."""
MEMORY_S = 300.0
"""Averaging time of the slip variation [s]. Assumed value: several swaths."""
SIGNIFICANT = 9.0
"""Squared residual divided by its variance above which the slip has changed [-]. Assumed value: three sigma."""


class WheelSlip(NamedTuple):
    """Slip variation estimated from the fixes so far."""

    residual: float = 0.0
    """Low-pass filtered relative residual of the wheel speed [-]."""
    change: float = 0.0
    """Current variance rate of the random walk of the slip [1/s]."""
    memory: float = 0.0
    """Mean of the variance rate `change` over `MEMORY_S` [1/s]."""

    def after(self, residual: float, variance: float, scale_variance: float, dt: float) -> "WheelSlip":
        """Return the state after `dt` [s] with this relative residual, its `variance` and that of the wheel scale."""
        keep, decay = exp(-dt / RESIDUAL_S), exp(-dt / MEMORY_S)
        low = keep * self.residual + (1.0 - keep) * residual
        expected = variance * 0.5 * dt / RESIDUAL_S + scale_variance
        change = max(0.0, low * low - SIGNIFICANT * expected) / RESIDUAL_S
        return WheelSlip(low, change, decay * self.memory + (1.0 - decay) * change)

    def unseen(self) -> "WheelSlip":
        """Return the state after a tick without a fix, with the mean slip variation."""
        return WheelSlip(change=self.memory, memory=self.memory)

    @property
    def walk(self) -> float:
        """Random walk of the wheel scale in addition to that on firm ground [1/sqrt(s)]."""
        return sqrt(self.change)
