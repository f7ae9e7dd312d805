"""A receiver that repeats its last position under live time stamps: hung firmware, a stalled bus gateway."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.base import Scripted


class GnssFrozen(Scripted):
    """The position stays as it was before the window."""

    kind: Literal["gnss_frozen"] = "gnss_frozen"
    keep: Literal["nothing", "velocity", "live_velocity"] = "nothing"
    """What it says of its velocity: `nothing` for standstill, the last `velocity` again, or `live_velocity`."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Freeze the solution."""
        return None, conditions._replace(gnss_frozen=self.keep)
