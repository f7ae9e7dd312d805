"""A worn steering valve: oil leaks past the spool, and its dead band is wider."""

from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import Fraction, NonNegative
from agrobot_mj.faults.base import Scripted


class ValveWear(Scripted):
    """Less flow and a wider dead band, either side."""

    kind: Literal["valve_wear"] = "valve_wear"
    gain_share: Fraction = 0.7
    """Remaining share of the flow, at any voltage [-]. Estimate (0.5-0.9: leakage past the spool)."""
    dead_band_v: Annotated[float, Field(ge=0, le=6)] = 0.4
    """Increase of the dead band's half width [V]. Estimate (0.2-0.8: 2-7 % of the range)."""
    ramp_s: NonNegative = 0.0
    """Time in which both grow linearly from zero, 0 for at once [s]."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Wear the valve."""
        grown = self.grown(t, self.ramp_s)
        gain = 1.0 - grown * (1.0 - self.gain_share)
        return None, conditions._replace(
            valve_gain=conditions.valve_gain * gain,
            valve_dead_band=conditions.valve_dead_band + grown * self.dead_band_v,
        )
