from math import ceil, floor, log10

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rerun.blueprint import Corner2D

from agrobot_mj.recording.blueprint import align_plots
from agrobot_mj.recording.plots.axes import (
    BESIDE_PIXELS,
    EDGE,
    Frame,
    Range,
    frame,
    free_corner,
    legend_size,
    most_steps,
    pixels,
    readable,
    time_end,
    value_range,
)
from agrobot_mj.recording.plots.catalogue import Plot, Series


def numbers(low, high, most_steps):
    """Return the number of multiples of a power of ten on an axis, with at most `most_steps` steps."""
    step = 10.0 ** ceil(log10((high - low) / most_steps) - 1e-9)
    return floor(high / step + 1e-9) - ceil(low / step - 1e-9) + 1


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e4), st.sampled_from([10.5, 14.0, 42.0]))
def test_every_axis_shows_at_least_two_tick_labels_and_all_values(low, span, most_steps):
    a, b = readable(low, low + span, most_steps)
    assert a < low
    assert b > low + span
    assert b - a < 21 * span
    assert numbers(a, b, most_steps) >= 2


def test_axis_range_with_tick_labels_only_at_its_ends_is_extended():
    np.testing.assert_allclose(readable(-0.45, 0.5, 10.5), (-0.488, 0.538))
    np.testing.assert_allclose(readable(-8.0, 8.0, 10.5), (-10.8, 10.8))


@pytest.mark.parametrize("span", [1.01, 1.2, 1.3, 1.9, 3.0, 9.2])
def test_plot_of_the_required_height_shows_three_tick_labels(span):
    """Three plots next to the scene share the height with the states."""
    values = Range(-0.3 * span, 0.7 * span)
    share = pixels(values) / 750
    assert share <= 0.46, "two of them and the states have room"
    low, high = readable(*values[:2], most_steps(share))
    assert numbers(low, high, most_steps(share)) >= 3
    assert high - low < 1.8 * span


def test_rare_outliers_are_clipped_only_on_plots_that_permit_clipping():
    values = np.r_[np.full(95, 50.0), np.full(4, 5000.0), 20.0, np.nan]
    assert value_range(values) == (20.0, 5000.0, None)
    assert value_range(values, may_be_cut=True) == (20.0, 75.0, 5000.0)
    assert value_range(np.linspace(0, 2, 50), may_be_cut=True) == (0.0, 2.0, None)


def test_axis_includes_required_values_and_ignores_constant_series():
    assert value_range(np.full(5, 2.0), includes=(0.0, 2.0)) == (0.0, 2.0, None)
    assert value_range(np.full(5, 2.0)) is None
    assert value_range(np.full(5, np.nan), includes=(0.0, 1.0)) is None


@pytest.mark.parametrize("run_s", [1.0, 14.3, 60.0, 85.0, 120.0, 240.0, 253.05, 1950.0, 3600.0])
def test_time_axis_covers_the_whole_run_without_clipped_labels(run_s):
    end = time_end(run_s)
    step = 10.0 if end < 120 else 60.0 if end < 600 else 600.0
    assert run_s < end < 1.08 * run_s
    assert end < step or end % step > 0.99 * EDGE * end


def test_legend_is_in_the_corner_where_it_covers_least():
    along, values = np.linspace(0.0, 1.0, 200), Range(-1.0, 1.0)
    rising = np.column_stack([2 * along - 1])
    assert free_corner(along, rising, values, (0.2, 0.3))[0] is Corner2D.LeftTop
    assert free_corner(along, -rising, values, (0.2, 0.3))[0] is Corner2D.RightTop
    both = np.column_stack([2 * along - 1, np.full(200, 0.9)])
    assert free_corner(along, both, values, (0.2, 0.3))[0] is Corner2D.RightBottom
    assert free_corner(along, np.full((200, 1), np.nan), values, (0.2, 0.3))[0] is Corner2D.RightTop


def test_axis_range_leaves_space_for_a_legend_that_would_cover_curves():
    t = np.linspace(0.0, 100.0, 200)
    both = np.column_stack([np.sin(t), np.cos(t)])
    plot = Plot("own", "Own", "m", (Series("total", "a", 0), Series("PD tau_c", "b", 0)))
    beside, tab = (frame(t, both, plot, each) for each in (True, False))
    assert beside.room == pytest.approx(legend_size(plot.names, BESIDE_PIXELS)[0])
    assert beside.values == value_range(both)
    assert tab.room == 0.0  # its time axis ends with the run, as those of the other plots of the tab
    assert tab.legend is Corner2D.RightTop
    assert (tab.values.low, tab.values.high) == (value_range(both).low, pytest.approx(-1.0 + 2.0 / 0.75, abs=0.01))


def test_stacked_plots_share_one_time_axis():
    """The axis leaves space for the largest legend of the plots."""
    plot = Plot("own", "Own", "m", ())
    low, roomy = Frame(legend=Corner2D.LeftBottom), Frame(room=0.2)
    assert align_plots([(plot, low), (plot, low)]) == [(plot, low)] * 2
    assert align_plots([(plot, low), (plot, roomy)]) == [(plot, roomy)] * 2
