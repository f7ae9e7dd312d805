"""Speed of the driven rear wheels, as a pulse wheel on the differential gives it: spin times a believed radius.

reading = (1 + scale error + slip) * circumferential speed + white noise, zero below a least speed, where pulses are too
far apart. A plant with tyres slips by itself; `slip_sigma`, first-order Gauss-Markov [Brown2012], comes on top for the
plant that does not, and for ground that is uneven within a patch. SI units, forward positive.
"""

from math import nan
from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import gauss_markov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import Sensor


class WheelSpeedState(NamedTuple):
    """The sensor between two ticks."""

    generator: Generator
    """Random stream; advances in place."""
    slip: float
    """Slow slip, in units of its standard deviation [-]."""


class WheelSpeed(Sensor):
    """Speed sensor on the driven axle, which the paper's tractor does not have; `[sensors.wheel_speed]`."""

    enabled: bool = False
    """Whether there is a sensor; the reading is NaN without one."""
    sigma_m_s: NonNegative = 0.02
    """White noise of a reading [m/s]. Estimate: 1-3 cm/s, pulses within a tick."""
    scale_error: float = 0.02
    """Constant relative error: believed over true radius, less one [-]. Estimate (0-0.05: wear, pressure)."""
    slip_sigma: NonNegative = 0.002
    """Slow slip, relative to the speed [-]. Estimate: a tenth of the mean slip without draught (0.001-0.01)."""
    slip_time_s: Positive = 10.0
    """Correlation time of the slow slip [s]. Estimate: ten metres of ground."""
    least_speed_m_s: NonNegative = 0.03
    """Speed below which the reading is zero [m/s]. Estimate: a few pulses per second."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The reading, where there is a sensor."""
        return (Column("wheel_speed", "m/s", "speed of the driven wheels from their sensor"),) if self.enabled else ()

    def init(self, seed: int) -> WheelSpeedState:
        """The slow slip drawn from its stationary distribution."""
        generator = stream(seed, "wheel_speed")
        return WheelSpeedState(generator, float(generator.standard_normal()))

    def measure(
        self, state: WheelSpeedState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[WheelSpeedState, float]:
        """Speed of the driven axle [m/s]."""
        if not self.enabled:
            return state, nan
        w_slip, w = state.generator.standard_normal(2).tolist()
        slip = gauss_markov(state.slip, w_slip, dt, self.slip_time_s)
        reading = 0.0
        if abs(truth.wheel_speed) >= self.least_speed_m_s:
            reading = (1.0 + self.scale_error + self.slip_sigma * slip) * truth.wheel_speed + self.sigma_m_s * w
        return WheelSpeedState(state.generator, slip), reading

    def report(self, reading: float) -> tuple[float, ...]:
        """The reading, where there is a sensor."""
        return (reading,) if self.enabled else ()
