"""Attitude from an inertial unit that fuses its own gyros and accelerometers: roll and pitch in, both with errors out.

Error per axis = constant bias + slow wander (first-order Gauss-Markov [Brown2012]: thermal drift, accelerations
taken for tilt) + white noise. Angles in rad, ISO 8855: roll left side up, pitch nose down positive; keys in deg.
"""

from math import nan, radians
from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import gauss_markov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import Sensor


class Attitude(NamedTuple):
    """Reading of the unit; NaN without one."""

    roll: float
    """Roll, left side up positive [rad]."""
    pitch: float
    """Pitch, nose down positive [rad]."""


class ImuState(NamedTuple):
    """The unit between two ticks."""

    generator: Generator
    """Random stream; advances in place."""
    wander: tuple[float, float]
    """Slow error of roll and pitch, in units of its standard deviation [-]."""


class Imu(Sensor):
    """Inertial unit on the chassis, which the paper's tractor does not have; `[sensors.imu]`."""

    enabled: bool = False
    """Whether there is a unit; roll and pitch read NaN without one."""
    sigma_deg: NonNegative = 0.1
    """White noise of a reading, each axis [deg]. Estimate (MEMS, averaged over a tick)."""
    wander_sigma_deg: NonNegative = 0.2
    """Slow error, each axis [deg]. Estimate (0.1-0.5 for the class sold with guidance)."""
    wander_time_s: Positive = 60.0
    """Correlation time of the slow error [s]. Estimate."""
    roll_bias_deg: float = 0.0
    """Constant error of the roll: mounting, calibration [deg]. Estimate."""
    pitch_bias_deg: float = 0.0
    """Constant error of the pitch [deg]. Estimate."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Both angles, where there is a unit."""
        found = (
            Column("imu_roll", "rad", "roll from the inertial unit, left side up positive"),
            Column("imu_pitch", "rad", "pitch from the inertial unit, nose down positive"),
        )
        return found if self.enabled else ()

    def init(self, seed: int) -> ImuState:
        """The slow error drawn from its stationary distribution."""
        generator = stream(seed, "imu")
        roll, pitch = generator.standard_normal(2).tolist()
        return ImuState(generator, (roll, pitch))

    def measure(self, state: ImuState, truth: Truth, conditions: Conditions, dt: float) -> tuple[ImuState, Attitude]:
        """Measured roll and pitch [rad]."""
        if not self.enabled:
            return state, Attitude(nan, nan)
        w = state.generator.standard_normal(4).tolist()
        b_r, b_p = (gauss_markov(b, w_b, dt, self.wander_time_s) for b, w_b in zip(state.wander, w[:2], strict=True))
        e_r = self.roll_bias_deg + self.wander_sigma_deg * b_r + self.sigma_deg * w[2]
        e_p = self.pitch_bias_deg + self.wander_sigma_deg * b_p + self.sigma_deg * w[3]
        reading = Attitude(truth.roll + radians(e_r), truth.pitch + radians(e_p))
        return ImuState(state.generator, (b_r, b_p)), reading

    def report(self, reading: Attitude) -> tuple[float, ...]:
        """Both angles, where there is a unit."""
        return reading if self.enabled else ()
