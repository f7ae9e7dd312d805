"""Lines that repeat themselves: a frozen bus message, a sheared shaft, a jammed spool; or that carry zero.

A valve whose line is stuck holds its spool: at its last voltage, or with `value = "zero"` at neutral, which is dead.
"""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.line import LineFault


class Stuck(LineFault):
    """A signal that stays as it was before the window; from the start of a run, at its first value."""

    value: Literal["last", "zero"] = "last"
    """Value that it keeps: the `last` one, or `zero`."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Freeze the signal."""
        return None, self.distorted(conditions, stuck=self.value)


class SteeringPotStuck(Stuck):
    """The steering angle's reading stays."""

    kind: Literal["steering_pot_stuck"] = "steering_pot_stuck"


class PedalPotStuck(Stuck):
    """The pedal position's reading stays."""

    kind: Literal["pedal_pot_stuck"] = "pedal_pot_stuck"


class GyroStuck(Stuck):
    """The gyro's reading stays."""

    kind: Literal["gyro_stuck"] = "gyro_stuck"


class WheelSpeedStuck(Stuck):
    """The wheel speed's reading stays."""

    kind: Literal["wheel_speed_stuck"] = "wheel_speed_stuck"


class HeadingStuck(Stuck):
    """The heading from two antennas stays."""

    kind: Literal["heading_stuck"] = "heading_stuck"


class ValveStuck(Stuck):
    """The spool of the steering valve stays."""

    kind: Literal["valve_stuck"] = "valve_stuck"


class PedalValveStuck(Stuck):
    """The spool of the pedal valve stays."""

    kind: Literal["pedal_valve_stuck"] = "pedal_valve_stuck"
