"""A force from the side: wind, or the side draught of an implement."""

from typing import Annotated, Literal

from numpy.random import Generator
from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import Positive, Spread
from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.noise import Noise, noise


class SideForce(Scripted):
    """A horizontal force on the centre of mass, square to the heading, steady or gusty."""

    machine = True

    kind: Literal["side_force"] = "side_force"
    force_n: Annotated[float, Field(ge=-1e5, le=1e5)] = 300.0
    """Mean force to the left [N]. Estimate: wind of 15 m/s on 2 m2; side draught up to 1000."""
    gust_share: Spread = 0.0
    """Standard deviation over the mean [-]. None by default; wind 0.2-0.5, estimate."""
    gust_time_s: Positive = 2.0
    """Correlation time of the gusts [s]. Estimate."""

    def init(self, generator: Generator) -> Noise:
        """Gusts, from their steady state on."""
        return noise(generator)

    def apply(self, state: Noise, conditions: Conditions, t: float, dt: float) -> tuple[Noise, Conditions]:
        """Add the force."""
        force = self.force_n * (1.0 + self.gust_share * state.value)
        return state.step(dt, self.gust_time_s), conditions._replace(side_force=conditions.side_force + force)
