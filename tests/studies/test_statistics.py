"""Confidence intervals against SciPy's tests and by hand."""

from math import inf, isnan

import numpy as np
import pytest
from estimates import bootstrap_interval, student_interval
from scipy.stats import ttest_1samp

from agrobot_mj.studies.statistics import runs_needed, sequential_interval, wilson_interval

VALUES = [1.0, 1.3, 0.8, 1.1, 1.6]


def test_student_interval_equals_that_of_the_t_test():
    wanted = ttest_1samp(VALUES, 0.0).confidence_interval(0.9)
    assert student_interval(VALUES, 0.9) == pytest.approx((wanted.low, wanted.high))
    assert student_interval([2.0]) == (-inf, inf)


def test_bootstrap_interval_covers_a_skewed_mean_in_95_percent():
    rng = np.random.default_rng(7)
    found = [bootstrap_interval(rng.exponential(size=60)) for _ in range(120)]
    assert 0.88 < np.mean([low < 1.0 < high for low, high in found]) <= 1.0
    assert bootstrap_interval(VALUES) == bootstrap_interval(VALUES)
    assert bootstrap_interval([2.0]) == (2.0, 2.0)
    assert all(map(isnan, bootstrap_interval([])))


def test_wilson_interval_at_zero_or_full_success_is_one_sided():
    assert wilson_interval(0, 10, 0.95) == pytest.approx((0.0, 3.8415 / 13.8415), abs=1e-4)
    assert wilson_interval(10, 10, 0.95) == pytest.approx((10 / 13.8415, 1.0), abs=1e-4)


@pytest.mark.parametrize(("reliability", "confidence"), [(0.9, 0.95), (0.99, 0.95), (0.8, 0.9), (0.9999, 0.99)])
def test_runs_needed_is_the_minimum_for_the_reliability(reliability, confidence):
    n = runs_needed(reliability, confidence)
    assert sequential_interval(n, n, confidence)[0] >= reliability
    assert sequential_interval(n - 1, n - 1, confidence)[0] < reliability


@pytest.mark.parametrize(("successes", "runs"), [(0, 1), (1, 1), (3, 3), (11, 17), (200, 201), (40_000, 50_000)])
def test_sequential_interval_contains_the_wilson_interval(successes, runs):
    low, high = sequential_interval(successes, runs, 0.8)
    narrow = wilson_interval(successes, runs, 0.8)
    assert 0.0 <= low <= narrow[0] + 1e-9
    assert narrow[1] - 1e-9 <= high <= 1.0
    assert sequential_interval(runs - successes, runs, 0.8) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-9)


@pytest.mark.parametrize(("rate", "confidence"), [(0.5, 0.8), (0.8, 0.8), (0.95, 0.9), (0.3, 0.6)])
def test_sequential_interval_covers_the_rate_at_every_evaluation(rate, confidence):
    """Looked at after each of 70 runs; the fixed interval of Wilson misses the rate at some look far more often."""
    drawn = np.random.default_rng(5).random((250, 70)) < rate
    sums, missed, fixed = np.cumsum(drawn, axis=1), 0, 0
    known = {}
    for row in sums:
        ends = []
        for runs, successes in enumerate(row.tolist(), 1):
            if (successes, runs) not in known:
                of = [f(successes, runs, confidence) for f in (sequential_interval, wilson_interval)]
                known[successes, runs] = of
            ends.append(known[successes, runs])
        missed += any(not low <= rate <= high for (low, high), _ in ends)
        fixed += any(not low <= rate <= high for _, (low, high) in ends)
    assert missed / len(sums) <= 1.0 - confidence
    assert fixed / len(sums) > 1.4 * (1.0 - confidence)
