"""Implement at the hitch: plough, cultivator, trailer. Its pull resists every motion."""

from math import exp, log1p, sqrt
from typing import Annotated, Literal

from numpy.random import Generator
from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import Positive, Spread
from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.noise import Noise, noise


class Drawbar(Scripted):
    """A pull against the motion, constant or as uneven as the soil.

    The uneven pull is log-normal, so that it is never negative and keeps its mean. Its place is the tractor's hitch.
    """

    machine = True

    kind: Literal["drawbar"] = "drawbar"
    pull_n: Annotated[float, Field(ge=0, le=1e5)] = 1500.0
    """Mean pull [N]. Estimate: a fifth of the weight, a light cultivator (500-3000)."""
    noise_share: Spread = 0.0
    """Standard deviation over the mean [-]. None by default; in soil 0.1-0.3, estimate."""
    noise_time_s: Positive = 0.5
    """Correlation time of the unevenness [s]. Estimate: half a metre of soil at 1 m/s."""

    def init(self, generator: Generator) -> Noise:
        """Unevenness, from its steady state on."""
        return noise(generator)

    def apply(self, state: Noise, conditions: Conditions, t: float, dt: float) -> tuple[Noise, Conditions]:
        """Add the pull."""
        spread = log1p(self.noise_share**2)
        pull = self.pull_n * exp(sqrt(spread) * state.value - spread / 2)
        return state.step(dt, self.noise_time_s), conditions._replace(drawbar=conditions.drawbar + pull)
