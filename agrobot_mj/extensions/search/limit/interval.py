"""Sequential confidence interval of a success rate, valid for small samples."""

from bisect import bisect_left
from functools import cache
from math import log

import numpy as np

from agrobot_mj.core.roots import root

PRIOR_FAILURES = 0.2
"""Second parameter of the beta distribution of success rates [-]. The first parameter is 1. Values below 1 favour rates
near 1. With 0.2, 12 successes confirm a rate of 80 % at 80 % confidence. Any sequential test needs at least 11
successes."""
NEAR = 1e-12  # Minimum distance of an evaluated rate from 0 and 1 [-]


def sequential_interval(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Return a two-sided confidence interval of a success rate that remains valid if it is evaluated after every run.

    The test of a rate uses the likelihood of higher (or lower) rates, averaged with a beta distribution, divided by the
    likelihood of the rate. The interval excludes rates with a ratio of at least 2 / (1 - confidence). For the true
    rate, the probability that the ratio ever reaches this value is at most (1 - confidence) / 2 [Robbins1970].
    """
    failures = runs - successes
    return _lower(successes, failures, confidence), 1.0 - _lower(failures, successes, confidence)


@cache
def _lower(successes: int, failures: int, confidence: float) -> float:
    """Return the lower end of the sequential interval: the rate at which the likelihood ratio equals its limit."""
    if successes == 0:
        return 0.0
    bound, observed = log(2.0 / (1.0 - confidence)), successes / (successes + failures)
    highest = min(observed, 1.0 - NEAR)
    return root(lambda rate: _evidence(successes, failures, rate) - bound, NEAR, highest, xtol=NEAR)


def _evidence(successes: int, failures: int, rate: float) -> float:
    """Return the log of a likelihood ratio: mean likelihood of the success rates above `rate`, divided by the
    likelihood of `rate`."""
    from scipy.special import betaincc, betaln, xlogy

    a, b = successes + 1.0, failures + PRIOR_FAILURES
    higher = betaln(a, b) + np.log(betaincc(a, b, rate))
    prior = betaln(1.0, PRIOR_FAILURES) + np.log(betaincc(1.0, PRIOR_FAILURES, rate))
    return float(higher - prior - xlogy(successes, rate) - xlogy(failures, 1.0 - rate))


def runs_needed(reliability: float, confidence: float) -> int:
    """Return the minimum number of runs, all successful, for which the sequential interval of the success rate is above
    `reliability`."""
    bound, most = log(2.0 / (1.0 - confidence)), 1
    while _evidence(most, 0, reliability) < bound:
        most *= 2
    return bisect_left(range(most), bound, lo=1, key=lambda runs: _evidence(runs, 0, reliability))
