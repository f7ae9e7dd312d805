"""Brake: applied where standstill is asked for, released as soon as the tractor is asked to drive.

A law asks for standstill by a speed of exactly zero, the supervisor's stop by a pedal in neutral. The hydrostat brings
the tractor to rest by then; the brake holds it there, and stops one that the hydrostat does not hold.
"""

from math import inf
from typing import NamedTuple

from agrobot_mj.core.signals import Command

STANDSTILL_S = 1.0
"""Time for which standstill is asked for before the brake is applied: three lags of the pump [s]. Estimate."""


class BrakeState(NamedTuple):
    """Memory of the brake; before the first tick the tractor is parked."""

    standing_s: float = inf
    """Time for which standstill has been asked for [s]."""

    @property
    def share(self) -> float:
        """Share of the brake's torque that is applied, 0 or 1 [-]."""
        return 1.0 if self.standing_s >= STANDSTILL_S else 0.0

    def after(self, command: Command, dt: float) -> "BrakeState":
        """State `dt` [s] later, under the command that the low-level loops get."""
        asked = command.speed if command.pedal is None else command.pedal
        return BrakeState(self.standing_s + dt if asked == 0.0 else 0.0)
