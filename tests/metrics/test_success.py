"""Definition of successful runs, metrics that are errors, and reported failures."""

from math import inf, nan

import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.metrics.success import error_of, failures, has_errors, is_error, is_success, reasons, without_errors

NO_ERRORS = {
    "outcome", "stop_reason", "progress", "nn_share", "position_nees", "position_nis", "steer_saturated_fraction",
    "hitch_angle_abs_p95", "hitch_pull_mean", "physics_warnings", "real_time_factor", "wall_s", "identity",
    "level_sideslip", "estimate_warning", "braked_drift_m",
    "antenna_mounting", "interpreted_stages",
}  # fmt: skip
"""Metrics that are also defined for failed runs."""


@pytest.mark.parametrize(
    ("row", "success", "counts"),
    [
        ({"outcome": "completed"}, True, True),
        ({"outcome": "stopped"}, False, False),
        ({"outcome": "completed", "expected": True}, True, True),
        ({"outcome": "completed", "expected": False}, False, False),
        ({"outcome": "stopped", "expected": True}, True, False),
        ({"outcome": "unfinished", "expected": False}, False, False),
    ],
)
def test_only_a_successful_completed_run_has_error_metrics(row, success, counts):
    assert (is_success(row), has_errors(row)) == (success, counts)
    assert error_of({**row, "xte_rms": 0.0}, "xte_rms") == (0.0 if counts else None)
    kept = without_errors({**row, "xte_rms": 0.0, "per_turn": [], "position_nees": 2.0})
    assert (kept["xte_rms"], kept["per_turn"]) == ((0.0, []) if counts else (None, None))
    assert kept["position_nees"] == 2.0


@pytest.mark.parametrize("value", [None, nan, inf])
def test_non_finite_metric_value_is_treated_as_missing(value):
    assert error_of({"outcome": "completed", "xte_rms": value}, "xte_rms") is None
    assert error_of({"outcome": "completed"}, "xte_rms") is None


def test_every_metric_is_classified_as_error_or_other_value():
    log = run(load_scenario("plough", {"duration_s": 1.0}))
    swaths = run(load_scenario("clothoid_swaths", {"plant.kind": "bicycle", "duration_s": 1.0}))
    names = {*log.metrics, *swaths.metrics}
    assert {name for name in names if not is_error(name)} <= NO_ERRORS
    assert {"xte_rms", "lateral_mse", "per_turn", "implement_xte_rms"} <= {name for name in names if is_error(name)}


def test_failed_runs_are_counted_by_reason():
    rows = [{"outcome": "completed"}, {"outcome": "diverged"}]
    rows += [{"outcome": "stopped", "stop_reason": f"no GNSS fix for {k}.0 s"} for k in (8, 9)]
    assert failures(rows) == "3 of 4: 2 stopped (no GNSS fix for 8.0 s), 1 diverged"
    assert failures(rows[:1]) == failures([]) == ""
    many = [{"outcome": outcome} for outcome in ("stuck", "diverged", "stopped", "aborted")]
    assert reasons(many) == "1 stuck, 1 diverged, 1 stopped, ..."
