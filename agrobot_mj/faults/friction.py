"""Change of the ground's friction everywhere: rain begins, dew dries."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import Scale
from agrobot_mj.faults.base import Scripted


class Friction(Scripted):
    """All friction is scaled; the tyre `linear` has none to scale."""

    machine = True

    kind: Literal["friction"] = "friction"
    scale: Scale = 0.6
    """Friction over the nominal one [-]. Estimate: wet grass over dry (0.5-0.7)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Scale the grip."""
        return None, conditions._replace(grip=conditions.grip * self.scale)
