"""Confidence intervals of a success rate, valid for small samples."""

from bisect import bisect_left
from functools import cache
from math import log

import numpy as np

PRIOR_FAILURES = 0.2
"""Second parameter of the beta distribution of alternative rates [-]; the first is 1. Values below 1 put the weight
near a rate of 1. 12 successful runs show a rate of 80 % at 80 % confidence; any sequential test needs at least 11."""
NEAR = 1e-12
"""Minimum distance of an evaluated rate from 0 and 1 [-]."""


def sequential_interval(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Return the two-sided confidence interval of a success rate; it remains valid if runs are added one by one.

    A rate is excluded by a likelihood ratio of at least 2 / (1 - confidence), averaged over the rates beyond it with a
    beta distribution. If the true rate equals an end of the interval, the ratio ever reaches this value with a
    probability of at most (1 - confidence) / 2, for any number of evaluations [Robbins1970].
    """
    failures = runs - successes
    return _lower(successes, failures, confidence), 1.0 - _lower(failures, successes, confidence)


@cache
def _lower(successes: int, failures: int, confidence: float) -> float:
    """Return the lower end of the sequential interval: the rate with just enough evidence for higher rates."""
    from scipy.optimize import brentq

    if successes == 0:
        return 0.0
    bound, observed = log(2.0 / (1.0 - confidence)), successes / (successes + failures)
    highest = min(observed, 1.0 - NEAR)
    return float(brentq(lambda rate: _evidence(successes, failures, rate) - bound, NEAR, highest, xtol=NEAR))


def _evidence(successes: int, failures: int, rate: float) -> float:
    """Return the log likelihood ratio of higher success rates (averaged over these rates) to `rate`."""
    from scipy.special import betaincc, betaln, xlogy

    a, b = successes + 1.0, failures + PRIOR_FAILURES
    higher = betaln(a, b) + np.log(betaincc(a, b, rate))
    prior = betaln(1.0, PRIOR_FAILURES) + np.log(betaincc(1.0, PRIOR_FAILURES, rate))
    return float(higher - prior - xlogy(successes, rate) - xlogy(failures, 1.0 - rate))


def runs_needed(reliability: float, confidence: float) -> int:
    """Return the minimum number of runs, all successful, after which the sequential interval is above `reliability`."""
    bound, most = log(2.0 / (1.0 - confidence)), 1
    while _evidence(most, 0, reliability) < bound:
        most *= 2
    return bisect_left(range(most), bound, lo=1, key=lambda runs: _evidence(runs, 0, reliability))


def wilson_interval(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Return the two-sided confidence interval of a success rate for a fixed number of runs [Wilson1927]."""
    from scipy.stats import binomtest

    low, high = binomtest(successes, runs).proportion_ci(confidence, method="wilson")
    return float(low), float(high)
