"""GNSS antenna away from the rear axle: its motion on both plants, and fixes converted to the axle."""

import numpy as np
import pytest

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import from_heading, to_level
from agrobot_mj.core.signals import Fix, Measurement, Quality
from agrobot_mj.metrics.estimate_error import PLACE
from agrobot_mj.simulation.receiver import MountedReceiver

AHEAD, LEFT = 0.9, -0.35
OFF_AXLE = {"tractor.antenna_ahead_m": AHEAD, "tractor.antenna_left_m": LEFT}
BEND = {"plant.kind": "bicycle", "path.kind": "circle", "path.radius_m": 8.0, "duration_s": 20.0}
EXACT = {"sensors.gnss.sigma_m": 0.0, "sensors.gnss.velocity_sigma_m_s": 0.0, "sensors.gyro.enabled": True}


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_antenna_off_the_axle_moves_with_roll_and_pitch_of_the_body(plant):
    slope = {} if plant == "bicycle" else {"terrain.kind": "slope", "terrain.grade_deg": 8.0}
    sim = Simulation("straight_line", {**OFF_AXLE, **slope, "plant.kind": plant, "physics": "fast"})
    truths = []
    for _ in range(60):
        sim.step(steer=0.3, speed=1.0)
        truths.append(sim.truth)
    before, now, after = truths[-3:]
    assert abs(now.yaw_rate) > 0.1
    rate = (np.array(after.antenna) - np.array(before.antenna)) / 0.1
    assert now.antenna_velocity == pytest.approx(rate, abs=0.02)
    forward, left, _ = to_level(now.roll, now.pitch, sim.scenario.tractor.antenna)
    arm = from_heading(now.yaw, forward, left)
    assert (now.antenna[0] - now.rear_x, now.antenna[1] - now.rear_y) == pytest.approx(arm, abs=0.02)
    assert plant == "bicycle" or abs(now.roll) + abs(now.pitch) > 0.08


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_delayed_fix_is_transferred_to_the_axle_of_a_turning_tractor(late):
    rate, speed, arm = 0.4, 1.5, (AHEAD, LEFT)

    def axle(t):
        return speed / rate * np.sin(rate * t), speed / rate * (1 - np.cos(rate * t))

    def fix(t):
        (x, y), yaw = axle(t), rate * t
        dx, dy = from_heading(yaw, *arm)
        vx, vy = from_heading(yaw, speed, 0.0)
        return Fix(x + dx, y + dy, vx - rate * dy, vy + rate * dx, t, 2.0)

    now = 3.0
    receiver = MountedReceiver(arm, 1.4, rate * (now - 0.05), t=now - 0.05)
    measured = Measurement(now, fix(now - late), Quality.FIX, 0.0, 0.0, gyro=rate)
    found = receiver.at_rear_axle(measured).fix
    assert (found.x, found.y) == pytest.approx(axle(now - late))
    assert (found.vx, found.vy) == pytest.approx(from_heading(rate * (now - late), speed, 0.0))
    tilted = receiver.at_rear_axle(measured._replace(roll=0.2, pitch=0.0)).fix
    shift = from_heading(rate * (now - late), 0.0, LEFT * (1 - np.cos(0.2)))
    assert (tilted.x - found.x, tilted.y - found.y) == pytest.approx(shift)


def estimate_error(result):
    """Return the mean lateral and longitudinal errors (estimated minus true) of the rear axle after 5 s [m]."""
    c = result.column
    turned = np.exp(-1j * c("yaw")) * (c("rear_x_hat") - c("rear_x") + 1j * (c("rear_y_hat") - c("rear_y")))
    mean = turned[c("t") > 5.0].mean()
    return mean.imag, mean.real


@pytest.fixture(scope="module")
def above_axle():
    return run(load_scenario("straight_line", {**BEND, **EXACT}))


def test_correctly_configured_antenna_offset_causes_no_error(above_axle):
    result = run(load_scenario("straight_line", {**BEND, **EXACT, **OFF_AXLE}))
    assert result.outcome == "completed"
    assert estimate_error(result) == pytest.approx(estimate_error(above_axle), abs=0.02)
    fixes = np.hypot(
        result.column("gnss_x") - result.column("rear_x"), result.column("gnss_y") - result.column("rear_y")
    )
    assert np.nanmax(np.abs(fixes - np.hypot(AHEAD, LEFT))) < 1e-6


def test_wrong_antenna_offset_shifts_the_estimate_and_is_named_as_cause(above_axle):
    wrong = {"sensors.gnss.configured_left_m": LEFT - 0.3, "sensors.gnss.configured_ahead_m": AHEAD}
    result = run(load_scenario("straight_line", {**BEND, **EXACT, **OFF_AXLE, **wrong}))
    assert estimate_error(result)[0] - estimate_error(above_axle)[0] == pytest.approx(0.3, abs=0.02)
    assert result.metrics["xte_cause"] == PLACE
    assert result.metrics["xte_remedy"].startswith("measure the antenna position")


def test_antenna_offset_key_is_rejected_with_an_antenna_on_an_implement():
    keys = {"implement.kind": "mounted", "implement.receiver": True, "sensors.gnss.configured_left_m": 0.1}
    with pytest.raises(ScenarioError, match=r"sensors.gnss.configured_left_m: the antenna is on the implement"):
        load_scenario("straight_line", keys)
