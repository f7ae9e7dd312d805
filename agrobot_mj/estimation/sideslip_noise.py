"""How much the course sways about the modelled one, learned from fixes, so that their velocity is not trusted too far.

Rough ground, ruts and tyre transients move R sideways beyond the sideslip model. The cross-course velocity innovations
of a consistent filter are white. The excess of the mean square of their low pass m over that of white noise is sway of
the course, with the density 2 `LOW_PASS_S` (mean(m^2) - white), averaged over `MEMORY_S`.
"""

from math import exp
from typing import NamedTuple

LOW_PASS_S = 4.0
"""Time constant of the low pass of the innovation [s]. Assumed value: bumps move R aside and back within two seconds;
what they do not return turns into an error of the heading."""
MEMORY_S = 60.0
"""Time over which the sway is averaged [s]. Assumed value: 8 independent values of the low pass."""


class SidewaysNoise(NamedTuple):
    """Sway of the course as fixes have shown it so far."""

    residual: float = 0.0
    """Low-passed cross-course innovation over the speed, m [rad]."""
    excess: float = 0.0
    """Mean of m^2 less that of white noise [rad2]."""
    seen_s: float = LOW_PASS_S
    """Time over which that is the mean, at most `MEMORY_S` [s]."""

    def after(self, residual: float, variance: float, dt: float) -> "SidewaysNoise":
        """State after a tick of `dt` [s] with this innovation [rad], of which `variance` [rad2] is expected."""
        keep, seen = exp(-dt / LOW_PASS_S), min(self.seen_s + dt, MEMORY_S)
        low = keep * self.residual + (1.0 - keep) * residual
        beyond = low * low - variance * 0.5 * dt / LOW_PASS_S
        return SidewaysNoise(low, self.excess + (beyond - self.excess) * dt / seen, seen)

    @property
    def density(self) -> float:
        """Density of the sway as white noise [rad2 s]."""
        return 2.0 * LOW_PASS_S * max(0.0, self.excess)
