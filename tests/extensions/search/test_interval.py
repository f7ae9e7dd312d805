"""Sequential interval of a success rate: coverage at every evaluation, and number of runs."""

import numpy as np
import pytest

from agrobot_mj.extensions.search.limit.interval import runs_needed, sequential_interval
from agrobot_mj.studies.statistics import wilson_interval


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
def test_sequential_interval_covers_the_success_rate_after_every_run(rate, confidence):
    """A fixed Wilson interval, evaluated after each of 70 runs, misses the rate at some evaluation far more often."""
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
