"""Outcomes of a run: those that the plant detects, and those that need the reference or a history."""

from math import hypot

from agrobot_mj.core.signals import TICK_S, Truth
from agrobot_mj.plants import RunningPlant

LOST_M = 50.0
"""Distance from its reference at which a tractor counts as diverged [m]. Estimate."""
STUCK_S = 10.0
"""Time after which a tractor that is commanded to drive, but does not move, counts as stuck [s]. Estimate."""
STUCK_M = 0.3
"""Radius within which it must stay to count as not moving [m]. Estimate: 0.03 m/s."""
STUCK_PEDAL = 0.05
"""Pedal position beyond which it is commanded to drive [-]: 0.25 m/s. Estimate."""


class Watch:
    """Detects conditions that end a run early."""

    def __init__(self, plant: RunningPlant, start: Truth) -> None:
        self.plant, self.place, self.still_s = plant, (start.x, start.y), 0.0

    def trouble(self, truth: Truth, distance: float, asked: float = 0.0) -> str | None:
        """The outcome that ends the run after this tick, if any.

        `distance` is that from the reference [m], `asked` the pedal position that the speed loop asks for [-].
        """
        found = self.plant.trouble()
        if found is not None:
            return found
        if not distance < LOST_M:
            return "diverged"
        return "stuck" if self._stuck(truth, asked) else None

    def _stuck(self, truth: Truth, asked: float) -> bool:
        """Whether it has not moved for long; behind a pedal that is asked for in vain the time counts backwards."""
        away = hypot(truth.x - self.place[0], truth.y - self.place[1])
        pressed = abs(truth.pedal) >= STUCK_PEDAL
        dead = not pressed and abs(asked) >= STUCK_PEDAL
        if away > STUCK_M or not (pressed or dead):
            self.place, self.still_s = (truth.x, truth.y), 0.0
        if dead != (self.still_s < 0.0):
            self.still_s = 0.0 if dead else max(self.still_s, TICK_S)
        self.still_s += -TICK_S if dead else TICK_S
        return abs(self.still_s) > STUCK_S
