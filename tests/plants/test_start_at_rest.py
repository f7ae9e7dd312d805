"""A run starts with the tractor at rest, where its path starts."""

from math import hypot

import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.terrain import Flat, Rough, Slope
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Soil

START = Reference(2.0, -1.0, 0.4, 0.0, 0.0, 0.0)
REST = Drive(NEUTRAL_V, NEUTRAL_V)


def start(terrain, tyre=None, **settle):
    """A plant and the truth with which it starts."""
    plant = MujocoPlant(Mujoco(tyre=tyre or MagicFormula(), **settle), Machine(), terrain.ground())
    return plant, plant.reset(START)


def moving(truth):
    """Speed of the CG and of a point a metre from it [m/s]."""
    return max(hypot(truth.speed, truth.lateral_speed), abs(truth.yaw_rate))


def off(truth):
    return hypot(truth.x - START.x, truth.y - START.y)


@pytest.mark.parametrize("tyre", [Linear(), MagicFormula(), Soil(), Soil(cone_index_kpa=300)], ids=str)
@pytest.mark.parametrize("terrain", [Flat(), Slope(grade_deg=10, direction_deg=90), Slope(grade_deg=18), Rough()])
def test_the_tractor_rests_at_the_start_of_its_path_and_stays(terrain, tyre):
    plant, truth = start(terrain, tyre)
    assert moving(truth) < 0.001
    assert off(truth) < 0.001
    truths = [plant.advance(REST) for _ in range(60)]
    assert max(map(moving, truths)) < 0.001


@pytest.mark.parametrize("name", ["contour_traverse", "hills_contour", "gusts", "ploughing", "rough_track", "rollover"])
def test_scenarios_start_at_rest(name):
    loop = Loop(load_scenario(name))
    assert moving(loop.truth) < 0.001


def test_on_level_ground_it_settles_for_the_given_time_and_is_placed_once(monkeypatch):
    placed = []
    place = MujocoPlant._place
    monkeypatch.setattr(MujocoPlant, "_place", lambda self, at: (placed.append(at), place(self, at))[1])
    plant, _ = start(Flat())
    assert placed == [START]
    assert plant.data.time == pytest.approx(3.0)


@pytest.mark.parametrize(("tyre", "limit"), [(Contact(), 8.0)], ids=["contact"])
def test_a_creeping_tractor_is_reported_and_starts_as_it_is(tyre, limit, capsys):
    _, truth = start(Slope(grade_deg=15), tyre, settle_limit_s=limit)
    told = capsys.readouterr().err
    assert told.startswith(f"plant.settle_limit_s: not at rest after {limit:g} s, still ")
    assert moving(truth) > 0.0005


def test_does_not_settle_when_told_not_to(capsys):
    plant, truth = start(Slope(grade_deg=10), settle_s=0.0)
    assert plant.data.time == 0.0
    assert off(truth) < 1e-9
    assert not np.any(plant.data.qvel)
    assert capsys.readouterr().err == ""
