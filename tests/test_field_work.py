"""Closed loop on a field: the tractor completes its work and, after acquisition, is as accurate as the receiver."""

from typing import Any

import numpy as np
import pytest

from agrobot_mj import run
from agrobot_mj.scenario.schema import resolve
from agrobot_mj.simulation.log import Log


def worked(controller: str, **path: Any) -> Log:
    """Return the log of a run on a field, with the path keys `path`."""
    return run(resolve({"controller": {"kind": controller}, "path": {"kind": "swaths", **path}}, "field"))


def assert_worked(log: Log, count: int, p95: float) -> None:
    found = log.metrics["iso_12188_2_style"]
    assert log.outcome == "completed"
    assert log.metrics["physics_warnings"] == 0
    assert [one["complete"] for one in found["per_pass"]] == [True] * count
    assert 0.005 < found["pass_to_pass_p95_m"] < p95
    assert 0.002 < found["pass_xte_abs_p95_m"] < p95
    assert abs(found["pass_to_pass_mean_m"]) < 0.03
    assert np.abs(log.column("e_longitudinal")).max() < 4, "the reference does not run away"


@pytest.mark.parametrize(("controller", "turn", "p95"), [("pd", "u", 0.08), ("pd_t2fnn", "omega", 0.2)])
def test_run_on_a_small_field_completes(controller: str, turn: str, p95: float) -> None:
    assert_worked(worked(controller, turn=turn, count=3, swath_m=6.0 if turn == "u" else 2.0, length_m=70.0), 3, p95)


@pytest.mark.slow
@pytest.mark.parametrize(("controller", "p95"), [("pd", 0.06), ("pd_t2fnn", 0.12)])
@pytest.mark.parametrize("turn", ["omega", "u"])
def test_run_on_a_field_of_one_hectare_completes(controller: str, p95: float, turn: str) -> None:
    assert_worked(worked(controller, turn=turn, count=50), 50, p95)


def test_only_runs_on_field_paths_have_a_pass_to_pass_error() -> None:
    log = run(resolve({"duration_s": 2.0, "path": {"kind": "sinusoid"}}, "waves"))
    assert "iso_12188_2_style" not in log.metrics
