"""Yaw rate gyro: true rate, constant bias, random walk of the bias, white noise.

Measurements are in rad/s, keys in deg/s. The random walk has a separate random stream and starts at zero. A gyro on the
chassis measures about the chassis axis: on a slope its output differs from the yaw rate by the cosine of the tilt and
contains parts of the roll and pitch rates.
"""

from math import nan, radians, sqrt
from typing import Literal, NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative
from agrobot_mj.sensors.base import OptionalSensor


class GyroState(NamedTuple):
    """State of the gyro between two ticks."""

    generator: Generator
    """Random stream of the white noise, advanced in place."""
    walk_generator: Generator
    """Random stream of the random walk, advanced in place."""
    walk_deg_s: float = 0.0
    """Random-walk part of the bias [deg/s]."""


class Gyro(OptionalSensor):
    """Yaw rate gyro; `[sensors.gyro]`."""

    column = Column("gyro", "rad/s", "yaw rate from the gyro")

    axes: Literal["vertical", "body"] = "vertical"
    """Measured axis: `vertical` for a levelled gyro, `body` for a gyro that tilts with the chassis."""
    sigma_deg_s: NonNegative = 0.1
    """White noise [deg/s]. Assumed value (0.05-0.3: MEMS, mean over a tick)."""
    bias_deg_s: float = 0.0
    """Constant bias [deg/s]. Assumed value: up to 0.1 after calibration."""
    bias_walk_deg_s_rt_s: NonNegative = 0.002
    """Random walk of the bias [deg/s/sqrt(s)]. Assumed value (0.001-0.01: MEMS during warm-up)."""

    def init(self, seed: int) -> GyroState:
        """Return the state before the first tick, with a random walk of zero."""
        return GyroState(stream(seed, "gyro"), stream(seed, "gyro.bias"))

    def measure(self, state: GyroState, truth: Truth, conditions: Conditions, dt: float) -> tuple[GyroState, float]:
        """Return the yaw rate, or the rate about the vertical axis of the chassis [rad/s]."""
        if not self.enabled:
            return state, nan
        generator, walk_generator, walk = state
        walk += self.bias_walk_deg_s_rt_s * sqrt(dt) * walk_generator.standard_normal()
        error = self.bias_deg_s + walk + self.sigma_deg_s * generator.standard_normal()
        rate = truth.yaw_rate if self.axes == "vertical" else truth.body_rates[2]
        return GyroState(generator, walk_generator, walk), rate + radians(error)
