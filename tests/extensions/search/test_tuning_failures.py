"""Failed runs have no error in any search: laws that stand still, stop early or complete, with each command."""

import json

from standing import AWAY, standing

from agrobot_mj import load_scenario
from agrobot_mj.extensions.search.tune import FAILED, MOST, judge, task_of
from agrobot_mj.extensions.search.tuning_cases import TuningCase
from agrobot_mj.studies.engine.tasks import perform


def test_tuning_prefers_a_moving_law_over_a_stationary_one():
    keys = {"plant.kind": "bicycle", "duration_s": 9.0, "guidance.kind": "stanley"}
    case = TuningCase("lane change", "tracking", 1, load_scenario("lane_change", keys))
    drives, stands = (
        judge(case, perform(task_of(case, {key: value})).row)
        for key, value in (("guidance.gain_per_s", 0.1), ("driveline.pedal_rate_per_v_s", 1e-9))
    )
    assert stands.row["xte_rms"] < drives.row["xte_rms"]
    assert drives.cost <= MOST < FAILED < stands.cost


def test_stationary_law_is_reported_as_always_failing(call, request, tmp_path):
    file, still = standing(tmp_path, request.node.name)
    where = ("--key", "path.radius_m", "--range", "12:6", "--max-seeds", 2, "--until", "xte_rms > 0.5")
    status, out, _ = call(
        "limit", "circle", "--plugin", file, "--guidance", still, *where, *AWAY, "--jobs", 1, "--out", "out"
    )
    assert status == 0
    (law,) = json.loads((tmp_path / "out" / "limit.json").read_text())["laws"]
    assert law["verdict"] == "always_fails"
    assert "0 of 2 runs succeed (2 unfinished)" in out
    assert "Some runs did not end as expected: 12 unfinished at 12; 2 unfinished at 10.5" in out
