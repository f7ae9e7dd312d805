"""Soil below a wheel: closed forms for one soil cell, and a wheel as the sum of all cells."""

import numpy as np
import pytest

from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain.grid import plane
from agrobot_mj.terrain.memory import HARDENING, LEVEL, SINKAGE, TILE, VALUES, YIELD, rut_map
from agrobot_mj.tyres import Ruts
from agrobot_mj.tyres.bearing import NEAR, SoilCell, harden, hold_cell, load_cell, press, yield_cell
from agrobot_mj.tyres.laws import treads, with_soil_memory

SOIL = Ruts().structure().bearing
REAR = treads(SOIL, TractorParameters())[1]
FRESH = SoilCell(0.0, 0.0, 0.0, 0.0, 0.0)
K, E = SOIL.k_c / REAR.width + SOIL.k_phi, 1.0 / (1.0 / REAR.stiffness + 1.0 / SOIL.rebound)


# --- one cell ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [0.5, 1.1, 1.5])
@pytest.mark.parametrize("trial", [1e4, 1e5, 2e6])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_yield_pressure_is_in_equilibrium_with_carcass_and_soil(n, trial, share):
    """For untouched soil and for a previous yield pressure, p + E (z(p) - z_q) equals the trial pressure."""
    q = share * trial
    z_q = (q / K) ** (1 / n)
    p, sunk = harden(n, K, E, trial, q, z_q)
    assert sunk == pytest.approx((p / K) ** (1 / n), rel=1e-5)
    assert p + E * (sunk - z_q) == pytest.approx(trial, rel=2 * NEAR**2)
    assert q <= p <= trial


def test_yielded_soil_is_elastic_below_its_yield_pressure():
    cells = np.zeros((3, TILE, TILE, VALUES))
    cells[1, 2, 3, [SINKAGE, YIELD, HARDENING, LEVEL]] = 0.02, 5e4, 0.02, 1.0
    at = (1, 2, 3)
    for share, level in ((0.9, 1.0), (0.6, 1.0), (0.4, 0.8), (0.7, 0.8)):
        assert hold_cell(E, 0.02 + share * 5e4 / E, cells, at) == pytest.approx(share * 5e4)
        assert cells[1, 2, 3, LEVEL] == pytest.approx(level)
    assert hold_cell(E, 0.02 + 0.85 * 5e4 / E, cells, at) == -1.0  # above twice what it was unloaded to: it yields
    assert hold_cell(E, 0.015, cells, at) == 0.0
    assert cells[1, 2, 3, LEVEL] == 0.0
    assert hold_cell(E, 0.03, cells, (-1, 2, 3)) == -1.0
    assert np.count_nonzero(cells) == 3


@pytest.mark.parametrize(("least", "more"), [(0.9, False), (0.6, False), (0.3, True), (0.0, True)])
def test_load_oscillation_by_less_than_half_is_not_counted_as_a_pass(least, more):
    """The load oscillates a hundred times between a fraction of the yield pressure and this pressure."""
    cell = load_cell(SOIL, K, E, 1.0, 0.02, FRESH)
    first = cell.sinkage
    for _ in range(100):
        for share in (least, 1.0):
            cell = load_cell(SOIL, K, E, 1.0, cell.sinkage + share * cell.yielded / E, cell)
            while share == 1.0 and cell.pressure < 0.999 * cell.yielded:
                cell = load_cell(SOIL, K, E, 1.0, cell.sinkage + cell.yielded / E, cell)
    assert cell.sinkage == pytest.approx(first, rel=1e-3) if not more else cell.sinkage > 2.0 * first
    if least == 0.0:
        assert cell.sinkage / first == pytest.approx(101 ** (1 / SOIL.multipass), rel=0.02)


def test_soil_cell_in_a_tile_array_yields_like_a_separate_soil_cell():
    """The cell is loaded, unloaded and loaded again, each time from its previous state."""
    cells, at, cell = np.zeros((3, TILE, TILE, VALUES)), (2, 5, 7), FRESH
    for depth in (0.01, 0.02, 0.012, 0.021, 0.03):
        cell = load_cell(SOIL, K, E, 1.2, depth, cell)
        assert yield_cell(SOIL, K, E, 1.2, depth, cells, at) == pytest.approx(cell.pressure)
        kept = cells[2, 5, 7, [SINKAGE, YIELD, HARDENING, LEVEL]]
        assert kept == pytest.approx((cell.sinkage, cell.yielded, cell.hardened, cell.level))
    assert np.count_nonzero(cells) == np.count_nonzero(cells[2, 5, 7])
    fresh = load_cell(SOIL, K, E, 1.2, 0.03, FRESH).pressure
    assert yield_cell(SOIL, K, E, 1.2, 0.03, cells, (-1, 0, 0)) == fresh


# --- a wheel ----------------------------------------------------------------------------------------------------------


def frame(slope_x, slope_y, yaw):
    """Return normal, forward and left directions on a plane with given slopes."""
    n = np.array([-slope_x, -slope_y, 1.0]) / np.sqrt(1.0 + slope_x**2 + slope_y**2)
    forward = np.cross([-np.sin(yaw), np.cos(yaw), 0.0], n)
    forward /= np.linalg.norm(forward)
    return tuple(n), tuple(forward), tuple(np.cross(n, forward))


@pytest.mark.parametrize("slip", [0.0, 0.4, 2.0])
@pytest.mark.parametrize(("slopes", "yaw"), [((0.0, 0.0), 0.0), ((0.0, 0.0), 0.7), ((0.3, -0.2), -2.1)])
def test_soil_force_on_a_tyre_is_the_sum_over_all_ground_cells(slopes, yaw, slip):
    """The sum includes all cells of the ground plane under the tread, for any slope and heading."""
    memory, d, c, R, r_c = with_soil_memory(plane(0.0, 0.0, 2.0), SOIL).memory, 0.03, SOIL.cell, REAR.radius, REAR.crown
    n, forward, left = frame(*slopes, yaw)
    place = np.array([0.137, -0.412, slopes[0] * 0.137 - slopes[1] * 0.412])
    rows, columns = TILE * np.array(memory.tiles.shape)
    x, y = np.meshgrid(memory.x0 + c * (np.arange(columns) + 0.5), memory.y0 + c * (np.arange(rows) + 0.5))
    away = np.stack([x, y, slopes[0] * x + slopes[1] * y], axis=-1) - place
    s, l = away @ forward, away @ left  # noqa: E741
    depth, half, i = d - s**2 / (2 * R) - l**2 / (2 * r_c), REAR.width / 2, min(slip, 0.8)
    cover = np.clip(0.5 + (half - np.abs(l)) / c, 0.0, 1.0)
    touched = (depth > 0) & (cover > 0)
    pressure, factor = np.zeros(x.shape), (1 + i) / (1 - i / 2)
    pressure[touched] = [load_cell(SOIL, K, E, factor, D, FRESH).pressure for D in depth[touched]]
    force, area = pressure * cover * c**2 / n[2], (cover * touched).sum() * c**2 / n[2]
    found = press(SOIL, REAR, memory, tuple(place), (n, forward, left), d, slip)
    wide = min(2 * np.sqrt(2 * r_c * d), REAR.width)
    sums = (force.sum(), -(force * s).sum() / R, -(force * l).sum() / r_c, area, area / wide)
    assert touched.sum() > 12
    assert found[:5] == pytest.approx(sums, rel=1e-9, abs=1e-6)
    assert found.deflection == pytest.approx(pressure.max() / REAR.stiffness)
    map_ = rut_map(memory)
    assert len(map_.depth) == touched.sum()
    assert (map_.x.mean(), map_.y.mean()) == pytest.approx((x[touched].mean(), y[touched].mean()))
