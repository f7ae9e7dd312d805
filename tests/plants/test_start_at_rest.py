"""Every run starts with the tractor at rest at the start of its path."""

from math import hypot

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.settling import TILT_DEG_S, Tilt, pose_on
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.terrain import Flat, Rough, Slope
from agrobot_mj.terrain.grid import Ground, Surface
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Soil
from agrobot_mj.tyres.patch import LOAD

START = Reference(2.0, -1.0, 0.4, 0.0, 0.0, 0.0)
REST, ZERO = Drive(NEUTRAL_V, NEUTRAL_V), np.array([[0.0]])


def start(terrain, tyre=None, **settle):
    """Return a plant and its initial true state."""
    plant = MujocoPlant(Mujoco(tyre=tyre or MagicFormula(), **settle), Machine(), terrain.ground())
    return plant, plant.reset(START)


def moving(truth):
    """Return the maximum speed of the CG and of a point at a distance of one metre [m/s]."""
    return max(hypot(truth.speed, truth.lateral_speed), abs(truth.yaw_rate))


def off(truth):
    return hypot(truth.x - START.x, truth.y - START.y)


@pytest.mark.parametrize("tyre", [Linear(), MagicFormula(), Soil(), Soil(cone_index_kpa=300)], ids=str)
@pytest.mark.parametrize("terrain", [Flat(), Slope(grade_deg=10, direction_deg=90), Slope(grade_deg=18), Rough()])
def test_tractor_is_at_rest_at_the_start_of_its_path_and_stays(terrain, tyre):
    plant, truth = start(terrain, tyre)
    assert moving(truth) < 0.001
    assert off(truth) < 0.001
    truths = [plant.advance(REST) for _ in range(60)]
    assert max(map(moving, truths)) < 0.001


@pytest.mark.parametrize("name", ["contour_traverse", "hills_contour", "gusts", "ploughing", "rough_track", "rollover"])
def test_every_scenario_starts_at_rest(name):
    loop = Loop(load_scenario(name))
    assert moving(loop.truth) < 0.001


def test_tractor_on_level_ground_settles_in_the_configured_time(monkeypatch):
    placed = []
    place = MujocoPlant._place
    monkeypatch.setattr(MujocoPlant, "_place", lambda self, at: (placed.append(at), place(self, at))[1])
    plant, _ = start(Flat())
    assert placed == [START]
    assert plant.data.time == pytest.approx(3.0)


def test_tractor_still_sliding_at_the_start_is_reported_but_run_starts(capsys):
    slippery = Slope(grade_deg=15).ground()._replace(surface=Surface(-50.0, -50.0, 100.0, np.array([[0.3]]), ZERO))
    plant = MujocoPlant(Mujoco(settle_limit_s=4.0), Machine(), slippery)
    truth = plant.reset(START)
    assert "the tractor slides" in capsys.readouterr().err
    assert moving(truth) > 0.0005


def test_tractor_on_contact_tyres_starts_at_rest_on_a_slope(capsys):
    _, truth = start(Slope(grade_deg=15, direction_deg=30), Contact())
    assert moving(truth) < 1e-5
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("direction_deg", [0.0, 57.0, 90.0, 200.0])
def test_gravity_rotates_from_ground_normal_to_vertical_while_settling(direction_deg):
    slope = Slope(grade_deg=20, direction_deg=direction_deg)
    rotation, _ = pose_on(slope.ground(), START, Machine().tractor)
    up = np.zeros(9)
    mujoco.mju_quat2Mat(up, rotation[3:])
    turn = Tilt(up[2::3], 0.05)
    directions = np.array([turn.up(tick) for tick in range(turn.ticks + 1)])
    assert directions[0] == pytest.approx(up[2::3], abs=1e-12)
    assert np.array_equal(directions[-1], [0.0, 0.0, 1.0])
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0, abs=1e-12)
    turns = np.degrees(np.arccos(np.clip(np.sum(directions[1:] * directions[:-1], axis=1), -1.0, 1.0)))
    assert turns.sum() == pytest.approx(20.0, abs=1e-3)
    assert turns.max() / 0.05 < 1.6 * TILT_DEG_S


def test_gravity_is_vertical_after_settling():
    plant, _ = start(Slope(grade_deg=14, direction_deg=25))
    assert np.array_equal(plant.model.opt.gravity, [0.0, 0.0, -GRAVITY])
    assert Tilt(np.array([0.0, 0.0, 1.0]), 0.05).ticks == 0


def test_wheel_without_load_above_a_pit_is_reported(capsys):
    heights = np.zeros((401, 401))
    heights[185:199, 202:222] = -0.6  # below the right front wheel
    low = Machine(TractorParameters(cg_height_m=0.4, front_load_fraction=0.25))  # stays on three wheels
    plant = MujocoPlant(Mujoco(), low, Ground(-20.0, -20.0, 0.1, heights))
    truth = plant.reset(Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert moving(truth) < 0.0005
    loads = plant.wheels().reshape(-1, 4)[LOAD]
    assert loads[1] == 0.0
    assert loads[[0, 2, 3]].min() > 0.0
    told = capsys.readouterr().err
    assert told.startswith("plant.settle_limit_s: at rest: there is no load on wheel fr on ground of 0.0 deg")


def test_zero_settling_time_skips_settling(capsys):
    plant, truth = start(Slope(grade_deg=10), settle_s=0.0)
    assert plant.data.time == 0.0
    assert off(truth) < 1e-9
    assert not np.any(plant.data.qvel)
    assert capsys.readouterr().err == ""
