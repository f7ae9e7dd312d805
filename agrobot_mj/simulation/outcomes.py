"""Conditions that end a run early, evaluated from the plant, the reference, and earlier ticks."""

from math import hypot, inf
from typing import NamedTuple

from agrobot_mj.core.kernels import shared
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.paths.base import ReferencePath
from agrobot_mj.plants import RunningPlant
from agrobot_mj.simulation.columns import Here

LOST_M = 50.0  # Distance from the reference above which a run has diverged [m]. Assumed value.
STUCK_S = 10.0  # Time without motion after which a tractor with a command to drive is stuck [s]. Assumed value.
STUCK_M = 0.3  # Maximum displacement of a stuck tractor [m]. Assumed value, equivalent to 0.03 m/s.
STUCK_PEDAL = 0.05  # Minimum pedal position of a command to drive [-]. Assumed value, equivalent to 0.25 m/s.
LEFT_M = 1.0
"""Increase in distance from the reference above which a tractor at rest counts as stuck [m]. Assumed value: about 1 s
of reference motion."""


class Standstill(NamedTuple):
    """Position and durations of a standstill of the tractor."""

    x: float = inf  # Position of the standstill [m], east, or infinity before the first tick
    y: float = inf  # Position of the standstill [m], north, or infinity before the first tick
    tried_s: float = 0.0  # Time at standstill with a measured or commanded pedal position above STUCK_PEDAL [s]
    waited_s: float = 0.0  # Time at standstill while the tractor should follow its reference [s]
    distance: float = 0.0  # Distance from the reference at the start of `waited_s` [m]


class Watch:
    """Detector of conditions that end a run early."""

    def __init__(self, plant: RunningPlant) -> None:
        self.plant, self.standstill = plant, Standstill()

    def trouble(self, truth: Here, distance: float, asked: float = 0.0, led: bool = True) -> str | None:
        """Return the outcome that ends the run after this tick, or None.

        `distance` [m] is the distance from the reference, and `asked` [-] is the pedal position commanded by the speed
        loop. `led` is True if the tractor should follow the reference in this tick.
        """
        found = self.plant.trouble()
        if found is not None:
            return found
        if not distance < LOST_M:
            return "diverged"
        self.standstill = standstill_after(self.standstill, truth, distance, asked, led)
        return "stuck" if is_stuck(self.standstill, distance) else None


@shared
def standstill_after(at: Standstill, truth: Here, distance: float, asked: float, led: bool) -> Standstill:
    """Return the position and durations of a standstill after a tick; the arguments are as for `Watch.trouble`."""
    x, y, tried_s, waited_s, since = at.x, at.y, at.tried_s, at.waited_s, at.distance
    if hypot(truth.x - x, truth.y - y) > STUCK_M:
        x, y, tried_s, waited_s, since = truth.x, truth.y, 0.0, 0.0, 0.0
    if waited_s == 0.0:
        since = distance
    tries = max(abs(truth.pedal), abs(asked)) >= STUCK_PEDAL
    return Standstill(x, y, tried_s + TICK_S if tries else 0.0, waited_s + TICK_S if led else 0.0, since)


@shared
def is_stuck(at: Standstill, distance: float) -> bool:
    """Return whether the tractor has been at rest for STUCK_S despite a pedal command or a receding reference."""
    return at.tried_s > STUCK_S or (at.waited_s > STUCK_S and distance - at.distance > LEFT_M)


def past_end(path: ReferencePath, truth: Here) -> bool:
    """Return whether the reference and the tractor have both passed the end of an open path."""
    if not path.ends or truth.t < path.duration_s:
        return False
    end = path.at(path.duration_s)
    return (truth.x - end.x) * end.vx + (truth.y - end.y) * end.vy >= 0.0
