"""Contacts are skipped only where no contact is possible; results of rollovers do not change."""

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.clearance import is_clear
from agrobot_mj.terrain import Bumps, Flat, Slope
from agrobot_mj.tyres import Contact, Linear

GROUNDS = [Flat(), Slope(grade_deg=12), Bumps()]
ORIGIN = Reference(0, 0, 0, 0, 0, 0)


def plant_on(terrain, tyre=Linear()):
    plant = MujocoPlant(Mujoco(tyre=tyre, settle_s=0.0), Machine(), terrain.ground())
    plant.reset(ORIGIN)
    return plant


def rolling_over(terrain, careful):
    """Return positions per tick of a tractor thrown onto its side, ticks with contact, and ticks starting clear.

    All steps use MuJoCo's solver, because the closed form for a clear tractor gives other last digits.
    """
    plant, places, touched, clear = plant_on(terrain), [], 0, 0
    coupling = plant.views.coupling._replace(rows=np.empty(0, dtype=np.int64))
    plant.views = plant.views._replace(coupling=coupling)
    plant.rig = plant._rig()
    plant.data.qpos[2] += 1.5
    plant.data.qvel[:6] = 1.0, 0.5, 0.0, 4.0, 1.0, 0.5
    for _ in range(60):
        plant.clear = plant.clear and not careful
        clear += plant.clear
        plant.step_through(Drive(NEUTRAL_V, NEUTRAL_V))
        touched += plant.data.ncon > 0
        places.append(plant.data.qpos.copy())
    return np.array(places), touched, clear


@pytest.mark.parametrize("terrain", GROUNDS, ids=lambda one: one.kind)
def test_skipping_contacts_of_a_clear_chassis_does_not_change_a_rollover(terrain):
    places, touched, clear = rolling_over(terrain, careful=False)
    always, touched_too, _ = rolling_over(terrain, careful=True)
    assert clear > 2
    assert touched == touched_too > 2
    assert np.array_equal(places, always)


@pytest.mark.parametrize("terrain", GROUNDS, ids=lambda one: one.kind)
def test_tractor_classified_as_clear_of_the_ground_has_no_body_contacts(terrain):
    """Attitudes are random, at heights near the first contact of a part."""
    plant, rng, found = plant_on(terrain), np.random.default_rng(4), []
    for _ in range(3000):
        turn = np.array([1.0, *rng.normal(0.0, 0.12, 2), rng.normal()])
        plant.data.qpos[:3] = *rng.uniform(-3.0, 3.0, 2), rng.uniform(-1.2, 0.8)
        plant.data.qpos[3:7] = turn / np.linalg.norm(turn)
        mujoco.mj_fwdPosition(plant.model, plant.data)
        found.append((is_clear(plant.clearance, plant.data.qpos), plant.data.ncon > 0))
    clear, touching = np.array(found).T
    assert not (clear & touching).any()
    assert clear.mean() > 0.1
    assert touching.mean() > 0.1


def test_only_the_upright_tractor_is_classified_as_clear_of_the_ground():
    plant = plant_on(Flat())
    assert is_clear(plant.clearance, plant.data.qpos)
    plant.data.qpos[2:7] = 3.0, 0.0, 1.0, 0.0, 0.0
    assert not is_clear(plant.clearance, plant.data.qpos)
    plant.data.qpos[2] = np.nan
    assert not is_clear(plant.clearance, plant.data.qpos)


def test_wheels_on_the_ground_are_not_classified_as_clear_of_the_ground():
    plant = plant_on(Flat(), Contact())
    assert not is_clear(plant.clearance, plant.data.qpos)
