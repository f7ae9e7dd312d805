"""Lag behind the reference or speed deficit, reported at the end of a run."""

from types import SimpleNamespace

import numpy as np
import pytest

from agrobot_mj.metrics.lag import lag_of


def log(speed, reference, seconds=40.0, behind=None):
    """Return a run along a line at given speeds of tractor and reference [m/s]."""
    t = np.arange(0.0, seconds, 0.05)
    columns = {
        "t": t,
        "x_ref": reference * t * 0.6,
        "y_ref": reference * t * 0.8,
        "speed": np.full_like(t, speed),
        "e_longitudinal": (reference - speed) * t if behind is None else np.full_like(t, behind),
    }
    return SimpleNamespace(column=columns.__getitem__)


def test_lag_of_a_slow_tractor_is_its_speed_deficit_times_the_duration():
    lag = lag_of(log(speed=1.5, reference=2.0))
    assert lag.behind_m == pytest.approx(0.5 * 39.95)
    assert (lag.speed_m_s, lag.reference_m_s) == pytest.approx((1.5, 2.0))
    assert lag.text == "20.0 m behind its reference, at 1.50 of 2.00 m/s"


@pytest.mark.parametrize(
    ("behind", "text"), [(0.4, ""), (-3.0, "3.0 m ahead of its reference"), (17.04, "17.0 m behind its reference")]
)
def test_lag_or_lead_of_the_tractor_is_reported_only_if_significant(behind, text):
    assert lag_of(log(speed=2.0, reference=2.0, behind=behind)).text == text


def test_lag_metric_is_none_without_two_log_rows_of_finite_values():
    assert lag_of(log(1.0, 1.0, seconds=0.05)) is None
    assert lag_of(log(1.0, 1.0, seconds=0.0)) is None
    assert lag_of(log(1.0, 1.0, behind=np.nan)) is None
