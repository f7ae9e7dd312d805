"""One seed, split by name into independent random streams.

The stream of a name depends on the seed and on that name alone: adding, removing or reordering sensors shifts
no other stream, and the same seed gives the same numbers in every process (Python's own `hash` is salted).
"""

import io
import pickle
from functools import lru_cache
from hashlib import blake2b
from math import exp, sqrt
from typing import Any, NamedTuple, cast

from numpy.random import Generator, SeedSequence, default_rng


def stream(seed: int, name: str) -> Generator:
    """The random stream called `name` of the run's `seed`.

    Raises ValueError for a negative seed.
    """
    key = int.from_bytes(blake2b(name.encode(), digest_size=16).digest(), "little")
    return default_rng(SeedSequence(seed, spawn_key=(key,)))


def generators(state: Any) -> list[Generator]:
    """Every random generator in a state that can be pickled, wherever in it, each once."""
    finder = _Finder(io.BytesIO())
    finder.dump(state)
    return finder.found


class _Finder(pickle.Pickler):
    """Collects generators instead of writing them."""

    def __init__(self, nowhere: io.BytesIO) -> None:
        super().__init__(nowhere, protocol=pickle.HIGHEST_PROTOCOL)
        self.found: list[Generator] = []

    def reducer_override(self, given: Any) -> Any:
        """Note a generator; all else is pickled as ever."""
        if not isinstance(given, Generator):
            return NotImplemented
        self.found.append(given)
        return int, ()


def branch(generator: Generator, number: int) -> None:
    """Let a generator go on, in place, by a stream that depends on its seed, its name and `number` alone."""
    bits = generator.bit_generator
    seed = cast(SeedSequence, bits.seed_seq)
    bits.state = type(bits)(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, _BRANCH, number))).state


_BRANCH = int.from_bytes(blake2b(b"branch", digest_size=4).digest(), "little")
"""Key under which branches lie, apart from what `spawn` makes."""


def gauss_markov(value: float, white: float, dt: float, correlation: float) -> float:
    """The next value of a first-order Gauss-Markov process [Brown2012] of unit variance.

    `white` is standard normal; the correlation falls to 37 % over `correlation`, in the unit of the step `dt`.
    """
    kept = exp(-dt / correlation)
    return kept * value + sqrt(1.0 - kept * kept) * white


class GaussMarkov(NamedTuple):
    """First-order Gauss-Markov process of unit variance between two ticks, in one axis or in several."""

    generator: Generator
    """Random stream; advances in place."""
    value: tuple[float, ...]
    """Value in each axis, in units of its standard deviation [-]."""

    @classmethod
    def stationary(cls, generator: Generator, axes: int = 1) -> "GaussMarkov":
        """A process drawn from its stationary distribution."""
        return cls(generator, tuple(generator.standard_normal(axes).tolist()))

    def after(self, dt: float, *correlation: float) -> "GaussMarkov":
        """The process `dt` later; `correlation` in the unit of `dt`, one for all axes or one for each."""
        white = self.generator.standard_normal(len(self.value)).tolist()
        shares = _shares(dt, correlation, len(self.value))
        return GaussMarkov(
            self.generator, tuple([k * v + new * w for (k, new), v, w in zip(shares, self.value, white, strict=True)])
        )


@lru_cache(maxsize=256)
def _shares(dt: float, correlation: tuple[float, ...], axes: int) -> tuple[tuple[float, float], ...]:
    """Shares of the last value and of the white noise in the next one, for each axis, as in `gauss_markov` [-]."""
    times = correlation if len(correlation) > 1 else correlation * axes
    return tuple((gauss_markov(1.0, 0.0, dt, T), gauss_markov(0.0, 1.0, dt, T)) for T in times)
