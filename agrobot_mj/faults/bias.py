"""Readings with an offset: a slipped clamp, a bent linkage, a drifting supply; at once or growing evenly."""

from math import radians
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import NonNegative
from agrobot_mj.faults.line import LineFault


class Bias(LineFault):
    """A constant error of a reading; a kind has the key of its offset, in its unit."""

    ramp_s: NonNegative = 0.0
    """Time in which it grows linearly from zero, 0 for at once [s]."""

    @property
    def offset(self) -> float:
        """Offset in SI units."""
        raise NotImplementedError

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Shift the reading."""
        offset = self.distortion(conditions).offset + self.offset * self.grown(t, self.ramp_s)
        return None, self.distorted(conditions, offset=offset)


class SteeringPotBias(Bias):
    """The steering angle reads too far to one side."""

    kind: Literal["steering_pot_bias"] = "steering_pot_bias"
    bias_deg: Annotated[float, Field(ge=-90, le=90)] = 2.0
    """Offset of the reading, left positive [deg]. Estimate (1-5: a clamp that has slipped)."""

    @property
    def offset(self) -> float:
        """Offset [rad]."""
        return radians(self.bias_deg)


class PedalPotBias(Bias):
    """The pedal position reads too far forward."""

    kind: Literal["pedal_pot_bias"] = "pedal_pot_bias"
    bias: Annotated[float, Field(ge=-2, le=2)] = 0.1
    """Offset of the reading, forward positive [-]. Estimate (0.05-0.2: a clamp that has slipped)."""

    @property
    def offset(self) -> float:
        """Offset [-]."""
        return self.bias


class GyroBias(Bias):
    """The gyro reads a turn that is not there."""

    kind: Literal["gyro_bias"] = "gyro_bias"
    bias_deg_s: Annotated[float, Field(ge=-1000, le=1000)] = 5.0
    """Offset of the reading, left positive [deg/s]. Estimate (2-20: a shock, a supply that drops)."""

    @property
    def offset(self) -> float:
        """Offset [rad/s]."""
        return radians(self.bias_deg_s)


class HeadingBias(Bias):
    """The heading from two antennas is turned: ambiguities fixed to wrong integers, an antenna that was hit."""

    kind: Literal["heading_bias"] = "heading_bias"
    bias_deg: Annotated[float, Field(ge=-180, le=180)] = 10.0
    """Offset of the heading, left positive [deg]. Estimate (5-180: a wavelength over the baseline is 11 deg)."""

    @property
    def offset(self) -> float:
        """Offset [rad]."""
        return radians(self.bias_deg)
