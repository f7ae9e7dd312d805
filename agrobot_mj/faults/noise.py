"""A first-order Gauss-Markov process for disturbances that fluctuate: unit variance, from its steady state on."""

from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import gauss_markov


class Noise(NamedTuple):
    """The process; `generator` moves on with every step."""

    generator: Generator
    value: float
    """[-]."""

    def step(self, dt: float, correlation: float) -> "Noise":
        """After `dt`, where the correlation falls to 37 % over `correlation`, both in the same unit."""
        white = float(self.generator.normal())
        return self._replace(value=gauss_markov(self.value, white, dt, correlation))


def noise(generator: Generator) -> Noise:
    """A process of its own, somewhere in its steady state."""
    return Noise(generator, float(generator.normal()))
