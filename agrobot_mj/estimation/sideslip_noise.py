"""Random variation of the course, estimated from the fixes to limit the weight of their velocity.

Rough ground, ruts and tyre transients move the rear axle sideways in addition to the modelled sideslip. The
cross-course velocity innovations of a consistent filter are white. If m is the low-pass filtered innovation, course
variation increases mean(m^2) above its value for white noise. The density of the variation is 2 `LOW_PASS_S` (mean(m^2)
- white), averaged over `MEMORY_S`.
"""

from math import exp
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel_method, shared

LOW_PASS_S = 4.0
"""Time constant of the low-pass filter [s]. Assumed value: the filter suppresses sideways motion over bumps, which
lasts less than 2 s. Longer displacements cause heading errors of the estimate and are not suppressed."""
MEMORY_S = 60.0
"""Averaging time of the random course variation [s]. Assumed value: the time of 8 independent filtered innovations."""


class SidewaysNoise(NamedTuple):
    """Running estimate of the random course variation, updated with each fix."""

    residual: float = 0.0  # Low-pass filtered cross-course innovation, divided by the speed [rad]
    excess: float = 0.0  # Mean square of the filtered innovation minus its value for white noise [rad2]
    seen_s: float = LOW_PASS_S  # Current averaging time of `excess`, at most `MEMORY_S` [s]

    def after(self, residual: float, variance: float, dt: float) -> "SidewaysNoise":
        """Return the state `dt` [s] later, after an innovation `residual` [rad] with white-noise `variance` [rad2]."""
        keep, time = exp(-dt / LOW_PASS_S), min(self.seen_s + dt, MEMORY_S)
        low = keep * self.residual + (1.0 - keep) * residual
        excess = low * low - variance * 0.5 * dt / LOW_PASS_S
        return SidewaysNoise(low, self.excess + (excess - self.excess) * dt / time, time)


kernel_method("after")


@shared
def density(sway: SidewaysNoise) -> float:
    """Return the density of the white noise that has the same effect as the course variation [rad2 s]."""
    return 2.0 * LOW_PASS_S * max(0.0, sway.excess)
