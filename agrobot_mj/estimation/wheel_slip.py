"""How much the slip of the driven wheels changes, learned from fixes, so that a loss of fixes is not trusted too far.

An implement that goes into the soil changes the slip within a second by ten times what it walks on firm ground. The
low-passed residual m of the wheel speed against the fixes' speed shows that: what it has beyond its own noise is the
variance of a walk, m^2 / tau, which counts at once, so that the scale of the wheels follows; its mean over
`MEMORY_S`, which begins at what is expected of the work, is how much the scale is believed to walk while nobody looks.
"""

from math import exp, sqrt
from typing import NamedTuple

RESIDUAL_S = 2.0
"""Time constant of the low pass of the residual [s]. Assumed value: 40 fixes, a change of 1 % shows."""
MEMORY_S = 300.0
"""Time over which changes of the slip, or that there were none, are remembered [s]. Assumed value: a few swaths."""
SIGNIFICANT = 9.0
"""Square of the residual over its variance from which on it is a change [-]. Assumed value: three sigma."""


class WheelSlip(NamedTuple):
    """Slip as fixes have shown it so far."""

    residual: float = 0.0
    """Low-passed relative residual of the wheel speed, m [-]."""
    change: float = 0.0
    """Variance of the walk that it shows at present [1/s]."""
    memory: float = 0.0
    """Mean of that variance [1/s]."""

    def after(self, residual: float, variance: float, scale_variance: float, dt: float) -> "WheelSlip":
        """State after a tick of `dt` [s] with this relative residual, its `variance` and that of the wheel scale."""
        keep, forget = exp(-dt / RESIDUAL_S), exp(-dt / MEMORY_S)
        low = keep * self.residual + (1.0 - keep) * residual
        expected = variance * 0.5 * dt / RESIDUAL_S + scale_variance
        change = max(0.0, low * low - SIGNIFICANT * expected) / RESIDUAL_S
        return WheelSlip(low, change, forget * self.memory + (1.0 - forget) * change)

    def unseen(self) -> "WheelSlip":
        """State after a tick without a fix: the slip is taken to change as it has before."""
        return WheelSlip(change=self.memory, memory=self.memory)

    @property
    def walk(self) -> float:
        """Walk of the scale beyond that of firm ground [1/sqrt(s)]."""
        return sqrt(self.change)
