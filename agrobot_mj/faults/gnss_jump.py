"""Positions that jump and stay there: ambiguities fixed to wrong integers, another base station."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.gnss_drift import Metres, shifted


class GnssJump(Scripted):
    """A constant offset of the position; quality and velocity are those of a sound solution."""

    kind: Literal["gnss_jump"] = "gnss_jump"
    east_m: Metres = 0.0
    """Offset east [m]."""
    north_m: Metres = 1.0
    """Offset north [m]. Estimate (0.2-5: some wavelengths, a base station entered wrongly)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Shift the position."""
        return None, shifted(conditions, self.east_m, self.north_m)
