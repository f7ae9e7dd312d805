"""Runs with an initial lateral offset: plant and estimator start at the offset, and errors refer to the path."""

from math import degrees, hypot

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.stepping import Simulation

BESIDE = {"path.start_offset_m": 0.8, "path.start_heading_deg": -15.0}


UNIT = {"sensors.imu.enabled": True, "sensors.imu.wander_sigma_deg": 0.0, "estimator.terrain_compensation": True}
"""Keys of an inertial unit, with which the estimator corrects the antenna tilt on a slope."""


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("straight_line", {"plant.kind": "bicycle"}),
        ("straight_line", {"plant.kind": "mujoco"}),
        ("side_slope_10", UNIT),
    ],
)
def test_start_offset_is_applied_to_tractor_and_estimator(name, keys):
    sim = Simulation(name, {**keys, **BESIDE})
    sim.reset()
    truth, estimate, reference = sim.truth, sim.estimate, sim.reference
    assert (truth.x - reference.x, truth.y - reference.y) == pytest.approx((0.0, 0.8), abs=2e-3)
    assert degrees(truth.yaw - reference.yaw) == pytest.approx(-15.0, abs=0.1)
    assert hypot(estimate.x - truth.x, estimate.y - truth.y) < 0.1
    assert degrees(estimate.yaw) == pytest.approx(-15.0, abs=1.0)


@pytest.mark.parametrize("plant", ["mujoco", "bicycle"])
def test_tractor_starting_off_the_path_reaches_it_and_logs_true_errors(plant):
    keys = {"plant.kind": plant, **BESIDE, "duration_s": 30.0, "guidance.kind": "lqr"}
    log = run(load_scenario("straight_line", keys))
    off = -log.column("e_lateral")
    assert off[0] == pytest.approx(0.8, abs=2e-3)
    assert abs(off[-200:]).max() < 0.1
    assert log.metrics["lateral_rms"] > 0.1


def test_start_position_outside_the_terrain_is_reported():
    with pytest.raises(ScenarioError, match=r"path: the start at \(0, 15\) m is outside the terrain"):
        load_scenario("straight_line", {"path.start_offset_m": 15.0, "terrain.half_size_m": 12.0})
    with pytest.raises(ScenarioError, match=r"path\.start_offset_m: .*20"):
        load_scenario("straight_line", {"path.start_offset_m": 25.0})
