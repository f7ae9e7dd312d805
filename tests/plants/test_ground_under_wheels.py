"""Ground patches below the tractor: split friction, MuJoCo's own contact, and the initial height of the wheels."""

from math import cos, degrees, radians

import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, TICK_S, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.driver import Driver
from agrobot_mj.terrain import Flat, Ground, Slope, height_and_gradient
from agrobot_mj.terrain.patches import RectanglePatch
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Soil
from agrobot_mj.tyres.patch import FRICTION_USE

TRACTOR = TractorParameters()
ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
REST, AHEAD, BACK = (Drive(NEUTRAL_V, pedal) for pedal in (NEUTRAL_V, 12.0, 0.0))
GRIPPING = [MagicFormula(), Soil(), Contact()]


def build(ground, tyre=None, start=ORIGIN, settle_s=3.0, **driveline):
    spec = Mujoco(tyre=tyre or MagicFormula(), settle_s=settle_s)
    plant = MujocoPlant(spec, Machine(driveline=Driveline(**driveline)), ground)
    return plant, plant.reset(start)


def icy(side, from_m=-50.0):
    """Return level ground with ice below the wheels of one side (1: left), starting ahead of the tractor."""
    length = 100.0
    ice = RectanglePatch(x_m=from_m + length / 2, y_m=5.0 * side, length_m=length, width_m=10.0, friction=0.15)
    return Flat(patch=(ice,)).ground()


def hold(plant, drive, seconds, conditions=NOMINAL):
    for _ in range(round(seconds / TICK_S)):
        truth = plant.advance(drive, conditions)
    return truth


# --- split friction -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("tyre", GRIPPING, ids=lambda tyre: tyre.kind)
def test_locked_differential_yaws_an_accelerating_tractor_towards_the_ice(tyre, side):
    plant, _ = build(icy(side), tyre, differential_lock=True)
    assert side * hold(plant, AHEAD, 1.2).yaw > radians(0.5)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("tyre", GRIPPING, ids=lambda tyre: tyre.kind)
def test_locked_differential_yaws_a_braking_tractor_away_from_the_ice(tyre, side):
    plant, truth = build(icy(side, from_m=6.0), tyre, differential_lock=True)
    driver = Driver(plant, truth, 2.0)
    while driver.truth.x < 8.0:
        driver.go(TICK_S)
    assert side * (hold(plant, BACK, 0.6).yaw - driver.truth.yaw) < -radians(0.5)


@pytest.mark.parametrize("tyre", [MagicFormula(), Soil()], ids=lambda tyre: tyre.kind)
def test_torque_of_an_open_differential_is_limited_by_the_wheel_on_ice(tyre):
    """Both wheels have the same torque, so the tractor moves straight and slowly."""
    split, _ = build(icy(1), tyre)
    dry, _ = build(Flat().ground(), tyre)
    on_ice, free = hold(split, AHEAD, 1.2), hold(dry, AHEAD, 1.2)
    assert abs(degrees(on_ice.yaw)) < 1.0
    assert on_ice.speed < 0.7 * free.speed
    report = split.wheels().reshape(6, 4)
    assert report[FRICTION_USE, 2] > 5 * report[FRICTION_USE, 3]


# --- MuJoCo's own contact -----------------------------------------------------------------------------------------


def test_contact_friction_of_each_wheel_is_ground_times_fault_friction():
    plant, _ = build(icy(1), Contact(friction=0.7))
    hold(plant, REST, 0.1, NOMINAL._replace(grip=0.5))
    found = [plant.model.geom(f"tyre_{wheel}").friction[0] for wheel in ("fl", "fr", "rl", "rr")]
    assert found == pytest.approx([0.7 * 0.15 * 0.5, 0.7 * 0.5] * 2)
    hold(plant, REST, TICK_S)
    assert plant.model.geom("tyre_rr").friction[0] == pytest.approx(0.7)


@pytest.mark.parametrize("grip", [1.0, 0.4])
def test_contact_tyre_slides_on_a_slope_steeper_than_its_friction_angle(grip):
    """The tyre also reports the used fraction of its friction."""
    plant, _ = build(Slope(grade_deg=15, direction_deg=0).ground(), Contact(friction=0.6))
    day = NOMINAL._replace(grip=grip)  # 0.24 is less than tan(15 deg) = 0.27
    early, late = hold(plant, REST, 1.0, day), hold(plant, REST, 1.0, day)
    slid = early.x - late.x
    assert slid > 0.05 if grip < 0.5 else slid < 0.04
    seen = []
    for _ in range(20):
        hold(plant, REST, TICK_S, day)
        seen.append(plant.wheels().reshape(6, 4).copy())
    load, _, _, f_x, f_y, use = np.stack(seen, axis=1)
    touching = load > 50  # sliding cylinders hop
    assert use[touching] == pytest.approx(np.hypot(f_x, f_y)[touching] / (0.6 * grip * load[touching]))
    assert touching.mean() > 0.3
    if grip < 0.5:
        rear = use[:, 2:][touching[:, 2:]]  # those in front roll
        assert np.median(rear) == pytest.approx(1.0, abs=0.05)
        assert use.max() < 1.01
    else:
        assert use[touching].max() < 0.95


# --- the pose at the start ----------------------------------------------------------------------------------------


def placed(ground, start=ORIGIN):
    """Return plant, true state, and height of each wheel's lowest point above the ground before the first step [m]."""
    plant, truth = build(ground, start=start, settle_s=0.0)
    gaps = []
    for wheel, r in zip(("fl", "fr", "rl", "rr"), [0.28, 0.28, 0.42, 0.42], strict=True):
        body = plant.data.body(f"wheel_{wheel}")
        axle = body.xmat.reshape(3, 3)[:, 1]
        down = -np.array([0.0, 0.0, 1.0]) + axle[2] * axle
        foot = body.xpos + r * down / np.linalg.norm(down)
        gaps.append(foot[2] - plant_height(ground, foot))
    return plant, truth, np.array(gaps)


def plant_height(ground, point):
    return height_and_gradient(ground, point[0], point[1])[0]


def waves(amplitude):
    """Return ground with crossed bumps of 2 m wavelength."""
    nodes = 0.05 * np.arange(-200, 201)
    heights = amplitude * (np.sin(np.pi * nodes[None, :]) + np.cos(np.pi * nodes[:, None] + 0.7))
    return Ground(-10.0, -10.0, 0.05, np.ascontiguousarray(heights))


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.3])
def test_wheels_start_at_their_static_deflection_on_rough_ground(yaw):
    """The error is a few millimetres, whereas the gradient below the CG alone would give large wheel heights."""
    _, _, gaps = placed(waves(0.06), ORIGIN._replace(x=0.3, y=-0.4, yaw=yaw))
    sunk = np.array([TRACTOR.front_axle_load / 2 / TRACTOR.front_wheel.stiffness] * 2)
    assert gaps[:2] == pytest.approx(-sunk, abs=0.02)
    assert gaps[2:] == pytest.approx(-TRACTOR.rear_axle_load / 2 / TRACTOR.rear_wheel.stiffness, abs=0.015)


@pytest.mark.parametrize("grade", [0.0, 20.0, 35.0])
@pytest.mark.parametrize("direction", [0.0, 90.0, 200.0])
def test_machine_starts_perpendicular_to_a_slope(grade, direction):
    start = ORIGIN._replace(x=4.0, y=-3.0, yaw=0.7)
    plant, truth, gaps = placed(Slope(grade_deg=grade, direction_deg=direction).ground(), start)
    assert (truth.x, truth.y, truth.yaw) == pytest.approx((4.0, -3.0, 0.7), abs=1e-9)
    assert plant.data.body("chassis").xmat[8] == pytest.approx(cos(radians(grade)))
    assert np.ptp(gaps[:2]) < 1e-9
    assert np.ptp(gaps[2:]) < 1e-9


@pytest.mark.parametrize("tyre", [Linear(), MagicFormula()], ids=lambda tyre: tyre.kind)
def test_tractor_settles_on_rough_ground_close_to_its_start(tyre):
    plant, truth = build(waves(0.04), tyre)
    assert np.hypot(truth.x, truth.y) < 0.1
    assert (plant.wheels()[:4] > 300).all()
    assert abs(hold(plant, REST, 1.0).speed) < 0.01
    assert plant.warnings() == 0
