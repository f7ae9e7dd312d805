"""Lines with a wrong gain: a wrong parameter, a shunt, another tyre; negative with wires or a sign swapped."""

from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.line import LineFault


class Scaled(LineFault):
    """A signal multiplied by a constant, for a valve its voltage from neutral."""

    scale: Annotated[float, Field(ge=-10, le=10)] = -1.0
    """Signal over the true one [-]. Estimate: the sign swapped; 0.5-2 for a wrong parameter."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Scale the signal."""
        return None, self.distorted(conditions, scale=self.scale * self.distortion(conditions).scale)


class SteeringPotScale(Scaled):
    """The steering angle reads too much, too little or to the other side."""

    kind: Literal["steering_pot_scale"] = "steering_pot_scale"


class PedalPotScale(Scaled):
    """The pedal position reads too much, too little or the other way."""

    kind: Literal["pedal_pot_scale"] = "pedal_pot_scale"


class GyroScale(Scaled):
    """The gyro reads too much, too little or the other way."""

    kind: Literal["gyro_scale"] = "gyro_scale"


class WheelSpeedScale(Scaled):
    """The wheel speed reads too much, too little or backwards."""

    kind: Literal["wheel_speed_scale"] = "wheel_speed_scale"


class ValveScale(Scaled):
    """The steering valve opens too far, too little or to the other side."""

    kind: Literal["valve_scale"] = "valve_scale"


class PedalValveScale(Scaled):
    """The pedal valve opens too far, too little or the other way."""

    kind: Literal["pedal_valve_scale"] = "pedal_valve_scale"
