"""Payload on the chassis: sprayer tank, crate, weights; or ballast taken away."""

from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions, PointMass
from agrobot_mj.core.spec import NonNegative
from agrobot_mj.faults.base import Scripted

Metres = Annotated[float, Field(ge=-20, le=20)]


class Payload(Scripted):
    """A point mass rigidly on the chassis; several at different places add up."""

    machine = True

    kind: Literal["payload"] = "payload"
    mass_kg: Annotated[float, Field(ge=-1e4, le=1e4)] = 100.0
    """Mass, negative for ballast taken away [kg]. Estimate: a tank or a crate on a compact tractor (50-300)."""
    ahead_m: Metres = -0.6
    """Distance ahead of the rear axle [m]. Estimate: on the three-point linkage."""
    left_m: Metres = 0.0
    """Distance to the left of the middle [m]."""
    up_m: NonNegative = 0.7
    """Height above the ground [m]. Estimate: on the three-point linkage (0.5-1)."""

    @property
    def subject(self) -> str:
        """Its place: payloads elsewhere may be there at the same time."""
        return f"{self.kind} at {self.ahead_m:g}, {self.left_m:g}, {self.up_m:g} m"

    @property
    def load(self) -> PointMass:
        """Point mass on the chassis."""
        return PointMass(self.mass_kg, self.ahead_m, self.left_m, self.up_m)

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Add the mass."""
        added = (self.load,) if self.mass_kg else ()
        return None, conditions._replace(payload=conditions.payload + added)
