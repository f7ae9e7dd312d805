"""A first-order Gauss-Markov process for disturbances that fluctuate: unit variance, from its steady state on."""

from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import gauss_markov


class Noise(NamedTuple):
    """The process between two ticks."""

    generator: Generator
    """Random stream; advances in place."""
    value: float
    """Value, of unit variance [-]."""

    def step(self, dt: float, correlation: float) -> "Noise":
        """The process after `dt`; its correlation falls to 37 % over `correlation`, in the unit of `dt`."""
        white = float(self.generator.normal())
        return self._replace(value=gauss_markov(self.value, white, dt, correlation))


def noise(generator: Generator) -> Noise:
    """A process drawn from its steady state."""
    return Noise(generator, float(generator.normal()))
