"""Remarks on rankings: dominant estimator errors, and estimates inconsistent with their covariance."""

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agrobot_mj.studies.error_parts import mean_nees, remarks, table_warnings

WARNING = (
    "the estimate contradicts its covariance (position NEES 300, NIS 1.9, both 2 for a consistent filter): antenna lean"
)


def row(estimator=0.2, guidance=0.04, **more):
    parts = {"xte_rms": 0.19, "xte_estimator_rms": estimator, "xte_guidance_rms": guidance}
    return {"outcome": "completed", **parts, "position_nees": 300.0, **more}


def test_ranking_dominated_by_estimator_errors_gets_a_remark():
    lean = {"xte_cause": "antenna lean", "xte_remedy": "enable sensors.imu"}
    cases = {"own": [row(**lean), row(**lean)], "lqr": [row(guidance=0.07, **lean), row(0.05, 0.07)]}
    assert remarks(cases) == [
        "the estimator causes the larger part of the cross-track error in 3 of 4 runs (antenna lean); a ranking by "
        "this error compares estimates, not guidance laws; the median of the guidance part is smallest for own, "
        "4.0 cm; enable sensors.imu"
    ]


@pytest.mark.parametrize(
    "cases",
    [
        {"own": [row(0.03, 0.06)], "lqr": [row(0.03, 0.07)]},  # the guidance is the larger part
        {"own": [row()]},  # nothing is ranked
        {"own": [row(outcome="stopped")], "lqr": [row(outcome="stuck")]},  # no errors
        {"own": [{"outcome": "completed", "xte_rms": 0.1}], "lqr": [{"outcome": "completed"}]},  # of an older version
    ],
    ids=["guidance", "one", "failed", "old"],
)
def test_ranking_dominated_by_guidance_errors_has_no_remark(cases):
    assert remarks(cases) == []


def test_estimator_consistency_warnings_are_counted_over_all_cases():
    cases = {"a": [row(0.01, 0.05, estimate_warning=WARNING), row(0.01, 0.05)], "b": [row(0.01, 0.05)]}
    assert remarks(cases) == [f"in 1 of 3 runs {WARNING}"]
    cases["b"].append(row(0.01, 0.05, estimate_warning="another"))
    assert remarks(cases) == [f"in 2 of 4 runs, the first: {WARNING}"]


def test_nees_column_is_filled_only_if_a_run_has_an_estimator_warning():
    assert mean_nees([row(), row(position_nees=100.0)]) == ""
    assert mean_nees([row(estimate_warning=WARNING), row(position_nees=100.0)]) == pytest.approx(200.0)


def test_estimator_consistency_warnings_of_a_saved_table_are_returned(tmp_path):
    table = tmp_path / "sweep.parquet"
    assert table_warnings(table) == []
    pq.write_table(pa.table({"seed": [1, 2]}), table)
    assert table_warnings(table) == []
    pq.write_table(pa.table({"estimate_warning": [None, WARNING]}), table)
    assert table_warnings(table) == [f"in 1 of 2 runs {WARNING}"]
