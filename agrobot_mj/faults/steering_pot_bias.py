"""Offset of the steering potentiometer: a slipped clamp, a bent linkage, a drifting supply."""

from math import radians
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import NonNegative
from agrobot_mj.faults.base import Scripted


class SteeringPotBias(Scripted):
    """A constant error of the steering angle's reading."""

    kind: Literal["steering_pot_bias"] = "steering_pot_bias"
    bias_deg: Annotated[float, Field(ge=-90, le=90)] = 2.0
    """Offset of the reading, left positive [deg]. Estimate (1-5: a clamp that has slipped)."""
    ramp_s: NonNegative = 0.0
    """Time in which it grows linearly from zero, 0 for at once [s]."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Shift the reading."""
        bias = radians(self.bias_deg) * self.grown(t, self.ramp_s)
        return None, conditions._replace(steer_pot_bias=conditions.steer_pot_bias + bias)
