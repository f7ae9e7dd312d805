"""Failures of the campaign in docs/safety.md: some by default, and all in the slow tests."""

import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.spec import members
from agrobot_mj.faults import Fault
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep

FAULTS = read_sweep("faults")
FAILURES = [fault for value in FAULTS.file.axes["fault"].values for fault in value]
RECEIVERS = [fault for value in read_sweep("receivers").file.axes["fault"].values for fault in value]
QUICK = (
    {"kind": "gnss_frozen"},
    {"kind": "gnss_frozen", "keep": "velocity"},
    {"kind": "gnss_frozen", "keep": "live_velocity", "quality": "dgps"},
    {"kind": "gnss_jump", "north_m": 0.5},
    {"kind": "gnss_drift", "north_m_s": 0.022},
    {"kind": "gnss_drift", "east_m_s": -0.09, "north_m_s": 0.06, "velocity": "drifting"},
    {"kind": "gnss_drift", "east_m_s": 0.25, "velocity": "drifting"},
    {"kind": "imu_roll_bias", "bias_deg": -28.0, "ramp_s": 45.0},
    {"kind": "imu_pitch_stuck"},
    {"kind": "imu_roll_loss"},
    {"kind": "wheel_speed_stuck", "value": "zero"},
    {"kind": "gyro_scale"},
    {"kind": "gyro_bias"},
    {"kind": "gyro_bias", "bias_deg_s": -5.0, "start_s": 17.0},
    {"kind": "pedal_pot_scale"},
    {"kind": "valve_scale"},
)
"""Failures whose detection needs measurements that are independent of the estimate and of the reported fix quality."""


def judged(fault, **more):
    """Return the metrics of the run with a failure, after a check of the safety limits."""
    keys = {"guidance.kind": "lqr", "fault": [{"start_s": 10.0, **fault}], "duration_s": 60.0, "path.turns": 1, **more}
    found = run(FAULTS.base.changed(keys)).metrics
    assert found["safety"]["overspeed"] < 1.5
    assert found["safety"]["offset_max"] < 1.0 or found["safety"]["offset_end"] < 2.0 or found["safety"]["off_s"] < 5.0
    return found


@pytest.mark.parametrize("fault", QUICK, ids=lambda fault: "-".join(map(str, fault.values())))
def test_supervisor_stops_a_faulty_tractor_near_its_path(fault):
    found = judged(fault)
    assert found["outcome"] == "stopped"
    assert found["safety"]["offset_end"] < 1.5
    assert found["stop_reason"]


@pytest.mark.parametrize("gap_s", [0.55, 0.9, 2.5])
@pytest.mark.parametrize("law", ["lqr", "stanley"])
def test_supervisor_stops_the_tractor_if_position_jumps_in_a_gnss_gap(gap_s, law):
    gap = {"kind": "gnss_loss", "start_s": 21.0, "end_s": 21.0 + gap_s}
    wrong = {"kind": "gnss_jump", "start_s": 21.0, "north_m": -0.6, "east_m": 0.7}
    keys = {"guidance.kind": law, "fault": [gap, wrong], "duration_s": 60.0, "path.turns": 1}
    found = run(FAULTS.base.changed(keys)).metrics
    assert found["outcome"] == "stopped"
    assert found["safety"]["stop_s"] < gap_s + 0.8
    assert found["safety"]["offset_max"] < 0.35


def test_position_drift_is_detected_between_gaps_and_float_solutions():
    drift = {"kind": "gnss_drift", "start_s": 12.0, "north_m_s": -0.07}
    gaps = [{"kind": "gnss_loss", "start_s": 12.0 + 4 * k, "end_s": 12.7 + 4 * k} for k in range(12)]
    flicker = [{"kind": "gnss_float", "start_s": 12.0, "flicker_s": 0.8}]
    for more in (gaps, flicker):
        keys = {"guidance.kind": "lqr", "fault": [drift, *more], "duration_s": 60.0, "path.turns": 1}
        found = run(FAULTS.base.changed(keys)).metrics
        assert found["outcome"] == "stopped"
        assert found["safety"]["offset_max"] < 0.8


@pytest.mark.parametrize("rate_hz", [10, 5])
def test_receiver_with_a_low_rate_causes_no_false_stop(rate_hz):
    ground = {"kind": "slope", "grade_deg": 9.0, "direction_deg": 70.0}
    keys = {"guidance.kind": "stanley", "sensors.gnss.rate_hz": rate_hz, "terrain": ground, "path.turns": 1}
    assert run(FAULTS.base.changed({**keys, "duration_s": 80.0})).outcome == "completed"


@pytest.mark.parametrize("offset_m", [2.6, -4.5])
@pytest.mark.parametrize("law", ["lqr", "stanley"])
def test_supervisor_lets_a_tractor_with_a_start_offset_acquire_its_line(offset_m, law):
    keys = {"path.start_offset_m": offset_m, "guidance.kind": law, "supervisor.enabled": True}
    log = run(load_scenario("straight_line", keys))
    assert log.outcome == "completed"
    assert abs(log.column("e_lateral")[-20:]).max() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAILURES, ids=lambda fault: "-".join(map(str, fault.values())))
def test_every_fault_of_the_campaign_stays_within_its_safety_limits(fault):
    judged(fault)


def test_safety_campaign_covers_every_sensor_and_actuator_failure():
    kinds = {kind for kind, spec in members(Fault).items() if not spec.machine}
    assert {fault["kind"] for fault in (*FAILURES, *RECEIVERS)} == kinds
    assert len(FAILURES) >= 25


def test_safety_campaign_includes_a_hundred_runs_without_faults():
    assert sum(1 for _ in SweepPlan(read_sweep("sane")).runs()) == 100
