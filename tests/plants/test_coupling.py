"""Closed-form coupling of the knuckles, used only without other constraints, and compared with MuJoCo's solver."""

from math import sin

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, Drive, Reference
from agrobot_mj.machine import Driveline, Linkage, Machine
from agrobot_mj.machine.implements import Drawn
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.coupling import accelerate
from agrobot_mj.plants.mujoco.views import views_of
from agrobot_mj.terrain import Flat

AHEAD = Drive(NEUTRAL_V, 8.0)


def plant_of(machine=Machine()):
    plant = MujocoPlant(Mujoco(settle_s=0.0), machine, Flat().ground())
    plant.reset(Reference(0, 0, 0, 0, 0, 0))
    return plant


def without_closed_form(plant):
    coupling = plant.views.coupling._replace(rows=np.empty(0, dtype=np.int64))
    plant.views = plant.views._replace(coupling=coupling)
    plant.rig = plant._rig()
    return plant


def weave(plant, ticks=100):
    """Return the positions after each tick of a weaving drive."""
    places = []
    for k in range(ticks):
        plant.step_through(Drive(NEUTRAL_V + 3.0 * sin(0.1 * k), 8.0))
        places.append(plant.data.qpos.copy())
    return np.array(places)


@pytest.mark.parametrize("solimp", [(0.9, 0.95, 0.001, 0.5, 2), (0.5, 0.9, 0.003, 0.4, 3), (0.8, 0.8, 0.001, 0.5, 1)])
def test_closed_form_steering_coupling_agrees_with_the_mujoco_solver(solimp):
    plant, rng = plant_of(Machine(implement=Drawn())), np.random.default_rng(3)
    model, data = plant.model, plant.data
    model.eq_solimp[plant.views.coupling.rows] = solimp
    views = views_of(model, data)
    for _ in range(20):
        data.qpos[:] = plant.configuration()
        data.qpos[2], data.qpos[views.steer_q] = 3.0, rng.uniform(-0.5, 0.5)
        delta = data.qpos[views.steer_q] ** np.arange(5)
        for q, row in zip(views.knuckles_q, views.coupling.rows, strict=True):
            data.qpos[q] = model.eq_data[row, :5] @ delta + rng.normal(0.0, 0.003)
        data.qvel[:], data.ctrl[:] = rng.normal(size=model.nv), rng.normal(size=2)
        data.xfrc_applied[1:] = rng.normal(0.0, 300.0, (model.nbody - 1, 6))
        data.qfrc_applied[:] = rng.normal(0.0, 100.0, model.nv)
        mujoco.mj_forward(model, data)
        assert data.nefc == 2
        acceleration, force = data.qacc.copy(), data.qfrc_constraint.copy()
        data.qacc[:], data.qfrc_constraint[:], data.qfrc_smooth[:] = 0.0, 0.0, 0.0
        accelerate(views)
        assert data.qacc == pytest.approx(acceleration, rel=1e-9, abs=1e-8)
        assert data.qfrc_constraint == pytest.approx(force, rel=1e-9, abs=1e-8)


@pytest.mark.parametrize("machine", [Machine(), Machine(implement=Drawn())], ids=["alone", "drawn"])
def test_motion_with_closed_form_coupling_equals_motion_with_the_solver(machine):
    plant = plant_of(machine)
    direct = weave(plant)
    assert plant.data.nefc == 0
    solved = weave(without_closed_form(plant_of(machine)))
    assert np.ptp(direct[:, plant.views.steer_q]) > 0.3
    assert 0.0 < np.abs(direct - solved).max() < 1e-9


@pytest.mark.parametrize(
    ("machine", "drive", "rows"),
    [
        (Machine(), AHEAD, 0),
        (Machine(), AHEAD._replace(brake=1.0), 4),
        (Machine(linkage=Linkage(friction_n_m=8.0)), AHEAD, 3),
        (Machine(driveline=Driveline(differential_lock=True)), AHEAD, 3),
    ],
    ids=["free", "brake", "friction", "lock"],
)
def test_solver_computes_coupling_force_if_other_constraints_are_active(machine, drive, rows):
    plant = plant_of(machine)
    plant.step_through(drive)
    assert plant.data.nefc == rows
    assert plant.data.eq_active[plant.views.coupling.rows].all()


def test_solver_computes_the_coupling_force_if_the_axle_is_at_a_stop():
    plants = plant_of(), without_closed_form(plant_of())
    for plant in plants:
        plant.step_through(AHEAD)
        plant.data.joint("axle_roll").qpos = 0.2
        plant.step_through(AHEAD)
    assert plants[0].data.qpos == pytest.approx(plants[1].data.qpos, abs=1e-9)
    assert plants[0].data.joint("axle_roll").qpos[0] < 0.195


def test_restored_tractor_is_bit_identical_after_ground_contact():
    plant = plant_of()
    weave(plant, 5)
    state = plant.save()
    first = weave(plant, 5)
    plant.data.qpos[2:7] = 1.0, 0.0, 1.0, 0.0, 0.0
    plant.step_through(AHEAD)
    assert not plant.clear
    plant.restore(state)
    assert np.array_equal(weave(plant, 5), first)
