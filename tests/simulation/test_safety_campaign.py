"""Failures of the campaign of docs/safety.md, some of them by default and all of them among the slow tests."""

import pytest

from agrobot_mj import run
from agrobot_mj.core.spec import members
from agrobot_mj.faults import Fault
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep

FAULTS = read_sweep("faults")
FAILURES = [value[0] for value in FAULTS.file.axes["fault"].values]
RECEIVERS = [fault for value in read_sweep("receivers").file.axes["fault"].values for fault in value]
QUICK = (
    {"kind": "gnss_frozen"},
    {"kind": "gnss_frozen", "keep": "velocity"},
    {"kind": "gnss_frozen", "keep": "live_velocity", "quality": "dgps"},
    {"kind": "gnss_jump", "north_m": 0.5},
    {"kind": "wheel_speed_stuck", "value": "zero"},
    {"kind": "gyro_scale"},
    {"kind": "gyro_bias"},
    {"kind": "gyro_bias", "bias_deg_s": -5.0, "start_s": 17.0},
    {"kind": "pedal_pot_scale"},
    {"kind": "valve_scale"},
)
"""Failures that were missed or late before there was evidence beside the estimate, whatever quality a fix claims."""


def judged(fault, **more):
    """`safety` of the run with this failure, after the bars."""
    keys = {"guidance.kind": "lqr", "fault": [{"start_s": 10.0, **fault}], **more}
    found = run(FAULTS.base.changed(keys)).metrics
    assert found["safety"]["overspeed"] < 1.5
    assert found["safety"]["offset_max"] < 1.0 or found["safety"]["offset_end"] < 2.0 or found["safety"]["off_s"] < 5.0
    return found


@pytest.mark.parametrize("fault", QUICK, ids=lambda fault: "-".join(map(str, fault.values())))
def test_stops_near_its_path_without_overspeed(fault):
    found = judged(fault)
    assert found["outcome"] == "stopped"
    assert found["safety"]["offset_end"] < 1.5
    assert found["stop_reason"]


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAILURES, ids=lambda fault: "-".join(map(str, fault.values())))
def test_every_failure_stays_within_its_bounds(fault):
    judged(fault)


def test_the_campaign_covers_every_sensor_and_actuator_failure():
    kinds = {kind for kind, spec in members(Fault).items() if not spec.machine}
    assert {fault["kind"] for fault in (*FAILURES, *RECEIVERS)} == kinds
    assert len(FAILURES) >= 25


def test_there_are_a_hundred_healthy_runs():
    assert sum(1 for _ in SweepPlan(read_sweep("sane")).runs()) == 100
