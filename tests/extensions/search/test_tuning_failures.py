"""A run that failed has no error in any study: laws that stand still, stop early or drive, under each verb."""

from agrobot_mj import load_scenario
from agrobot_mj.extensions.search.tune import FAILED, MOST, judge, task_of
from agrobot_mj.extensions.search.tuning_cases import TuningCase
from agrobot_mj.studies.engine import perform


def test_tuning_prefers_driving_to_standing():
    keys = {"plant.kind": "bicycle", "duration_s": 9.0, "guidance.kind": "stanley"}
    case = TuningCase("lane change", "tracking", 1, load_scenario("lane_change", keys))
    drives, stands = (
        judge(case, perform(task_of(case, {key: value})).row)
        for key, value in (("guidance.gain_per_s", 0.1), ("driveline.pedal_rate_per_v_s", 1e-9))
    )
    assert stands.row["xte_rms"] < drives.row["xte_rms"]
    assert drives.cost <= MOST < FAILED < stands.cost
