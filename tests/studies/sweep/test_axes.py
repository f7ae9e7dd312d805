"""Values of axes and random parameters: the simulated values equal the values in the sweep file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agrobot_mj.studies.sweep.axes import Choice, Linspace, LogUniform, Normal, Steps, Uniform


def values(axis):
    return [axis.at(k) for k in range(len(axis))]


def test_linspace_axis_includes_both_ends_and_keeps_integers():
    assert values(Linspace(**{"from": 0, "to": 15, "count": 4})) == [0, 5, 10, 15]
    assert all(type(v) is int for v in values(Linspace(**{"from": 0, "to": 15, "count": 4})))
    assert values(Linspace(**{"from": 0.0, "to": 1.0, "count": 3})) == [0.0, 0.5, 1.0]
    assert values(Linspace(**{"from": 7, "to": 9, "count": 1})) == [7]
    assert values(Linspace(**{"from": 1, "to": 8, "count": 3})) == [1, 4.5, 8]


def test_stepped_axis_includes_its_end_despite_rounding():
    assert values(Steps(**{"from": 0, "to": 1, "step": 0.1})) == [0, *(k / 10 for k in range(1, 11))]
    assert values(Steps(**{"from": 5, "to": 0, "step": -2})) == [5, 3, 1]


@given(low=st.floats(-1e6, 1e6), span=st.floats(1e-3, 1e6), count=st.integers(2, 50))
def test_linspace_axis_equals_numpy_linspace(low, span, count):
    found = values(Linspace(**{"from": low, "to": low + span, "count": count}))
    assert found == pytest.approx(np.linspace(low, low + span, count), rel=1e-9, abs=1e-9)


QUANTILES = (np.arange(10_000) + 0.5) / 10_000


@pytest.mark.parametrize(
    ("draw", "mean", "deviation"),
    [
        (Uniform(uniform=(650, 850)), 750, 200 / 12**0.5),
        (Normal(normal=(3.0, 0.5)), 3.0, 0.5),
        # Moments of the logarithmic distribution on (a, b): (b - a) / ln(b/a), and of its square.
        (
            LogUniform(log_uniform=(1, 100)),
            99 / np.log(100),
            (9999 / (2 * np.log(100)) - (99 / np.log(100)) ** 2) ** 0.5,
        ),
        (Choice(choice=(0, 0, 4, 4)), 2.0, 2.0),
    ],
)
def test_sampled_values_have_the_moments_of_their_distribution(draw, mean, deviation):
    found = np.array(draw.values(QUANTILES), dtype=float)
    assert found.mean() == pytest.approx(mean, rel=1e-3)
    assert found.std() == pytest.approx(deviation, rel=5e-3)


def test_truncated_normal_stays_within_limits_without_clustering_there():
    found = np.array(Normal(normal=(0.0, 1.0), within=(-0.5, 2.0)).values(QUANTILES))
    assert found.min() > -0.5
    assert found.max() < 2.0
    assert np.mean(found < -0.45) == pytest.approx(0.05 * 0.357 / 0.669, rel=0.05)  # density over the share inside
