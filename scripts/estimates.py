"""Means over seeds with their intervals, and how many runs failed beside them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import exp, isfinite, log, nan
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.metrics.success import has_errors
from agrobot_mj.studies.statistics import student_interval

Row = Mapping[str, Any]
Value = Callable[[Any], float]
Interval = Callable[[Sequence[float]], tuple[float, float]]


class Estimate(NamedTuple):
    """A mean with its 95 % interval, infinite of a single value."""

    mean: float
    low: float
    high: float
    n: int
    """Number of seeds."""
    failed: int = 0
    """Further seeds whose runs failed: the mean is of those that are left."""

    def text(self, digits: int = 2, factor: float = 1.0, sign: str = "") -> str:
        """`mean (low to high)`, or the mean alone of a single seed, and how many seeds failed."""
        mean, low, high = (f"{factor * value:{sign}.{digits}f}" for value in self[:3])
        return self._marked(f"{mean} ({low} to {high})" if self.n > 1 else mean)

    def short(self, digits: int = 2, factor: float = 1.0) -> str:
        """The mean, and how many seeds failed."""
        return self._marked(f"{factor * self.mean:.{digits}f}")

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


def estimate(values: Iterable[float], interval: Interval = student_interval) -> Estimate:
    """Mean and interval, by default Student's; a value that is not finite is that of a run that failed."""
    every = list(values)
    found = [value for value in every if isfinite(value)]
    return Estimate(float(np.mean(found)) if found else nan, *interval(found), len(found), len(every) - len(found))


def select(rows: Iterable[Any], **wanted: Any) -> list[Any]:
    """Rows with these values."""
    return [row for row in rows if all(row.get(name) == value for name, value in wanted.items())]


def field(name: str) -> Value:
    """The value of a column."""
    return lambda row: float(row[name])


def by_seed(rows: Iterable[Row], value: Value) -> dict[int, float]:
    """A value of each run by its seed, NaN of those that failed (`metrics.success`)."""
    return {row["seed"]: value(row) if has_errors(row) else nan for row in rows}


def mean(rows: Iterable[Row], value: Value, interval: Interval = student_interval) -> Estimate:
    """A value over the seeds."""
    return estimate(by_seed(rows, value).values(), interval)


def difference(one: Mapping[int, float], other: Mapping[int, float], interval: Interval = student_interval) -> Estimate:
    """Mean of `one` less `other`, seed by seed, over the seeds of both."""
    return estimate([one[seed] - other[seed] for seed in sorted(one.keys() & other.keys())], interval)


def ratio(one: Iterable[Row], other: Iterable[Row], value: Value, below: Value | None = None) -> Estimate:
    """Geometric mean of `value` of `one` over `value` (or `below`) of `other`, seed by seed, with its interval.

    Seeds that only one side has do not count; those of which one run or both failed are counted as such.
    """
    top, bottom = by_seed(one, value), by_seed(other, below or value)
    found = estimate([log(top[seed] / bottom[seed]) for seed in sorted(top.keys() & bottom.keys())])
    return found._replace(mean=exp(found.mean), low=exp(found.low), high=exp(found.high)) if found.n else found
