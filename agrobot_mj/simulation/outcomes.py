"""Outcomes of a run: those that the plant detects, and those that need the reference or a history."""

from math import hypot, inf
from typing import NamedTuple

from agrobot_mj.core.signals import TICK_S, Truth
from agrobot_mj.paths.base import ReferencePath
from agrobot_mj.plants import RunningPlant

LOST_M = 50.0
"""Distance from its reference at which a tractor counts as diverged [m]. Assumed value."""
STUCK_S = 10.0
"""Time after which a tractor that should drive, but does not move, counts as stuck [s]. Assumed value."""
STUCK_M = 0.3
"""Radius within which it must stay to count as not moving [m]. Assumed value: 0.03 m/s."""
STUCK_PEDAL = 0.05
"""Pedal position beyond which it is commanded to drive [-]: 0.25 m/s. Assumed value."""
LEFT_M = 1.0
"""Distance that a reference gains on a tractor it leaves behind [m]. Assumed value: a second of driving."""


class Standstill(NamedTuple):
    """How long a tractor has not moved."""

    x: float = inf
    """Place near which it has stayed, east; infinite before the first tick [m]."""
    y: float = inf
    """Place near which it has stayed, north; infinite before the first tick [m]."""
    tried_s: float = 0.0
    """Time for which it has stayed there although the pedal is pressed, or asked for in vain [s]."""
    waited_s: float = 0.0
    """Time for which it has stayed there although it is to follow its reference [s]."""
    distance: float = 0.0
    """Distance from its reference at the beginning of that time [m]."""


class Watch:
    """Detects conditions that end a run early."""

    def __init__(self, plant: RunningPlant) -> None:
        self.plant, self.standstill = plant, Standstill()

    def trouble(self, truth: Truth, distance: float, asked: float = 0.0, led: bool = True) -> str | None:
        """The outcome that ends the run after this tick, if any.

        `distance` is that from the reference [m], `asked` the pedal position that the speed loop asks for [-]; `led`
        says whether the tractor is to follow the reference in this tick.
        """
        found = self.plant.trouble()
        if found is not None:
            return found
        if not distance < LOST_M:
            return "diverged"
        return "stuck" if self._stuck(truth, distance, asked, led) else None

    def _stuck(self, truth: Truth, distance: float, asked: float, led: bool) -> bool:
        """Whether it has not moved for long though it is driven, or though its reference leaves it behind."""
        at = self.standstill
        if hypot(truth.x - at.x, truth.y - at.y) > STUCK_M:
            at = Standstill(truth.x, truth.y)
        tries = max(abs(truth.pedal), abs(asked)) >= STUCK_PEDAL
        at = self.standstill = Standstill(
            at.x,
            at.y,
            tried_s=at.tried_s + TICK_S if tries else 0.0,
            waited_s=at.waited_s + TICK_S if led else 0.0,
            distance=at.distance if at.waited_s else distance,
        )
        return at.tried_s > STUCK_S or (at.waited_s > STUCK_S and distance - at.distance > LEFT_M)


def past_end(path: ReferencePath, truth: Truth) -> bool:
    """Whether the tractor has passed the end of a path that has one, after the reference."""
    if not path.ends or truth.t < path.duration_s:
        return False
    end = path.at(path.duration_s)
    return (truth.x - end.x) * end.vx + (truth.y - end.y) * end.vy >= 0.0
