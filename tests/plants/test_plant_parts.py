"""MuJoCo plant: application of fault conditions, reset of all internal states, and messages only when necessary."""

import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.loads import PULL, SIDE
from agrobot_mj.terrain import Flat

START = Reference(2.0, -1.0, 0.4, 0.0, 0.0, 0.0)


def standing(settle_s=0.0):
    plant = MujocoPlant(Mujoco(settle_s=settle_s), Machine(), Flat().ground())
    plant.reset(START)
    return plant


def test_faults_act_on_tyres_loads_and_valve_until_they_are_removed():
    plant = standing()
    stiffness, rolling = (0.9, 0.8, 0.7, 0.6), (1.1, 1.2, 1.3, 1.4)
    there = NOMINAL._replace(
        grip=0.5, tyre_stiffness=stiffness, tyre_rolling=rolling, drawbar=300.0, side_force=-40.0, valve_gain=0.7
    )
    firm, flow = plant.tyred.tyres.stiffness.copy(), plant.actuators.valve
    plant.advance(Drive(NEUTRAL_V, NEUTRAL_V), there)
    tyres = plant.tyred.tyres
    assert tyres.grip.tolist() == [0.5] * 4
    assert tyres.carcass[:, 0].tolist() == list(stiffness)
    assert tyres.carcass[:, 1].tolist() == list(rolling)
    assert tyres.stiffness == pytest.approx(firm * stiffness)
    assert (plant.loads[PULL], plant.loads[SIDE]) == (300.0, -40.0)
    assert plant.actuators.valve != flow
    plant.advance(Drive(NEUTRAL_V, NEUTRAL_V))
    assert (tyres.grip == 1.0).all()
    assert (tyres.carcass == 1.0).all()
    assert tyres.stiffness.tolist() == firm.tolist()
    assert (plant.loads[PULL], plant.loads[SIDE]) == (0.0, 0.0)
    assert plant.actuators.valve == flow


def test_reset_restores_valve_driveline_tyres_loads_and_cylinder():
    driven, fresh = standing(), standing()
    for _ in range(10):
        driven.advance(Drive(9.0, 9.0), NOMINAL._replace(drawbar=500.0))
    own = [plant.drive_memory for plant in (driven, fresh)]
    assert not all(np.array_equal(a, b) for a, b in zip(*own, strict=True))
    driven.reset(START)
    for name in ("valve_memory", "drive_memory"):
        for a, b in zip(getattr(driven, name), getattr(fresh, name), strict=True):
            assert np.array_equal(a, b), name
    assert np.array_equal(driven.tyred.bristles, fresh.tyred.bristles)
    assert driven.loads.tolist() == fresh.loads.tolist()
    assert driven.cylinder.tolist() == [0.0]
    assert driven.data.qpos.tolist() == fresh.data.qpos.tolist()
    assert driven.ticks == 0


def test_settling_prints_no_message_if_the_tractor_comes_to_rest(capsys):
    standing(settle_s=3.0)
    assert capsys.readouterr() == ("", "")
