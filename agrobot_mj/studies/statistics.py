"""Confidence intervals of what few runs show: of a success rate, and of a mean."""

from collections.abc import Sequence
from math import ceil, inf, nan
from statistics import NormalDist

import numpy as np


def runs_needed(reliability: float, confidence: float) -> int:
    """Least number of runs without a failure that demonstrates a reliability: from n / (n + z^2) >= R."""
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    return ceil(z**2 * reliability / (1.0 - reliability) - 1e-9)


def wilson_interval(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Two-sided interval of a success rate from its number of successes [Wilson1927]."""
    from scipy.stats import binomtest

    low, high = binomtest(successes, runs).proportion_ci(confidence, method="wilson")
    return float(low), float(high)


def student_interval(values: Sequence[float], confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of the mean of normal values, infinite for fewer than two."""
    from scipy.stats import t

    n = len(values)
    if n < 2:
        return -inf, inf
    mean, half = np.mean(values), t.ppf((1.0 + confidence) / 2.0, n - 1) * np.std(values, ddof=1) / np.sqrt(n)
    return float(mean - half), float(mean + half)


def bootstrap_interval(values: Sequence[float]) -> tuple[float, float]:
    """Two-sided 95 % interval of the mean by bootstrap, the same for the same values.

    Of one value that value, NaN for none.
    """
    from scipy.stats import bootstrap

    if len(values) < 2:
        return (float(values[0]),) * 2 if len(values) else (nan, nan)
    found = bootstrap((values,), np.mean, n_resamples=4000, method="percentile", rng=0).confidence_interval
    return float(found.low), float(found.high)
