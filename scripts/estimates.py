"""Statistics over seeds: means with confidence intervals, and numbers of failed runs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import exp, inf, isfinite, log, nan
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import bootstrap, t

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import has_errors

Row = Mapping[str, Any]
Value = Callable[[Any], float]
BySeed = Mapping[int, float]  # Value by seed, or NaN for a failed run
Columns = Mapping[str, Mapping[str, BySeed]]  # Table values: column, to law, to seed, to value


class Estimate(NamedTuple):
    """Mean over seeds with a 95 % confidence interval, which is infinite for a single value."""

    mean: float
    low: float
    high: float
    n: int  # Number of seeds
    failed: int = 0  # Number of seeds whose runs failed. The mean excludes these seeds.

    def text(self, digits: int = 2, sign: str = "") -> str:
        """Return the text `mean (low to high)` with the number of failed seeds. A single seed has no interval."""
        mean, low, high = (f"{value:{sign}.{digits}f}" for value in self[:3])
        return self._marked(f"{mean} ({low} to {high})" if self.n > 1 else mean)

    def short(self, digits: int = 2) -> str:
        return self._marked(f"{self.mean:.{digits}f}")

    def below(self, limit: float) -> bool:
        return not self.failed and self.high < limit

    def above(self, limit: float) -> bool:
        return not self.failed and self.low > limit

    def _marked(self, text: str) -> str:
        if not self.n:
            return "failed" if self.failed else "-"
        return f"{text}, {self.failed} of {self.n + self.failed} failed" if self.failed else text


def student_interval(values: Sequence[float], confidence: float = 0.95) -> tuple[float, float]:
    """Return the two-sided confidence interval of the mean of normally distributed values.

    The interval is infinite for fewer than two values.
    """
    n = len(values)
    if n < 2:
        return -inf, inf
    mean, half = np.mean(values), t.ppf((1.0 + confidence) / 2.0, n - 1) * np.std(values, ddof=1) / np.sqrt(n)
    return float(mean - half), float(mean + half)


def bootstrap_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the two-sided 95 % bootstrap interval of the mean of the values. The resampling has a fixed seed."""
    if len(values) < 2:
        return (float(values[0]),) * 2 if len(values) else (nan, nan)
    found = bootstrap((values,), np.mean, n_resamples=4000, method="percentile", rng=0).confidence_interval
    return float(found.low), float(found.high)


def estimate(
    values: Iterable[float], interval: Callable[[Sequence[float]], tuple[float, float]] = student_interval
) -> Estimate:
    """Return the mean of the finite values with its interval (default: Student's t). Other values count as failed
    runs."""
    every = list(values)
    found = [value for value in every if isfinite(value)]
    return Estimate(float(np.mean(found)) if found else nan, *interval(found), len(found), len(every) - len(found))


def select(rows: Iterable[Any], **wanted: Any) -> list[Any]:
    return [row for row in rows if all(row.get(name) == value for name, value in wanted.items())]


def field(name: str, factor: float = 1.0) -> Value:
    """Return a function that reads the column `name` of a row and multiplies the value by `factor`."""
    return lambda row: factor * float(row[name])


def by_seed(rows: Iterable[Row], value: Value) -> dict[int, float]:
    """Return the value of each row by seed. Failed runs (`metrics.success`) have the value NaN."""
    return {row["seed"]: value(row) if has_errors(row) else nan for row in rows}


def by_law(rows: Iterable[Row], value: Value) -> dict[str, dict[int, float]]:
    """Return the value of each row by law (sweep variant) and by seed."""
    every = list(rows)
    return {law: by_seed(select(every, variant=law), value) for law in dict.fromkeys(row["variant"] for row in every)}


def mean(rows: Iterable[Row], value: Value) -> Estimate:
    return estimate(by_seed(rows, value).values())


def difference(one: BySeed, other: BySeed) -> Estimate:
    """Return the mean and interval of the paired differences `one` - `other` over common seeds."""
    return estimate([one[seed] - other[seed] for seed in sorted(one.keys() & other.keys())])


def ratio(one: BySeed, other: BySeed) -> Estimate:
    """Return the geometric mean and interval of the paired ratios `one` / `other` over common seeds."""
    found = estimate([log(one[seed] / other[seed]) for seed in sorted(one.keys() & other.keys())])
    return found._replace(mean=exp(found.mean), low=exp(found.low), high=exp(found.high)) if found.n else found


def compared_tables(columns: Columns, pairs: Iterable[tuple[str, str]], digits: int = 1) -> str:
    """Return two Markdown tables with intervals: means by law and column, and paired differences between laws."""
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
