"""RTK-GNSS receiver: position and velocity of the antenna, which swings with roll and pitch.

Position error per axis = white part + first-order Gauss-Markov part [Brown2012], velocity error white; a float
solution has its own pair of position errors. ENU [m, m/s]; the solution is delivered whole ticks late.
"""

from math import sqrt
from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import gauss_markov, stream
from agrobot_mj.core.signals import Conditions, Fix, Quality, Truth
from agrobot_mj.core.spec import Fraction, Latency, NonNegative, Positive
from agrobot_mj.sensors.base import Sensor

Pair = tuple[float, float]
"""East and north."""


class GnssReading(NamedTuple):
    """Solution delivered in one tick."""

    fix: Fix | None
    """Position and velocity; None without a solution."""
    quality: int
    """One of `Quality`."""


class GnssState(NamedTuple):
    """The receiver between two ticks."""

    generator: Generator
    """Random stream of a fixed solution; advances in place."""
    correlated: Pair
    """Gauss-Markov part of the east and north error, in units of its standard deviation [-]."""
    float_generator: Generator
    """Random stream of a float solution; advances in place."""
    float_correlated: Pair
    """Gauss-Markov part of a float solution's error [-]."""
    pending: tuple[GnssReading, ...] = ()
    """Solutions under way, one per tick, oldest first."""


class Gnss(Sensor):
    """RTK receiver at the antenna; `[sensors.gnss]`."""

    sigma_m: NonNegative = 0.02
    """Horizontal position error per axis, white and correlated part together [m]. Paper, section V-A."""
    float_sigma_m: NonNegative = 0.3
    """Horizontal position error per axis of a float solution [m]. Estimate (0.2-0.5)."""
    correlated_fraction: Fraction = 0.3
    """Share of the correlated part in the variance (multipath, atmosphere) [-]. Estimate."""
    correlation_time_s: Positive = 30.0
    """Correlation time of the correlated part [s]. Estimate (multipath: ten seconds to minutes)."""
    float_correlated_fraction: Fraction = 0.9
    """Share of the correlated part when the ambiguities float [-]. Estimate: they converge together."""
    float_correlation_time_s: Positive = 120.0
    """Correlation time when the ambiguities float [s]. Estimate (minutes, the time in which ambiguities converge)."""
    velocity_sigma_m_s: NonNegative = 0.03
    """White error of the velocity, per axis [m/s]. Estimate (Doppler, 0.01-0.05)."""
    latency_s: Latency = 0.0
    """Latency of the delivered solution, whole ticks [s]. Estimate: the receiver's own is under a tick."""

    def init(self, seed: int) -> GnssState:
        """The error drawn from its stationary distribution; no solution under way."""
        generator, float_generator = stream(seed, "gnss"), stream(seed, "gnss.float")
        return GnssState(generator, _pair(generator), float_generator, _pair(float_generator))

    def measure(
        self, state: GnssState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[GnssState, GnssReading]:
        """The solution delivered at this tick.

        Quality and offset in `conditions` apply to the solution computed now, the latency to the one delivered now.
        While the latency grows nothing new arrives; when it shrinks, overtaken solutions are lost.
        """
        w = state.generator.standard_normal(6).tolist()
        generator, correlated, float_generator, float_correlated, pending = state
        correlated = _correlated(correlated, (w[0], w[1]), dt, self.correlation_time_s)
        float_correlated = _correlated(float_correlated, _pair(float_generator), dt, self.float_correlation_time_s)
        quality = conditions.gnss_quality
        fix = None if quality == Quality.NONE else self._fix(correlated, float_correlated, truth, conditions, w[2:])
        pending = (*pending, GnssReading(fix, quality))
        due = len(pending) - 1 - round((self.latency_s + conditions.gnss_latency_s) / dt)
        reading = pending[due] if due >= 0 else GnssReading(None, Quality.NONE)
        left = pending[due + 1 :] if due >= 0 else pending
        return GnssState(generator, correlated, float_generator, float_correlated, left), reading

    def _fix(
        self, correlated: Pair, float_correlated: Pair, truth: Truth, conditions: Conditions, white: list[float]
    ) -> Fix:
        if conditions.gnss_quality == Quality.FIX:
            sigma, share = self.sigma_m, self.correlated_fraction
        else:
            sigma, share, correlated = self.float_sigma_m, self.float_correlated_fraction, float_correlated
        slow, fast = sigma * sqrt(share), sigma * sqrt(1.0 - share)
        x, y, _ = truth.antenna
        vx, vy, _ = truth.antenna_velocity
        dx, dy = conditions.gnss_offset
        return Fix(
            x=x + dx + slow * correlated[0] + fast * white[0],
            y=y + dy + slow * correlated[1] + fast * white[1],
            vx=vx + self.velocity_sigma_m_s * white[2],
            vy=vy + self.velocity_sigma_m_s * white[3],
            t=truth.t,
        )


def _pair(generator: Generator) -> Pair:
    east, north = generator.standard_normal(2).tolist()
    return east, north


def _correlated(value: Pair, white: Pair, dt: float, correlation: float) -> Pair:
    """The next values of both axes, in units of their standard deviation [-]."""
    return gauss_markov(value[0], white[0], dt, correlation), gauss_markov(value[1], white[1], dt, correlation)
