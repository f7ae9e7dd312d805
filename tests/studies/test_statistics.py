"""Confidence intervals against SciPy's tests and by hand."""

from math import inf, isnan

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from agrobot_mj.studies.statistics import bootstrap_interval, runs_needed, student_interval, wilson_interval

VALUES = [1.0, 1.3, 0.8, 1.1, 1.6]


def test_student_interval_equals_the_t_tests():
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


@pytest.mark.parametrize(("reliability", "confidence"), [(0.9, 0.95), (0.99, 0.95), (0.8, 0.9)])
def test_runs_needed_are_the_fewest_whose_interval_lies_above_the_reliability(reliability, confidence):
    n = runs_needed(reliability, confidence)
    assert wilson_interval(n, n, confidence)[0] >= reliability
    assert wilson_interval(n - 1, n - 1, confidence)[0] < reliability
