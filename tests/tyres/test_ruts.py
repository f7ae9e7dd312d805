"""Soil with rut memory: rut walls, slip sinkage, energy conservation, and stored ruts of a run."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.signals import NEUTRAL_V, Drive
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.driver import mujoco_plant
from agrobot_mj.simulation.storage import write_log
from agrobot_mj.terrain import Flat
from agrobot_mj.terrain.grid import plane
from agrobot_mj.terrain.memory import FORGETS, forget, restore, rut_map, save_memory, untouched_soil
from agrobot_mj.tyres import Ruts, Soil
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.bearing import SoilCell, load_cell, press
from agrobot_mj.tyres.laws import treads, with_soil_memory

SOIL = Ruts().structure().bearing
REAR = treads(SOIL, TractorParameters())[1]
LEVEL = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def rolled(memory, depth, y=0.0, slip=0.0, way=1.0, tread=REAR):
    """Roll a wheel to the east at a constant depth below the original ground. Return the last soil reaction."""
    for x in np.arange(0.0, way, 0.005):
        pressed = press(SOIL, tread, memory, (x, y, 0.0), LEVEL, depth, slip)
    return pressed


def field():
    return with_soil_memory(plane(0.0, 0.0, 4.0), SOIL).memory


def test_rut_walls_exert_a_side_force_on_a_wheel():
    """The side force towards the middle increases with the offset on both sides; untouched ground has none."""
    memory = field()
    rolled(memory, 0.05)
    state = save_memory(memory)
    push = []
    for y in (-0.06, -0.03, 0.0, 0.03, 0.06):
        restore(memory, state)
        push.append(press(SOIL, REAR, memory, (0.5, y, 0.0), LEVEL, 0.05, 0.0).edge)
    assert push[2] == pytest.approx(0.0, abs=60.0)  # cells are not symmetric about it
    assert push[0] > push[1] > 100.0
    assert push[4] < push[3] < -100.0
    assert abs(press(SOIL, REAR, field(), (0.5, 0.0, 0.0), LEVEL, 0.05, 0.0).edge) < 60.0


def test_wheel_above_a_rut_deeper_than_the_tyre_reaches_has_no_load():
    memory = field()
    rolled(memory, 0.06)
    assert press(SOIL, REAR, memory, (0.5, 0.0, 0.0), LEVEL, 0.02, 0.0).load == 0.0


def test_slip_sinkage_follows_the_lyasko_model():
    """At a given pressure, slip i increases the sinkage of a plate by (1 + i) / (1 - i / 2)."""
    k = SOIL.k_phi
    depths = []
    for factor in (1.0, 1.3 / 0.85):
        cell, depth = SoilCell(0.0, 0.0, 0.0, 0.0, 0.0), 0.0
        while cell.pressure < 1e5:
            depth += 1e-5
            cell = load_cell(SOIL, k, SOIL.rebound, factor, depth, cell)
        depths.append(cell.sinkage)
    assert depths[1] / depths[0] == pytest.approx(1.3 / 0.85, rel=1e-3)


def test_soil_returns_no_more_work_than_was_done_on_it():
    """For any history of depths, a cell absorbs work in every closed loop, and its sinkage never decreases."""
    rng = np.random.default_rng(3)
    E, cell, before, work = 1e7, SoilCell(0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0
    for aim in rng.uniform(0.0, 0.08, 60):
        for depth in np.linspace(before, aim, 200)[1:]:
            after = load_cell(SOIL, SOIL.k_phi, E, 1.0, depth, cell)
            assert after.sinkage >= cell.sinkage
            work += 0.5 * (after.pressure + cell.pressure) * (depth - before)
            cell, before = after, depth
            assert work - cell.pressure**2 / (2 * E) >= -1e-3 * max(work, 1.0)


def test_shear_strength_follows_the_mohr_coulomb_criterion():
    law = Ruts(cohesion_kpa=10.0, friction_deg=30.0).coefficients(TractorParameters())[1]
    slip = Slip(-0.5, 0.0, 2000.0, 0.01, 1.0, Footing(1.0, 0.0), 1.0, 0.04, 0.3)
    strength = 0.04 * 10e3 + 2000.0 * np.tan(np.radians(30.0))
    j = 0.5 / 1.5 * 0.3 / 0.015  # slip of the faster, the rim
    assert law.force(slip).x == pytest.approx(strength * (1 - (1 - np.exp(-j)) / j))
    assert law.force(slip._replace(x=0.0, y=3.0)).y < -0.9 * strength


def test_rut_memory_is_saved_restored_and_cleared():
    memory = field()
    rolled(memory, 0.04)
    state, sunk = save_memory(memory), rut_map(memory)
    rolled(memory, 0.06, y=2.0)
    assert len(rut_map(memory).x) > len(sunk.x)
    restore(memory, state)
    assert all(np.array_equal(a, b) for a, b in zip(rut_map(memory), sunk, strict=True))
    forget(memory)
    assert not len(rut_map(memory).x)
    assert not memory.cells.any()


def test_ruts_beyond_the_memory_limit_are_not_stored():
    memory = field()
    small = memory._replace(cells=memory.cells[:1])
    rolled(small, 0.04, way=3.5)
    assert small.used[0] == 1
    assert press(SOIL, REAR, small, (-3.0, -3.0, 0.0), LEVEL, 0.04, 0.0).load > 1000.0


def test_error_for_an_excessively_fine_rut_grid_names_the_key():
    with pytest.raises(
        ValueError, match=r"plant\.tyre\.cell_m: 0\.02 m is too fine for this field; set a value of at least"
    ):
        mujoco_plant(Ruts(cell_m=0.02), Flat(half_size_m=5000.0))
    assert untouched_soil((0.0, 100.0, 0.0, 50.0), 0.05).tiles.shape == (32, 63)
    assert with_soil_memory(Flat().ground(), Soil().structure().bearing).memory is FORGETS


def test_parked_tractor_sinks_into_soil_and_does_not_move():
    plant, truth = mujoco_plant(Ruts())
    depth = plant.ruts().depth.max()
    assert 0.01 < depth < 0.05
    for _ in range(40):
        later = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V))
    assert np.hypot(later.x - truth.x, later.y - truth.y) < 1e-3
    assert plant.ruts().depth.max() == pytest.approx(depth, abs=2e-4)
    assert plant.warnings() == 0


def test_run_on_soft_soil_stores_its_ruts(tmp_path):
    log = run(load_scenario("ruts", {"duration_s": 6.0}))
    write_log(log, tmp_path)
    table = pq.read_table(tmp_path / "ruts.parquet")
    assert table.schema.metadata[b"cell_m"] == b"0.05"
    assert table.num_rows == len(log.ruts.x) > 300
    assert 0.0 < np.max(table["depth"]) < 0.1
    write_log(run(load_scenario("ruts", {"duration_s": 1.0, "plant.tyre": {"kind": "soil"}})), tmp_path)
    assert not (tmp_path / "ruts.parquet").exists()
