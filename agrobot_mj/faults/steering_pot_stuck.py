"""Steering potentiometer that repeats its last reading: a frozen bus message, a sheared shaft."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.base import Scripted


class SteeringPotStuck(Scripted):
    """The steering angle's reading stays as it was before the window; from the start of a run, at its first value."""

    kind: Literal["steering_pot_stuck"] = "steering_pot_stuck"

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Freeze the reading."""
        return None, conditions._replace(steer_pot_stuck=True)
