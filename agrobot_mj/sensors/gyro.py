"""Yaw rate gyro: truth plus constant bias plus white noise. Radians per second, keys in degrees per second."""

from math import nan, radians

from numpy.random import Generator

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative
from agrobot_mj.sensors.base import Sensor


class Gyro(Sensor):
    """Yaw rate gyro, which the paper's tractor does not have; `[sensors.gyro]`."""

    enabled: bool = False
    """Whether there is a gyro; the reading is NaN without one."""
    sigma_deg_s: NonNegative = 0.1
    """White noise of a reading [deg/s]. Estimate (MEMS, averaged over a tick)."""
    bias_deg_s: float = 0.0
    """Constant error [deg/s]. Estimate."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The reading, where there is a gyro."""
        return (Column("gyro", "rad/s", "yaw rate from the gyro"),) if self.enabled else ()

    def init(self, seed: int) -> Generator:
        """Its random stream, which advances in place."""
        return stream(seed, "gyro")

    def measure(self, state: Generator, truth: Truth, conditions: Conditions, dt: float) -> tuple[Generator, float]:
        """Yaw rate [rad/s]."""
        if not self.enabled:
            return state, nan
        return state, truth.yaw_rate + radians(self.bias_deg_s + self.sigma_deg_s * state.standard_normal())

    def report(self, reading: float) -> tuple[float, ...]:
        """The reading, where there is a gyro."""
        return (reading,) if self.enabled else ()
