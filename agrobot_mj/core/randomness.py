"""Independent random streams, identified by name and generated from one seed.

A stream depends only on the seed and its name: adding, removing or reordering sensors changes no other stream. The same
seed gives the same numbers in every process, unlike Python's salted `hash`.
"""

import ctypes
import io
import pickle
from collections.abc import Iterable
from functools import lru_cache
from hashlib import blake2b
from math import exp, sqrt
from typing import Any, NamedTuple, cast

import llvmlite.binding as llvm
from numba import config, types
from numpy.random import Generator, SeedSequence, _generator, default_rng

from agrobot_mj.core.kernels import shared

LIBRARY = str(_generator.__file__)
"""Path of the compiled numpy module that exports functions for sampling random distributions."""
if config.DISABLE_JIT:
    normal: Any = ctypes.CDLL(LIBRARY).random_standard_normal
    normal.restype, normal.argtypes = ctypes.c_double, [ctypes.c_void_p]
else:
    llvm.load_library_permanently(LIBRARY)
    normal = types.ExternalFunction("random_standard_normal", types.float64(types.intp))
"""Return a standard normal sample from the generator at a memory `address`, and advance the generator."""


def address(generator: Generator) -> int:
    """Return the memory address of a random generator. The address is valid as long as the generator exists."""
    return int(ctypes.cast(generator.bit_generator.ctypes.bit_generator, ctypes.c_void_p).value or 0)


def addresses(generators: Iterable[Generator]) -> Any:
    """Return the memory addresses of random generators as a tuple."""
    return tuple(map(address, generators))


def stream(seed: int, name: str) -> Generator:
    """Return the random stream `name` of a run with this `seed`. Raises ValueError for a negative seed."""
    key = int.from_bytes(blake2b(name.encode(), digest_size=16).digest(), "little")
    return default_rng(SeedSequence(seed, spawn_key=(key,)))


def generators(state: Any) -> list[Generator]:
    """Return all random generators contained in a picklable state, at any depth, without duplicates."""
    finder = _Finder(io.BytesIO())
    finder.dump(state)
    return finder.found


class _Finder(pickle.Pickler):
    """Pickler that collects random generators instead of writing them."""

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
    """Switch a generator in place to a random stream that depends only on seed, stream name and branch `number`."""
    bits = generator.bit_generator
    seed = cast(SeedSequence, bits.seed_seq)
    bits.state = type(bits)(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, _BRANCH, number))).state


_BRANCH = int.from_bytes(blake2b(b"branch", digest_size=4).digest(), "little")
"""Element of the spawn keys of branches. The number differs from the child numbers used by `SeedSequence.spawn`."""


def gauss_markov(value: float, white: float, dt: float, correlation: float) -> float:
    """Return the next value of a first-order Gauss-Markov process [Brown2012] of unit variance.

    `white` is a standard normal sample. The autocorrelation decreases to 37 % in the time `correlation`, which has the
    unit of `dt`.
    """
    kept = exp(-dt / correlation)
    return kept * value + sqrt(1.0 - kept * kept) * white


class GaussMarkov(NamedTuple):
    """State of a first-order Gauss-Markov process of unit variance, with one or more axes."""

    generator: Generator  # Random stream, advanced in place
    value: Any  # Tuple with one value per axis, divided by the standard deviation of the process [-]

    @classmethod
    def stationary(cls, generator: Generator, axes: int = 1) -> "GaussMarkov":
        """Return a process with `axes` initial values sampled from the stationary distribution."""
        return cls(generator, tuple(generator.standard_normal(axes).tolist()))

    def after(self, dt: float, correlation: float) -> "GaussMarkov":
        """Return the process after a step of `dt`. The correlation time `correlation` has the same unit as `dt`."""
        white, (kept, new) = self.generator.standard_normal(len(self.value)).tolist(), shares(dt, correlation)
        return GaussMarkov(self.generator, tuple([kept * v + new * w for v, w in zip(self.value, white, strict=True)]))


Shares = tuple[float, float]
"""Weights of the last value and of the white noise in the next value of a Gauss-Markov process [-]."""


@lru_cache(maxsize=256)
def shares(dt: float, correlation: float) -> Shares:
    """Return the `Shares` of a Gauss-Markov process for a step of `dt` and a `correlation` time in the same unit."""
    return gauss_markov(1.0, 0.0, dt, correlation), gauss_markov(0.0, 1.0, dt, correlation)


@shared
def gauss_markov_step(value: float, weights: Shares, generator: int) -> float:
    """Return the next value of a Gauss-Markov process; `generator` is the memory address of the random generator."""
    white: float = normal(generator)
    return weights[0] * value + weights[1] * white


@shared
def wandered_plane(value: tuple[float, float], weights: Shares, generator: int) -> tuple[float, float]:
    """Return the next two values of a Gauss-Markov process with two axes; `generator` is a memory address."""
    first = gauss_markov_step(value[0], weights, generator)
    return first, gauss_markov_step(value[1], weights, generator)
