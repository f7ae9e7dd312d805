"""Ground speed from a Doppler radar below the tractor.

reading = |u| / cos(pitch) * (1 + scale error + ground) + white noise, zero below a least speed, where the Doppler shift
drowns in vibration. Crops and clods that move or hide the ground, and the tractor's own pitching, change the reading
slowly (first-order Gauss-Markov [Brown2012]). It sees no wheel slip and does not tell reverse from forward. SI units.
"""

from math import cos, nan
from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import gauss_markov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import Sensor


class RadarSpeedState(NamedTuple):
    """The sensor between two ticks."""

    generator: Generator
    """Random stream; advances in place."""
    ground: float
    """Slow error by the ground, in units of its standard deviation [-]."""


class RadarSpeed(Sensor):
    """Doppler radar, which the paper's tractor does not have; `[sensors.radar_speed]`."""

    enabled: bool = False
    """Whether there is one; the reading is NaN without."""
    sigma_m_s: NonNegative = 0.03
    """White noise of a reading [m/s]. Estimate: 2-5 cm/s, the width of the Doppler spectrum over a tick."""
    scale_error: float = 0.01
    """Constant relative error [-]. Estimate (0-0.03: the angle at which it is mounted)."""
    ground_sigma: NonNegative = 0.01
    """Slow relative error by crop and clods [-]. Estimate (0.005-0.03)."""
    ground_time_s: Positive = 5.0
    """Correlation time of that error [s]. Estimate: some metres of ground."""
    least_speed_m_s: NonNegative = 0.2
    """Speed below which the reading is zero [m/s]. Estimate (0.1-0.5)."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The reading, where there is a sensor."""
        return (Column("radar_speed", "m/s", "ground speed from the radar, never negative"),) if self.enabled else ()

    def init(self, seed: int) -> RadarSpeedState:
        """The slow error drawn from its stationary distribution."""
        generator = stream(seed, "radar_speed")
        return RadarSpeedState(generator, float(generator.standard_normal()))

    def measure(
        self, state: RadarSpeedState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[RadarSpeedState, float]:
        """Ground speed, not negative [m/s]."""
        if not self.enabled:
            return state, nan
        w_ground, w = state.generator.standard_normal(2).tolist()
        ground = gauss_markov(state.ground, w_ground, dt, self.ground_time_s)
        reading, along = 0.0, abs(truth.speed) / cos(truth.pitch)
        if along >= self.least_speed_m_s:
            reading = max((1.0 + self.scale_error + self.ground_sigma * ground) * along + self.sigma_m_s * w, 0.0)
        return RadarSpeedState(state.generator, ground), reading

    def report(self, reading: float) -> tuple[float, ...]:
        """The reading, where there is a sensor."""
        return (reading,) if self.enabled else ()
