"""Ratios between runs of the same seed, with intervals that are honest about few seeds."""

from collections.abc import Callable, Iterable
from math import exp, inf, log, nan, sqrt
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from agrobot_mj.metrics.success import has_errors
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
    failed: int = 0
    """Further seeds whose runs failed: the mean is of those that are left."""

    def text(self, digits: int = 2, factor: float = 1.0) -> str:
        """`mean (low-high)`, or the mean alone of a single seed, and how many seeds failed."""
        low, high = (f"{factor * value:.{digits}f}" for value in (self.low, self.high))
        interval = f" ({low} to {high})" if self.n > 1 else ""
        return self._marked(f"{factor * self.mean:.{digits}f}{interval}")

    def short(self, digits: int = 2) -> str:
        """The mean, and how many seeds failed."""
        return self._marked(f"{self.mean:.{digits}f}")

    def below(self, limit: float) -> bool:
        """Whether the interval lies below a limit, of seeds none of which failed."""
        return not self.failed and self.high < limit

    def above(self, limit: float) -> bool:
        """Whether the interval lies above a limit, of seeds none of which failed."""
        return not self.failed and self.low > limit

    def _marked(self, text: str) -> str:
        if not self.n:
            return "failed" if self.failed else "-"
        return f"{text}, {self.failed} of {self.n + self.failed} failed" if self.failed else text


def estimate(values: Iterable[float]) -> MeanWithInterval:
    """Mean and 95 % interval by Student's distribution; the interval of a single value is infinite.

    A value that is not finite is that of a run that failed.
    """
    every = np.array(list(values), dtype=float)
    found = every[np.isfinite(every)]
    n, failed = len(found), len(every) - len(found)
    if n < 2:
        return MeanWithInterval(float(found[0]) if n else nan, -inf, inf, n, failed)
    half = float(student.ppf((1 + CONFIDENCE) / 2, n - 1)) * float(found.std(ddof=1)) / sqrt(n)
    mean = float(found.mean())
    return MeanWithInterval(mean, mean - half, mean + half, n, failed)


def ratio(
    one: Iterable[ResultRow], other: Iterable[ResultRow], value: Value, below: Value | None = None
) -> MeanWithInterval:
    """Geometric mean of `value` of `one` over `value` (or `below`) of `other`, seed by seed, with its interval.

    Seeds that only one side has do not count; those of which one run or both failed are counted as such.
    """
    top, bottom = by_seed(one, value), by_seed(other, below or value)
    logs = [log(top[seed] / bottom[seed]) for seed in sorted(top.keys() & bottom.keys())]
    found = estimate(logs)
    return found._replace(mean=exp(found.mean), low=exp(found.low), high=exp(found.high)) if found.n else found


def by_seed(rows: Iterable[ResultRow], value: Value) -> dict[int, float]:
    """A value of each run by its seed, NaN of those that failed (`metrics.success`)."""
    return {row["seed"]: value(row) if has_errors(row) else nan for row in rows}
