"""How a run ends: what the plant says of itself, and what only shows against the reference or over time."""

from math import hypot

from agrobot_mj.core.signals import TICK_S, Truth
from agrobot_mj.plants import RunningPlant

LOST_M = 50.0
"""A tractor this far from its reference has diverged [m]. Estimate."""
STUCK_S = 10.0
"""A tractor that is told to drive is stuck when for this long [s] ... Estimate."""
STUCK_M = 0.3
"""... it stays within this distance of a place [m]. Estimate: 0.03 m/s."""
STUCK_PEDAL = 0.05
"""Pedal beyond which it is told to drive [-]: 0.25 m/s. Estimate."""


class Watch:
    """Watches a run for an end before its time."""

    def __init__(self, plant: RunningPlant, start: Truth) -> None:
        self.plant, self.place, self.still_s = plant, (start.x, start.y), 0.0

    def trouble(self, truth: Truth, off: float) -> str | None:
        """The outcome that ends the run after this tick, if any; `off` is the distance from the reference [m]."""
        found = self.plant.trouble()
        if found is not None:
            return found
        if not off < LOST_M:
            return "diverged"
        return "stuck" if self._stuck(truth) else None

    def _stuck(self, truth: Truth) -> bool:
        away = hypot(truth.x - self.place[0], truth.y - self.place[1])
        if abs(truth.pedal) < STUCK_PEDAL or away > STUCK_M:
            self.place, self.still_s = (truth.x, truth.y), 0.0
        self.still_s += TICK_S
        return self.still_s > STUCK_S
