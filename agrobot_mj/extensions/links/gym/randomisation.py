"""Randomisation of episodes: the noise seed, and scenario keys sampled from ranges."""

from collections.abc import Mapping
from typing import Any

from numpy.random import Generator

from agrobot_mj.core.errors import ScenarioError

Range = tuple[float, float] | list[Any]
"""Pair (low, high) of a uniform distribution, over integers if both are integers, or a list of values."""
SEEDS = 2**31
"""Number of seeds from which episodes are sampled."""


def check(ranges: Mapping[str, Range]) -> None:
    """Raise `ScenarioError` unless every value is a range or a list of values."""
    for key, values in ranges.items():
        if key == "seed":
            raise ScenarioError("randomise: seed: the seed differs in every episode; omit this key")
        pair = isinstance(values, tuple) and len(values) == 2 and all(isinstance(v, int | float) for v in values)
        if not (pair and values[0] <= values[1]) and not (isinstance(values, list) and values):
            raise ScenarioError(
                f"randomise: {key}: must be (low, high) for a range or a list of values to choose from, got {values!r}"
            )


def draw(ranges: Mapping[str, Range], generator: Generator) -> dict[str, Any]:
    """Return sampled overrides for one episode, in the order of the ranges, including the seed."""
    drawn: dict[str, Any] = {"seed": int(generator.integers(SEEDS))}
    for key, values in ranges.items():
        if isinstance(values, list):
            drawn[key] = values[int(generator.integers(len(values)))]
        elif all(isinstance(value, int) for value in values):
            drawn[key] = int(generator.integers(int(values[0]), int(values[1]), endpoint=True))
        else:
            drawn[key] = float(generator.uniform(*values))
    return drawn
