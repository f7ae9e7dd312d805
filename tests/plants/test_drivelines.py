"""Drivelines that engage and release in motion, motors on each wheel, and an engine with speed droop under load."""

from math import radians, tan

import numpy as np
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, Drive
from agrobot_mj.machine import Driveline, Machine, TractorParameters
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.plants.driver import ORIGIN, Driver
from agrobot_mj.plants.mujoco.clutches import FRONT, LOCK
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import MagicFormula, Soil
from agrobot_mj.tyres.patch import FORCE_X

ROBOT = TractorParameters(front_wheel_radius_m=0.42, front_wheel_width_m=0.24)


def plant_of(driveline, tyre=None, tractor=None):
    machine = Machine(tractor=tractor or TractorParameters(), driveline=driveline)
    plant = MujocoPlant(Mujoco(tyre=tyre or MagicFormula()), machine, Flat().ground(), Clock())
    plant.reset(ORIGIN)
    return plant


def turned(driveline, steer_deg, seconds=12.0):
    """Return the turning radius of the rear axle at 0.8 m/s divided by L / tan(steering angle), and the plant."""
    plant = plant_of(driveline)
    driver = Driver(plant, plant.truth(), 0.8, driveline.full_speed_m_s)
    trace = driver.go(seconds, radians(steer_deg))
    radius = trace.mean("speed", 4.0) / trace.mean("yaw_rate", 4.0)
    return radius * tan(radians(steer_deg)) / plant.tractor.wheelbase_m, plant


def test_disengaged_front_drive_does_not_widen_the_turn():
    rigid, _ = turned(Driveline(front_wheel_drive=True), 35.0)
    free, plant = turned(Driveline(front_wheel_drive=True, front_release_deg=25.0), 35.0)
    none, _ = turned(Driveline(), 35.0)
    assert not plant.clutches.is_engaged(FRONT)
    assert free == pytest.approx(none, rel=0.005)
    assert rigid > 1.1 * none


def test_reengaged_front_drive_causes_no_jump_of_the_yaw_rate():
    driveline = Driveline(front_wheel_drive=True, front_release_deg=25.0)
    plant = plant_of(driveline)
    driver = Driver(plant, plant.truth(), 0.8, driveline.full_speed_m_s)
    driver.go(8.0, radians(35.0))
    assert not plant.clutches.is_engaged(FRONT)
    yaw_rates = np.diff([truth.yaw_rate for truth in driver.go(6.0, 0.0).truths])
    assert plant.clutches.is_engaged(FRONT)
    assert np.abs(yaw_rates).max() < 0.05
    fronts = plant.data.qvel[plant.views.fronts_v].mean()
    wanted = 1.02 * plant.data.qvel[plant.views.spins_v].mean() * 0.42 / 0.28
    assert fronts == pytest.approx(wanted, rel=0.01)


def test_differential_lock_is_released_in_turns_and_engaged_on_straights():
    driveline = Driveline(differential_lock=True, lock_release_deg=10.0)
    plant = plant_of(driveline)
    driver = Driver(plant, plant.truth(), 0.8, driveline.full_speed_m_s)
    driver.go(3.0)
    assert plant.clutches.is_engaged(LOCK)
    driver.go(6.0, radians(20.0))
    left, right = plant.data.qvel[plant.views.spins_v]
    assert not plant.clutches.is_engaged(LOCK)
    assert right > 1.1 * left
    driver.go(6.0, 0.0)
    left, right = plant.data.qvel[plant.views.spins_v]
    assert plant.clutches.is_engaged(LOCK)
    assert left == pytest.approx(right, rel=1e-3)


def test_front_drive_engages_above_the_configured_rear_wheel_slip():
    automatic = Driveline(front_wheel_drive=True, front_engage_slip=0.1)
    free = plant_of(automatic, Soil())
    driver = Driver(free, free.truth(), 0.8, automatic.full_speed_m_s)
    driver.go(6.0)
    assert not free.clutches.is_engaged(FRONT)
    conditions = NOMINAL._replace(drawbar=2200.0)
    engaged = []
    for _ in range(200):
        free.advance(Drive(NEUTRAL_V, NEUTRAL_V + 0.5), conditions)
        engaged.append(free.clutches.is_engaged(FRONT))
    assert any(engaged)
    assert free.wheels().reshape(-1, 4)[FORCE_X][:2].sum() > 0.0


def test_state_of_the_clutches_is_saved_and_restored():
    driveline = Driveline(differential_lock=True, lock_release_deg=10.0)
    plant = plant_of(driveline)
    driver = Driver(plant, plant.truth(), 0.8, driveline.full_speed_m_s)
    driver.go(6.0, radians(20.0))
    driver.go(6.0, 0.0)
    kept, offset = plant.save(), float(plant.clutches.memories[0][0])
    assert offset != 0.0
    first = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V + 1.0))
    plant.reset(ORIGIN)
    assert plant.clutches.memories[0][0] == 0.0
    plant.restore(kept)
    assert plant.clutches.memories[0][0] == offset
    again = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V + 1.0))
    assert (again.x, again.yaw_rate) == (first.x, first.yaw_rate)


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_axle_motors_split_the_drive_torque_between_the_axles(share):
    plant = plant_of(Driveline(motor_front_share=share), MagicFormula(rolling_resistance=0.0), ROBOT)
    for tick in range(200):
        pedal = NEUTRAL_V + 2.0 if tick < 20 else NEUTRAL_V
        plant.advance(Drive(NEUTRAL_V, pedal), NOMINAL._replace(drawbar=900.0))
    forces = plant.wheels().reshape(-1, 4)[FORCE_X]
    assert forces.sum() == pytest.approx(900.0, rel=0.02)
    assert forces[:2].sum() / forces.sum() == pytest.approx(share, abs=0.03)
    assert forces[0] == pytest.approx(forces[1], rel=0.02)


def test_axle_motors_and_rear_drive_give_the_same_turning_radius():
    motors, _ = turned(Driveline(motor_front_share=0.5), 35.0)
    none, _ = turned(Driveline(), 35.0)
    assert motors == pytest.approx(none, rel=0.03)


def test_engine_speed_falls_in_proportion_to_the_power():
    """At a constant pedal, the rim speed is the no-load speed times 1 - droop P / P_max."""
    plant = plant_of(Driveline(engine_droop=0.1, power_limit_kw=4.0, full_speed_m_s=2.0))
    speeds = []
    for drawbar in (0.0, 600.0, 1200.0):
        for _ in range(200):
            plant.advance(Drive(NEUTRAL_V, 12.0), NOMINAL._replace(drawbar=drawbar))
        torque, rate = plant.motion.actuation[2], plant.motion.spin
        assert rate * 0.42 == pytest.approx(2.0 * (1 - 0.1 * torque * rate / 4000.0), rel=2e-3)
        speeds.append(rate)
    assert speeds[0] > 1.01 * speeds[1] > 1.02 * speeds[2]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"front_release_deg": 20}, "driveline.front_release_deg: has no effect .* driveline.front_wheel_drive = true"),
        ({"front_engage_slip": 0.1}, "driveline.front_engage_slip: has no effect"),
        ({"lock_release_deg": 10}, "driveline.lock_release_deg: has no effect"),
        ({"motor_front_share": 0.5, "front_wheel_drive": True}, "driveline.motor_front_share: cannot be combined"),
    ],
)
def test_driveline_keys_without_effect_are_rejected(keys, message):
    with pytest.raises(ScenarioError, match=message) as caught:
        load_scenario("straight_line", {f"driveline.{key}": value for key, value in keys.items()})
    assert "\n" not in str(caught.value)
