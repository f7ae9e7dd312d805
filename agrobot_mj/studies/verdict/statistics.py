"""Ratios between runs of the same seed, with intervals that are honest about few seeds."""

from collections.abc import Callable, Iterable
from math import exp, inf, log, nan, sqrt
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from agrobot_mj.studies.verdict.rows import ResultRow

CONFIDENCE = 0.95
Value = Callable[[ResultRow], float]


class MeanWithInterval(NamedTuple):
    """A mean with its interval."""

    mean: float
    low: float
    """Lower end of the 95 % interval."""
    high: float
    """Upper end."""
    n: int
    """Number of seeds."""

    def text(self, digits: int = 2, factor: float = 1.0) -> str:
        """`mean (low-high)`, or the mean alone of a single seed."""
        numbers = [f"{factor * value:.{digits}f}" for value in self[:3]]
        return numbers[0] if self.n < 2 else f"{numbers[0]} ({numbers[1]} to {numbers[2]})"


def estimate(values: Iterable[float]) -> MeanWithInterval:
    """Mean and 95 % interval by Student's distribution; the interval of a single value is infinite."""
    found = np.array([value for value in values if np.isfinite(value)])
    n = len(found)
    if n < 2:
        return MeanWithInterval(float(found[0]) if n else nan, -inf, inf, n)
    half = float(student.ppf((1 + CONFIDENCE) / 2, n - 1)) * float(found.std(ddof=1)) / sqrt(n)
    mean = float(found.mean())
    return MeanWithInterval(mean, mean - half, mean + half, n)


def ratio(
    one: Iterable[ResultRow], other: Iterable[ResultRow], value: Value, below: Value | None = None
) -> MeanWithInterval:
    """Geometric mean of `value` of `one` over `value` (or `below`) of `other`, seed by seed, with its interval.

    Runs that did not complete and seeds that only one side has do not count.
    """
    top, bottom = by_seed(one, value), by_seed(other, below or value)
    logs = [log(top[seed] / bottom[seed]) for seed in sorted(top.keys() & bottom.keys())]
    found = estimate(logs)
    return MeanWithInterval(exp(found.mean), exp(found.low), exp(found.high), found.n) if found.n else found


def by_seed(rows: Iterable[ResultRow], value: Value) -> dict[int, float]:
    """A value of each completed run by its seed."""
    return {row["seed"]: value(row) for row in rows if row["outcome"] == "completed"}
