"""No GNSS solution at all: trees, a bridge, an unplugged antenna."""

from typing import Literal

from agrobot_mj.core.signals import Conditions, Quality
from agrobot_mj.faults.base import Scripted


class GnssLoss(Scripted):
    """The receiver has no solution."""

    kind: Literal["gnss_loss"] = "gnss_loss"

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Withhold the solution."""
        return None, conditions._replace(gnss_quality=min(conditions.gnss_quality, Quality.NONE))
