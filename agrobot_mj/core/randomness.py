"""Independent random streams, identified by name, from one seed.

A stream depends only on the seed and its name: adding, removing or reordering sensors changes no other stream. The same
seed gives the same numbers in every process, unlike Python's salted `hash`.
"""

import io
import pickle
from functools import lru_cache
from hashlib import blake2b
from math import exp, sqrt
from typing import Any, NamedTuple, cast

from numpy.random import Generator, SeedSequence, default_rng


def stream(seed: int, name: str) -> Generator:
    """Return the random stream `name` of a run with this `seed`. Raises ValueError for a negative seed."""
    key = int.from_bytes(blake2b(name.encode(), digest_size=16).digest(), "little")
    return default_rng(SeedSequence(seed, spawn_key=(key,)))


def generators(state: Any) -> list[Generator]:
    """Return all random generators in a picklable state, at any depth, without duplicates."""
    finder = _Finder(io.BytesIO())
    finder.dump(state)
    return finder.found


class _Finder(pickle.Pickler):
    """Pickler that collects generators instead of writing them."""

    def __init__(self, nowhere: io.BytesIO) -> None:
        super().__init__(nowhere, protocol=pickle.HIGHEST_PROTOCOL)
        self.found: list[Generator] = []

    def reducer_override(self, given: Any) -> Any:
        """Record a generator; pickle other objects as usual."""
        if not isinstance(given, Generator):
            return NotImplemented
        self.found.append(given)
        return int, ()


def branch(generator: Generator, number: int) -> None:
    """Restart a generator in place with a stream that depends only on its seed, its name and `number`."""
    bits = generator.bit_generator
    seed = cast(SeedSequence, bits.seed_seq)
    bits.state = type(bits)(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, _BRANCH, number))).state


_BRANCH = int.from_bytes(blake2b(b"branch", digest_size=4).digest(), "little")
"""Spawn key of branches, distinct from the keys of `spawn`."""


def gauss_markov(value: float, white: float, dt: float, correlation: float) -> float:
    """Return the next value of a first-order Gauss-Markov process [Brown2012] of unit variance.

    `white` is a standard normal sample; the autocorrelation decreases to 37 % over `correlation`, in the unit of `dt`.
    """
    kept = exp(-dt / correlation)
    return kept * value + sqrt(1.0 - kept * kept) * white


class GaussMarkov(NamedTuple):
    """State of a first-order Gauss-Markov process of unit variance, with one or more axes."""

    generator: Generator
    value: tuple[float, ...]
    """Value in each axis, divided by its standard deviation [-]."""

    @classmethod
    def stationary(cls, generator: Generator, axes: int = 1) -> "GaussMarkov":
        """Return a process sampled from its stationary distribution."""
        return cls(generator, tuple(generator.standard_normal(axes).tolist()))

    def after(self, dt: float, *correlation: float) -> "GaussMarkov":
        """Return the process `dt` later; `correlation`, one value or one per axis, has the unit of `dt`."""
        white = self.generator.standard_normal(len(self.value)).tolist()
        shares = _shares(dt, correlation, len(self.value))
        return GaussMarkov(
            self.generator, tuple([k * v + new * w for (k, new), v, w in zip(shares, self.value, white, strict=True)])
        )


@lru_cache(maxsize=256)
def _shares(dt: float, correlation: tuple[float, ...], axes: int) -> tuple[tuple[float, float], ...]:
    """Return the weights of the last value and of the white noise in the next value, per axis [-]."""
    times = correlation if len(correlation) > 1 else correlation * axes
    return tuple((gauss_markov(1.0, 0.0, dt, T), gauss_markov(0.0, 1.0, dt, T)) for T in times)
