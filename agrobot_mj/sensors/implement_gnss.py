"""Second GNSS receiver on the implement, which measures the position of the implement's tool or axle.

The measurement is the ENU position of the working point. The inertial unit of the receiver corrects the antenna
position for tilt, so that the antenna height has no effect. The error has white and correlated parts, as for the
tractor's receiver. Latency and signal losses are not modelled.
"""

from math import nan, sqrt
from typing import NamedTuple

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.randomness import GaussMarkov, Shares, normal, shares, stream, wandered_plane
from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.sensors.base import CompiledSensor, Noise, SensedMotion


class ImplementFix(NamedTuple):
    """Measured position of the implement's working point."""

    x: float = nan  # East coordinate [m], or NaN if there is no receiver
    y: float = nan  # North coordinate [m], or NaN if there is no receiver


class ImplementGnssLaw(NamedTuple):
    """Parameters of the receiver on the implement, as numbers for compiled kernels."""

    sigma: float  # Standard deviation of the position error per axis [m]
    slow: float  # Standard deviation of the correlated error, divided by `sigma` [-]
    fast: float  # Standard deviation of the white error, divided by `sigma` [-]
    kept: Shares  # Weights of the last value and of white noise in the correlated error [-]


class ImplementGnssValues(NamedTuple):
    """State of the receiver on the implement between two ticks."""

    error: tuple[float, float]  # Correlated error, east and north, divided by its standard deviation [-]


@jit
def implement_fix(
    p: ImplementGnssLaw, s: ImplementGnssValues, streams: tuple[int], motion: SensedMotion
) -> tuple[ImplementGnssValues, ImplementFix]:
    """Return the new state and the measured position of the implement's working point."""
    error = wandered_plane(s.error, p.kept, streams[0])
    x = motion.implement[0] + p.sigma * (p.slow * error[0] + p.fast * normal(streams[0]))
    y = motion.implement[1] + p.sigma * (p.slow * error[1] + p.fast * normal(streams[0]))
    return ImplementGnssValues(error), ImplementFix(x, y)


class ImplementGnss(CompiledSensor):
    """RTK-GNSS receiver on the implement, configured by the keys of `[sensors.implement_gnss]`."""

    law = implement_fix
    absent = ImplementFix()

    enabled: bool = False
    """Whether the receiver is present."""
    sigma_m: NonNegative = 0.02
    """Standard deviation of the sum of white and correlated errors per axis [m]. Assumed value, equal to the default of
    `sensors.gnss`."""
    correlated_fraction: Fraction = 0.2
    """Correlated fraction of the position error variance [-]. Assumed value (range 0.1-0.5)."""
    correlation_time_s: Positive = 60.0
    """Correlation time of the correlated position error [s]. Assumed value (range 30-300)."""

    def parameters(self, dt: float) -> ImplementGnssLaw:
        """Return the parameters of the kernel `implement_fix` for ticks of length `dt` [s]."""
        share = self.correlated_fraction
        return ImplementGnssLaw(self.sigma_m, sqrt(share), sqrt(1.0 - share), shares(dt, self.correlation_time_s))

    def init(self, seed: int) -> Noise:
        """Return the initial state, with a correlated error sampled from its stationary distribution."""
        error = GaussMarkov.stationary(stream(seed, "implement_gnss"), 2)
        return Noise((error.generator,), ImplementGnssValues(error.value))

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the position measured on the implement, or an empty tuple if the receiver is absent."""
        if not self.enabled:
            return ()
        return (
            Column("implement_gnss_x", "m", "working point of the implement from its GNSS receiver, east"),
            Column("implement_gnss_y", "m", "working point of the implement from its GNSS receiver, north"),
        )

    def report(self, reading: ImplementFix) -> tuple[float, ...]:
        """Return the position measured on the implement [m], or an empty tuple if the receiver is absent."""
        return tuple(reading) if self.enabled else ()
