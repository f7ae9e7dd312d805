"""Second GNSS receiver on the implement, which measures its tool or axle position.

Position of the working point, ENU: that of the antenna, levelled by the inertial unit below, independent of the antenna
height. Noise as in the tractor's receiver: white, and a correlated part; without latency and losses.
"""

from math import nan, sqrt
from typing import NamedTuple

from agrobot_mj.core.randomness import GaussMarkov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.sensors.base import Sensor


class ImplementFix(NamedTuple):
    """Place where the implement works, as measured."""

    x: float = nan
    """East; NaN without a receiver [m]."""
    y: float = nan
    """North [m]."""


class ImplementGnss(Sensor):
    """RTK receiver on the implement; `[sensors.implement_gnss]`."""

    enabled: bool = False
    """Whether the receiver is present."""
    sigma_m: NonNegative = 0.02
    """Standard deviation per axis, both parts together [m]. Assumed value, that of the tractor's receiver."""
    correlated_fraction: Fraction = 0.2
    """Fraction of the correlated part in the variance [-]. Assumed value (0.1-0.5)."""
    correlation_time_s: Positive = 60.0
    """Correlation time of that part [s]. Assumed value (30-300)."""

    def init(self, seed: int) -> GaussMarkov:
        """Return the correlated part drawn from its stationary distribution."""
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
        """Columns of the position, if the receiver is present."""
        if not self.enabled:
            return ()
        return (
            Column("implement_gnss_x", "m", "place where the implement works by its own receiver, east"),
            Column("implement_gnss_y", "m", "place where the implement works by its own receiver, north"),
        )

    def report(self, reading: ImplementFix) -> tuple[float, ...]:
        """Return the position, if the receiver is present."""
        return tuple(reading) if self.enabled else ()
