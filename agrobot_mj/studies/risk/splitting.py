"""Adaptive multilevel splitting: the probability of what hardly any path of a random process does [Cerou2007].

Each path has a level, the highest score that it reached; a path that failed has an infinite one. In a round the lowest
of n paths die, and each is replaced by a copy of a survivor up to the first moment at which that was above the level of
the dead, from where it goes on by noise of its own. A round in which k paths die leaves (n - k) / n of the weight.

In discrete time, and with scores that repeat, the estimate has no bias, whatever n, the score, or the rule to stop, if
two inequalities are strict [Brehier2016]: all paths at or below the level die, however many they are, and a copy goes
its own way from a score above it, not at it. Where none survives the estimate is 0.
"""

from collections.abc import Generator
from math import inf
from typing import NamedTuple, Protocol, TypeVar

from numpy.random import Generator as Random


class Leveled(Protocol):
    """A path of the process."""

    @property
    def level(self) -> float:
        """Highest score that it reached; infinite if it failed."""
        ...


P = TypeVar("P", bound=Leveled)
Wanted = tuple[P | None, float]
"""A path to be driven: a copy of this one up to its first score above this level, or a new one (None)."""


class Split(NamedTuple):
    """What a splitting found."""

    probability: float
    """Estimate of the probability of failure, without bias [-]."""
    weight: float
    """Product of the shares that survived the rounds; the share of `failed` among the paths is the rest [-]."""
    failed: int
    """Number of paths that failed among those of the end."""
    trace: tuple[tuple[float, float], ...]
    """Level of each round, and the weight behind it: the chance to come above that level [-]."""
    paths: int
    """Number of paths driven, those of the beginning included."""


def split(n: int, worst: int, least: float, random: Random) -> Generator[list[Wanted[P]], list[P], Split]:
    """Split n paths, of which at least `worst` die in a round, until fewer than that have not failed.

    Yields the paths that it wants driven and is sent these, in the same order. It ends, too, where none survives, and
    where the weight is below `least`.
    """
    paths = yield [(None, -inf)] * n
    weight, trace, driven = 1.0, list[tuple[float, float]](), n
    while paths and weight >= least:
        level = sorted(path.level for path in paths)[worst - 1]
        if level == inf:
            break
        alive = [path for path in paths if path.level > level]
        weight *= len(alive) / n
        trace.append((level, weight))
        if alive:
            chosen = random.integers(len(alive), size=n - len(alive))
            alive += yield [(alive[k], level) for k in chosen]
            driven += len(chosen)
        paths = alive
    failed = sum(path.level == inf for path in paths)
    return Split(weight * failed / n, weight, failed, tuple(trace), driven)
