"""One tyre has lost its pressure."""

from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import WHEELS, Conditions
from agrobot_mj.core.spec import Scale
from agrobot_mj.faults.base import Scripted


class SoftTyre(Scripted):
    """One tyre sinks deeper, holds its direction less and rolls harder; `contact` has no carcass to soften."""

    machine = True

    kind: Literal["soft_tyre"] = "soft_tyre"
    wheel: Literal["fl", "fr", "rl", "rr"] = "rl"
    """Wheel: front or rear, left or right."""
    stiffness_share: Annotated[float, Field(ge=0.15, le=1)] = 0.4
    """Remaining share of its vertical and slip stiffness [-]. Estimate: half the pressure (0.3-0.7)."""
    rolling_share: Scale = 1.6
    """Rolling resistance over that of the healthy tyre [-]. Estimate: inversely as the root of the pressure."""

    @property
    def subject(self) -> str:
        """Its wheel: another tyre may be soft at the same time."""
        return f"{self.kind} {self.wheel}"

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Soften the tyre."""
        i = WHEELS.index(self.wheel)
        return None, conditions._replace(
            tyre_stiffness=_scaled(conditions.tyre_stiffness, i, self.stiffness_share),
            tyre_rolling=_scaled(conditions.tyre_rolling, i, self.rolling_share),
        )


Four = tuple[float, float, float, float]


def _scaled(values: Four, i: int, share: float) -> Four:
    a, b, c, d = (value * share if k == i else value for k, value in enumerate(values))
    return a, b, c, d
