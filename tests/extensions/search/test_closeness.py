"""Margin of a run to a failure condition: equal to the final metric at the end, and independent of later ticks."""

from dataclasses import replace

import numpy as np
import pytest
from processes import program

from agrobot_mj import load_scenario
from agrobot_mj.extensions.search.closeness import Closeness, Rises
from agrobot_mj.simulation.log import Rows
from agrobot_mj.simulation.run import run


@pytest.fixture(scope="module")
def log():
    return run(load_scenario("straight_line", {"plant.kind": "bicycle", "duration_s": 4.0, "guidance.kind": "lqr"}))


@pytest.mark.parametrize("name", ["xte_abs_max", "xte_rms", "lateral_mse", "longitudinal_rms"])
def test_maximum_failure_margin_equals_the_margin_of_the_final_metric(log, name):
    close = Closeness(f"{name} > 0.02")(log)
    assert close.shape == (80,)
    assert close.max() == pytest.approx(log.metrics[name] / 0.02 - 1)


def test_failure_margin_of_a_percentile_covers_the_complete_run(log):
    close = Closeness("xte_abs_p95 > 0.02")(log)
    largest = np.sort(np.abs(_offset(log)))[::-1]
    assert close[-1] == pytest.approx(largest[4] / 0.02 - 1)  # of 80, the value with 5 % beside or above it
    assert largest[5] <= log.metrics["xte_abs_p95"] <= largest[3]
    assert (np.diff(close) >= 0).all()


def test_margin_is_computed_without_importing_matplotlib(tmp_path):
    """Workers of a search compute margins; the import takes about 0.3 s."""
    done = program(tmp_path, "import sys, agrobot_mj.extensions.search.closeness; print('matplotlib' in sys.modules)")
    assert done.stdout.strip() == "False"


def _offset(log):
    from agrobot_mj.metrics import RunView

    return RunView(log).cg_on_path.offset


@pytest.mark.parametrize(
    "until",
    ["xte_abs_max > 0.02", "xte_rms > 0.1 or lateral_abs_p95 > 0.1", "outcome != completed", "outcome == rolled_over"],
)
def test_failure_margin_at_a_tick_uses_no_later_data(log, until):
    whole = Closeness(until)(log)
    for ticks in (1, 30, 79):
        rows = Rows(log.rows.ticks, 0, log.rows.poses.shape[1])
        rows.table, rows.columns, rows._values, rows.filled = log.rows.table, log.rows.columns, log.rows._values, ticks
        part = replace(log, rows=rows, outcome="aborted", view=None)  # a run under way
        assert Closeness(until)(part) == pytest.approx(whole[:ticks], abs=0)


def test_failure_margin_does_not_anticipate_an_early_end_of_the_run():
    """With twice the duration, the margin is half as large until the tractor has reached the end of the path."""
    keys = {"plant.kind": "bicycle", "guidance.kind": "lqr"}
    logs = [run(load_scenario("lane_change", {**keys, "duration_s": seconds})) for seconds in (60.0, 120.0)]
    ticks = logs[0].rows.filled
    assert ticks == logs[1].rows.filled < logs[0].scenario.ticks
    early, later = (Closeness("lateral_mse > 0.02")(log) + 1 for log in logs)
    assert later[:-1] == pytest.approx(early[:-1] / 2)
    assert early[-1] == later[-1] == pytest.approx(logs[0].metrics["lateral_mse"] / 0.02)
    for log in logs:
        close = Closeness("xte_abs_p95 > 0.02")(log)
        largest = np.sort(np.abs(_offset(log)))
        assert close[-1] == pytest.approx(largest[int(0.95 * (ticks - 1))] / 0.02 - 1)


def test_margin_of_a_combined_condition_follows_from_its_parts(log):
    a, b = (Closeness(f"{name} > {c}")(log) for name, c in (("xte_abs_max", 0.02), ("lateral_rms", 0.5)))
    assert Closeness("xte_abs_max > 0.02 or lateral_rms > 0.5")(log) == pytest.approx(np.maximum(a, b))
    assert Closeness("xte_abs_max > 0.02 and lateral_rms > 0.5")(log) == pytest.approx(np.minimum(a, b))
    assert Closeness("not xte_abs_max > 0.02")(log) == pytest.approx(-a)
    assert Closeness("xte_abs_max < 0.02")(log) == pytest.approx(-a)
    assert Closeness("0.02 < xte_abs_max")(log) == pytest.approx(a)
    assert Closeness("0.01 < xte_abs_max < 0.02")(log) == pytest.approx(np.minimum(2 * a + 1, -a))
    assert Closeness("xte_abs_max == 0.02")(log) == pytest.approx(-np.abs(a))
    assert Closeness("xte_abs_max != 0.02")(log) == pytest.approx(np.abs(a))
    assert Closeness("xte_abs_max > 0")(log) == pytest.approx(0.02 * (a + 1)), "without a size to compare with"


def test_closeness_by_a_score_signal_is_the_signal_magnitude(log):
    assert Closeness("xte_rms > 1", "yaw_rate")(log) == pytest.approx(np.abs(log.column("yaw_rate")))


def test_failure_level_increases_when_the_run_comes_closer_to_failure(log):
    found, close = Rises(Closeness("xte_abs_max > 0.02"))(log), Closeness("xte_abs_max > 0.02")(log)
    assert found["ticks"] == 80
    ticks, levels = zip(*found["rises"], strict=True)
    assert levels == tuple(sorted(set(levels)))
    assert [close[k - 1] for k in ticks] == list(levels)
    for tick, level in found["rises"]:
        assert (close[: tick - 1] < level).all()
    assert levels[-1] == close.max()


def test_increasing_failure_margin_is_extrapolated(log):
    """The extrapolation uses the slope over a quarter of a second; a decreasing margin is not extrapolated."""
    close = Closeness("xte_abs_max > 0.02")(log)
    ahead = np.array([c + max(c - close[max(k - 5, 0)], 0.0) * 0.5 / 0.25 for k, c in enumerate(close)])
    found = Rises(Closeness("xte_abs_max > 0.02"), 0.5)(log)["rises"]
    highest = np.maximum.accumulate(ahead)
    assert [level for _, level in found] == pytest.approx(sorted(set(highest)))
    assert [ahead[k - 1] for k, _ in found] == pytest.approx([level for _, level in found])


def test_failure_margin_is_near_zero_just_before_a_rollover():
    log = run(load_scenario("rollover", {"plant.settle_s": 0.5}))
    close = Closeness("outcome == rolled_over")(log)
    assert log.outcome == "rolled_over"
    assert close[20] < -0.4
    assert close[-1] > -0.1
