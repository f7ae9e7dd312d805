"""Random combinations of faults: the tractor completes its path or stops near the path."""

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.control.supervisor import Mode
from agrobot_mj.metrics.crosstrack import cross_track

FAULTS = {
    "gnss_loss": {},
    "gnss_float": {},
    "gnss_latency": {"latency_s": 0.2},
    "steering_pot_bias": {"bias_deg": 3.0},
    "steering_pot_stuck": {},
    "valve_wear": {"gain_share": 0.5, "dead_band_v": 0.5},
    "drawbar": {"pull_n": 1000.0},
    "side_force": {"force_n": 400.0},
    "friction": {"scale": 0.6},
    "payload": {"mass_kg": 150.0},
}
ESTIMATOR = {
    "estimator.kind": "ekf_full",
    "sensors.gyro.enabled": True,
    "sensors.wheel_speed.enabled": True,
}


def combination(number):
    """Return two to four faults of different kinds with random windows."""
    rng = np.random.default_rng(number)
    chosen = rng.choice(sorted(FAULTS), size=rng.integers(2, 5), replace=False)
    return [
        {"kind": str(kind), "start_s": float(np.round(rng.uniform(5, 30), 2)), **FAULTS[str(kind)]}
        | ({"end_s": float(np.round(rng.uniform(40, 70), 2))} if rng.random() < 0.5 else {})
        for kind in chosen
    ]


def outcome_of(number):
    """Return the run of a combination, its maximum distance from the path, and the permitted distance [m]."""
    keys = {"duration_s": 90.0, "seed": number, "fault": combination(number), "supervisor.enabled": True, **ESTIMATOR}
    log = run(load_scenario("figure_eight", keys))
    c = log.column
    off = np.abs(cross_track(log.scenario.path, c("t"), c("x"), c("y")))
    stopping = c("supervisor_state") == Mode.STOPPING
    way = np.hypot(np.diff(c("x")), np.diff(c("y")))[stopping[1:]].sum()
    unseen = np.hypot(c("x") - c("x_hat"), c("y") - c("y_hat")).max()  # what the estimator does not know
    return log, off.max(), log.scenario.supervisor.max_cross_track_m + way + unseen


@pytest.mark.parametrize("number", [1, 2, 3])
def test_run_with_a_combination_of_faults_ends_near_the_path(number):
    log, off, allowed = outcome_of(number)
    assert log.outcome in ("completed", "stopped")
    assert off < allowed
    assert log.outcome == "completed" or log.metrics["stop_reason"]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4, 24))
def test_runs_with_twenty_fault_combinations_end_near_the_path(number):
    test_run_with_a_combination_of_faults_ends_near_the_path(number)
