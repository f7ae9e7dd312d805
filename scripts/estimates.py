"""Means over seeds with their intervals, and how many runs failed beside them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import exp, isfinite, log, nan
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import has_errors
from agrobot_mj.studies.statistics import student_interval

Row = Mapping[str, Any]
Value = Callable[[Any], float]
BySeed = Mapping[int, float]
"""A value by seed, NaN of runs that failed."""
Columns = Mapping[str, Mapping[str, BySeed]]
"""Values by column of a table, law and seed."""


class Estimate(NamedTuple):
    """A mean with its 95 % interval, infinite of a single value."""

    mean: float
    low: float
    high: float
    n: int  # number of seeds
    failed: int = 0  # further seeds whose runs failed: the mean is of those that are left

    def text(self, digits: int = 2, sign: str = "") -> str:
        """`mean (low to high)`, or the mean alone of a single seed, and how many seeds failed."""
        mean, low, high = (f"{value:{sign}.{digits}f}" for value in self[:3])
        return self._marked(f"{mean} ({low} to {high})" if self.n > 1 else mean)

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


def estimate(
    values: Iterable[float], interval: Callable[[Sequence[float]], tuple[float, float]] = student_interval
) -> Estimate:
    """Mean and interval, by default Student's; a value that is not finite is that of a run that failed."""
    every = list(values)
    found = [value for value in every if isfinite(value)]
    return Estimate(float(np.mean(found)) if found else nan, *interval(found), len(found), len(every) - len(found))


def select(rows: Iterable[Any], **wanted: Any) -> list[Any]:
    """Rows with these values."""
    return [row for row in rows if all(row.get(name) == value for name, value in wanted.items())]


def field(name: str, factor: float = 1.0) -> Value:
    """The value of a column, in another unit by a factor."""
    return lambda row: factor * float(row[name])


def by_seed(rows: Iterable[Row], value: Value) -> dict[int, float]:
    """A value of each run by its seed, NaN of those that failed (`metrics.success`)."""
    return {row["seed"]: value(row) if has_errors(row) else nan for row in rows}


def by_law(rows: Iterable[Row], value: Value) -> dict[str, dict[int, float]]:
    """A value of each run by its variant and seed."""
    every = list(rows)
    return {law: by_seed(select(every, variant=law), value) for law in dict.fromkeys(row["variant"] for row in every)}


def mean(rows: Iterable[Row], value: Value) -> Estimate:
    """A value over the seeds."""
    return estimate(by_seed(rows, value).values())


def difference(one: BySeed, other: BySeed) -> Estimate:
    """Mean of `one` less `other`, seed by seed, over the seeds of both."""
    return estimate([one[seed] - other[seed] for seed in sorted(one.keys() & other.keys())])


def ratio(one: BySeed, other: BySeed) -> Estimate:
    """Geometric mean of `one` over `other` with its interval, seed by seed, over the seeds of both."""
    found = estimate([log(one[seed] / other[seed]) for seed in sorted(one.keys() & other.keys())])
    return found._replace(mean=exp(found.mean), low=exp(found.low), high=exp(found.high)) if found.n else found


def compared_tables(columns: Columns, pairs: Iterable[tuple[str, str]], digits: int = 1) -> str:
    """Markdown tables: mean of each law in each column, and paired differences of some laws, both with intervals."""
    laws = dict.fromkeys(law for found in columns.values() for law in found)
    means = [(law, *(estimate(found.get(law, {}).values()).text(digits) for found in columns.values())) for law in laws]
    differences = [
        (f"{a} less {b}", *(difference(f.get(a, {}), f.get(b, {})).text(digits, "+") for f in columns.values()))
        for a, b in pairs
        if a in laws and b in laws
    ]
    tables = [markdown_table(("law", *columns), means, 1)]
    tables += [markdown_table(("paired difference", *columns), differences, 1)] if differences else []
    return "\n\n".join(tables)
