"""Benchmark: each round restores its initial state, the page has all blocks, and the simulated model equals the
displayed model. The tests do not depend on wall times."""

import bench
import mujoco
import numpy as np
import pytest
from blocks import block, page
from measured.performance import PARTS

from agrobot_mj import load_scenario
from agrobot_mj.core.spec import every
from agrobot_mj.machine import Machine
from agrobot_mj.machine.implements import Implement
from agrobot_mj.plants.mujoco.implement import add_implement
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.terrain import Flat, Rough
from agrobot_mj.tyres import Contact, MagicFormula, Ruts


def left_behind(plant):
    """Return all initial values of the next round."""
    state = plant.save()
    ruts = plant.ruts()
    return [state.physics, *state.memories, *([] if ruts is None else [ruts.depth])]


@pytest.mark.parametrize("tyre", [Ruts(), MagicFormula()], ids=lambda tyre: tyre.kind)
def test_every_benchmark_round_starts_from_the_same_state(tyre):
    """If the soil were not restored, ruts would deepen and each round take longer than the previous one."""
    plant = bench.moving(tyre, bench.rough_ground(100), settle_s=0.5)
    start = plant.save()
    bench.tyred_over_bare(plant, start)
    first = left_behind(plant)
    bench.tyred_over_bare(plant, start)
    for one, other in zip(first, left_behind(plant), strict=True):
        assert np.array_equal(one, other)


def test_performance_ratio_is_tick_time_divided_by_mujoco_step_time(monkeypatch):
    """The clock counts calls of the plant for a tick, and calls of MuJoCo for a step."""
    plant, spent = bench.moving(MagicFormula(), bench.rough_ground(100), settle_s=0.5), [0]
    tick, step = plant.step_through, mujoco.mj_step

    def counted(of, cost):
        def call(*arguments):
            spent[0] += cost
            return of(*arguments)

        return call

    monkeypatch.setattr(bench.time, "process_time", lambda: spent[0])
    monkeypatch.setattr(plant, "step_through", counted(tick, 3 * len(plant.samples[0])))
    monkeypatch.setattr(bench.mujoco, "mj_step", counted(step, 2))
    assert bench.tyred_over_bare(plant, plant.save()) == 1.5


def test_models_with_and_without_visual_geoms_step_identically():
    """Steps with and without visual geoms are bit-identical."""
    bare = bench.BareModel(load_scenario("figure_eight", {"duration_s": 1.0}))
    drawn = bare.as_drawn()
    assert drawn.model.ngeom > 5 * bare.model.ngeom
    for model in (bare, drawn):
        mujoco.mj_setState(model.model, model.data, bare.start, bare.kind)
        mujoco.mj_step(model.model, model.data, nstep=300)
    assert np.array_equal(bare.data.qpos, drawn.data.qpos)
    assert np.array_equal(bare.data.qvel, drawn.data.qvel)


@pytest.mark.parametrize("implement", [kind() for kind in every(Implement)], ids=lambda one: one.kind)
@pytest.mark.parametrize("native", [None, Contact().native], ids=["tyres", "contact"])
@pytest.mark.parametrize("terrain", [Flat(), Rough()], ids=lambda one: one.kind)
def test_contacts_of_a_tumbling_tractor_do_not_depend_on_visual_geoms(implement, native, terrain):
    """Visual geoms have no mass and no contacts, and constraint islands have no effect, for a tumbling tractor."""
    found = []
    for drawn in (True, False):
        machine = Machine(implement=implement)
        parts = tractor_spec(machine)
        hitched = implement.hitched(machine.tractor)
        if hitched is not None:
            add_implement(parts, hitched, machine.tractor, native is not None)
        model = simulation_model(parts, terrain.ground(), 0.002, native, drawn)
        if drawn:
            model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        data = mujoco.MjData(model)
        data.qpos[:7] = 0.0, 0.0, 1.5, 0.3, 0.9, 0.2, 0.1
        data.qvel[:6] = 1.0, 0.5, 0.0, 2.0, 1.0, 0.5
        mujoco.mj_normalizeQuat(model, data.qpos)
        touched = 0
        for _ in range(600):
            mujoco.mj_step(model, data)
            touched += data.ncon
        found.append((touched, data.qpos.copy(), data.qvel.copy()))
    (touched, q, v), (touched_too, q_too, v_too) = found
    assert touched == touched_too > 50
    assert np.array_equal(q, q_too)
    assert np.array_equal(v, v_too)


def test_benchmark_of_the_drawn_model_rejects_an_implement():
    bare = bench.BareModel(load_scenario("plough", {"duration_s": 1.0}))
    with pytest.raises(TypeError, match="without an implement"):
        bare.as_drawn()


def test_performance_page_has_a_block_for_each_part():
    text = page("performance").read_text(encoding="utf-8")
    for name in PARTS:
        assert block(text, name).startswith("|")


def test_tick_table_contains_the_time_of_every_part_of_a_tick():
    rows = bench.tick_parts(load_scenario("figure_eight", {"duration_s": 1.0})).splitlines()[2:]
    microseconds = {row.split("|")[1].strip(): float(row.split("|")[2]) for row in rows}
    assert microseconds.keys() == {*bench.PARTS, "other", "sum"}
    assert all(us > 0.0 for us in microseconds.values())
