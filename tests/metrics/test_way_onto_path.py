"""Acquisition of a path: time and overshoot of artificial tracks."""

import numpy as np
import pytest
from test_metrics import FakeLog

from agrobot_mj.metrics import RunView
from agrobot_mj.metrics.tracking import END_S, HELD_S, Acquisition
from agrobot_mj.paths import Line

T = np.arange(0.0, 20.0, 0.05)


def found(offset, left, t=T):
    """Return the metric for an initial offset of `offset` [m] to the left of a line and offsets `left` at times `t`."""
    line = Line(start_offset_m=offset, ramp_s=0)
    return Acquisition().evaluate(RunView(FakeLog(line, t, x=line.speed_m_s * t, y=left))).get("acquisition")


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_overshoot_is_the_maximum_distance_from_the_line_after_crossing(side):
    y = side * np.select([T < 5.0, T < 7.0], [2.0 - 0.4 * T, -0.3], 0.01)
    way = found(2.0 * side, y)
    assert way["acquired_s"] == pytest.approx(7.0, abs=0.06)
    assert way["overshoot_m"] == pytest.approx(0.3)
    assert way["end_abs_max_m"] == pytest.approx(0.01)


def test_track_that_approaches_from_one_side_has_no_overshoot():
    assert found(2.0, np.maximum(2.0 - 0.2 * T, 0.02))["overshoot_m"] == 0.0


def test_line_is_not_acquired_during_persistent_oscillation():
    way = found(1.0, np.cos(T))
    assert way["acquired_s"] is None
    assert way["end_abs_max_m"] == pytest.approx(abs(np.cos(T[T[-1] - END_S < T])).max())


def test_short_later_excursion_does_not_change_the_acquisition_time():
    away = (T > 12.0) & (T < 12.5)
    assert found(2.0, np.where(away, 0.07, np.maximum(2.0 - 0.4 * T, 0.02)))["acquired_s"] == pytest.approx(
        4.9, abs=0.06
    )


def test_line_reached_too_late_to_be_held_counts_as_not_acquired():
    begins = T[-1] - HELD_S + 0.5
    assert found(2.0, np.where(begins > T, 0.3, 0.0))["acquired_s"] is None
    assert found(2.0, np.where(begins - 1.0 > T, 0.3, 0.0))["acquired_s"] == pytest.approx(begins - 1.0, abs=0.06)


def test_tractor_starting_within_the_tolerance_has_acquired_the_line():
    assert found(0.04, np.full(len(T), 0.04))["acquired_s"] == 0.0


def test_tractor_starting_on_its_path_has_no_acquisition_metrics():
    assert found(0.0, np.zeros(len(T))) is None
