"""Second GNSS receiver on the implement, which measures the position of its tool or axle.

The reading is the working point, ENU: the antenna position levelled by the receiver's inertial unit, independent of the
antenna height. Noise is white plus correlated as for the tractor's receiver, without latency and losses.
"""

from math import nan, sqrt
from typing import NamedTuple

from agrobot_mj.core.randomness import GaussMarkov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.sensors.base import Sensor


class ImplementFix(NamedTuple):
    """Measured position of the implement's working point."""

    x: float = nan
    """East coordinate; NaN without a receiver [m]."""
    y: float = nan
    """North coordinate; NaN without a receiver [m]."""


class ImplementGnss(Sensor):
    """RTK-GNSS receiver on the implement; `[sensors.implement_gnss]`."""

    enabled: bool = False
    """Whether the receiver is present."""
    sigma_m: NonNegative = 0.02
    """Standard deviation per axis, white plus correlated [m]. Assumed value: as for the tractor's receiver."""
    correlated_fraction: Fraction = 0.2
    """Correlated fraction of the error variance [-]. Assumed value (0.1-0.5)."""
    correlation_time_s: Positive = 60.0
    """Correlation time of the error [s]. Assumed value (30-300)."""

    def init(self, seed: int) -> GaussMarkov:
        """Return the correlated error sampled from its stationary distribution."""
        return GaussMarkov.stationary(stream(seed, "implement_gnss"), 2)

    def measure(
        self, state: GaussMarkov, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[GaussMarkov, ImplementFix]:
        """Return the measured position of the implement."""
        if not self.enabled:
            return state, ImplementFix()
        state, white = state.after(dt, self.correlation_time_s), state.generator.standard_normal(2).tolist()
        slow, fast = sqrt(self.correlated_fraction), sqrt(1.0 - self.correlated_fraction)
        x, y = (
            true + self.sigma_m * (slow * s + fast * w)
            for true, s, w in zip(truth.implement, state.value, white, strict=True)
        )
        return state, ImplementFix(x, y)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the position, if the receiver is present."""
        if not self.enabled:
            return ()
        return (
            Column("implement_gnss_x", "m", "working point of the implement from its GNSS receiver, east"),
            Column("implement_gnss_y", "m", "working point of the implement from its GNSS receiver, north"),
        )

    def report(self, reading: ImplementFix) -> tuple[float, ...]:
        """Return the position, if the receiver is present."""
        return tuple(reading) if self.enabled else ()
