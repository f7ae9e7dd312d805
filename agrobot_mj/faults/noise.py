"""A first-order Gauss-Markov process for disturbances that fluctuate: unit variance, from its steady state on."""

from math import exp, sqrt
from typing import NamedTuple

from numpy.random import Generator


class Noise(NamedTuple):
    """The process; `generator` moves on with every step."""

    generator: Generator
    value: float
    """[-]."""

    def step(self, dt: float, correlation: float) -> "Noise":
        """After `dt`, where the correlation falls to 37 % over `correlation`, both in the same unit."""
        kept = exp(-dt / correlation)
        return self._replace(value=kept * self.value + sqrt(1.0 - kept * kept) * float(self.generator.normal()))


def noise(generator: Generator) -> Noise:
    """A process of its own, somewhere in its steady state."""
    return Noise(generator, float(generator.normal()))
