"""Yaw-rate gyro, whose error consists of constant bias, random walk of the bias, and white noise.

Measurements are in rad/s, keys in deg/s. The random walk has a separate random stream and starts at zero. A gyro fixed
to the chassis measures the rate about the z axis of the chassis. On a slope, this gyro measures the yaw rate times the
cosine of the tilt plus components of the roll and pitch rates.
"""

from math import radians, sqrt
from typing import Literal, NamedTuple

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.randomness import normal, stream
from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import NonNegative
from agrobot_mj.sensors.base import CompiledSensor, Noise, OptionalSensor, SensedMotion


class GyroLaw(NamedTuple):
    """Parameters of the gyro, as numbers for compiled kernels."""

    body: bool  # Whether the gyro tilts with the chassis
    sigma: float  # Standard deviation of the white noise [deg/s]
    bias: float  # Constant bias [deg/s]
    step: float  # Standard deviation of a step of the bias random walk [deg/s]


class GyroValues(NamedTuple):
    """State of the gyro between two ticks."""

    walk: float = 0.0  # Random-walk part of the bias [deg/s]


@jit
def gyro_rate(p: GyroLaw, s: GyroValues, streams: tuple[int, int], motion: SensedMotion) -> tuple[GyroValues, float]:
    """Return the new state and the measured rate [rad/s] about the vertical or, if `p.body`, the chassis z axis."""
    walk = s.walk + p.step * normal(streams[1])
    error = p.bias + walk + p.sigma * normal(streams[0])
    rate = motion.body_rates[2] if p.body else motion.yaw_rate
    return GyroValues(walk), rate + radians(error)


class Gyro(CompiledSensor, OptionalSensor):
    """Yaw-rate gyro, configured by the keys of `[sensors.gyro]`."""

    column = Column("gyro", "rad/s", "yaw rate from the gyro")
    law = gyro_rate

    axes: Literal["vertical", "body"] = "vertical"
    """Measured axis: `vertical` for a levelled gyro, `body` for a gyro that tilts with the chassis."""
    sigma_deg_s: NonNegative = 0.1
    """Standard deviation of the white noise [deg/s]. Assumed value (range 0.05-0.3) for a MEMS gyro averaged over a
    tick."""
    bias_deg_s: float = 0.0
    """Constant bias [deg/s]. Default: 0. Assumed value after calibration (up to 0.1)."""
    bias_walk_deg_s_rt_s: NonNegative = 0.002
    """Random-walk coefficient of the bias [deg/s/sqrt(s)]. Assumed value (range 0.001-0.01; maximum for MEMS gyros
    during warm-up)."""

    def parameters(self, dt: float) -> GyroLaw:
        """Return the parameters of the kernel `gyro_rate` for ticks of length `dt` [s]."""
        return GyroLaw(self.axes == "body", self.sigma_deg_s, self.bias_deg_s, self.bias_walk_deg_s_rt_s * sqrt(dt))

    def init(self, seed: int) -> Noise:
        """Return the initial state, in which the random walk of the bias is zero."""
        return Noise((stream(seed, "gyro"), stream(seed, "gyro.bias")), GyroValues())
