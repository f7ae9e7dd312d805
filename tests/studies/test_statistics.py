"""Confidence intervals compared with SciPy's tests and with values computed by hand."""

from math import inf, isnan

import numpy as np
import pytest
from estimates import bootstrap_interval, student_interval
from scipy.stats import ttest_1samp

from agrobot_mj.studies.statistics import wilson_interval

VALUES = [1.0, 1.3, 0.8, 1.1, 1.6]


def test_student_interval_equals_the_interval_of_the_t_test():
    wanted = ttest_1samp(VALUES, 0.0).confidence_interval(0.9)
    assert student_interval(VALUES, 0.9) == pytest.approx((wanted.low, wanted.high))
    assert student_interval([2.0]) == (-inf, inf)


def test_bootstrap_interval_of_a_skewed_mean_has_95_percent_coverage():
    rng = np.random.default_rng(7)
    found = [bootstrap_interval(rng.exponential(size=60)) for _ in range(120)]
    assert 0.88 < np.mean([low < 1.0 < high for low, high in found]) <= 1.0
    assert bootstrap_interval(VALUES) == bootstrap_interval(VALUES)
    assert bootstrap_interval([2.0]) == (2.0, 2.0)
    assert all(map(isnan, bootstrap_interval([])))


def test_wilson_interval_of_zero_or_all_successes_is_one_sided():
    assert wilson_interval(0, 10, 0.95) == pytest.approx((0.0, 3.8415 / 13.8415), abs=1e-4)
    assert wilson_interval(10, 10, 0.95) == pytest.approx((10 / 13.8415, 1.0), abs=1e-4)
