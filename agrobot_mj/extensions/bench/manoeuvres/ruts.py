"""Ruts in soil

A plate is pressed into a cell of soil, unloaded and pressed again. At the sinkage z, the pressure of a plate of width b
must be Bekker's p = k z^n with k = k_c / b + k_phi [Bekker1969], where k_c, k_phi and n are constants of the soil.
After N loadings to equal pressure, the sinkage must be z_1 N^(1/a), with the sinkage z_1 of one loading and the
exponent a of the soil [Abebe1989]. Then a rear wheel with its static load is towed over untouched soil, repeatedly
along the same track. A rigid wheel with a flat tread has the motion resistance R = b k z^(n+1) / (n+1), with the rut
depth z. Below a tyre with a crown, each strip of the rut has a different depth. The work of compaction must equal the
resistance multiplied by the distance. At equal load instead of equal pressure, a wheel sinks slightly deeper than
N^(1/a) predicts. The second pass must add 10 to 50 % of the first sinkage, with less work. Ten passes must use as many
tiles of the soil memory as one pass.
"""

from collections.abc import Iterator
from math import sqrt
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.grid import plane
from agrobot_mj.terrain.memory import RutMap, SoilMemory, rut_map
from agrobot_mj.tyres import Ruts
from agrobot_mj.tyres.bearing import Bearing, SoilCell, Tread, load_cell, press
from agrobot_mj.tyres.laws import treads, with_soil_memory

TRACTOR = TractorParameters()
LOAD_N = TRACTOR.rear_axle_load / 2
SOILS = {
    "sandy loam": Ruts(),
    "dry sand": Ruts(k_c_kn=0.99, k_phi_kn=1528.0, exponent=1.1, cohesion_kpa=1.04, friction_deg=28.0),
    "clayey soil": Ruts(k_c_kn=13.19, k_phi_kn=692.0, exponent=0.5, cohesion_kpa=4.14, friction_deg=13.0),
}
"""Soil parameters of [Wong2008]. Parameters without a published value are assumed values."""
WAY_M, STEP_M, DT_S = 3.0, 0.0024, 0.002
"""Length of a pass [m], distance per time step [m] and duration of a time step [s], for 1.2 m/s."""
HEADING = 0.3  # Heading of the wheel, oblique to the cell grid of the soil memory [rad]
BAND, CLOSED = 0.02, 0.005
"""Acceptance limits of the wheel resistance, and of deviations from the closed-form solutions for a plate
[relative]."""
PASSES = 10


class Pass(NamedTuple):
    """Results of one pass of a wheel over the soil, evaluated in the middle third of its length."""

    resistance: float  # Mean motion resistance [N]
    depth: float  # Depth at the centre of the rut [m]
    work: float  # Work of compacting all cells to their depths by Bekker's law, divided by the length [N]
    tiles: int  # Number of tiles of the soil memory in use


@jit
def tow(soil: Bearing, tread: Tread, memory: SoilMemory, load: float, frame: Array, out: Array) -> None:
    """Tow a wheel from the origin in the direction `frame[1]` (3,). Write its resistance at each step to `out` [N]."""
    n, f, left = frame
    vectors = ((n[0], n[1], n[2]), (f[0], f[1], f[2]), (left[0], left[1], left[2]))
    mass, depth, sinking = load / 9.81, 0.01, 0.0
    for k in range(out.size):
        way = k * STEP_M
        pressed = press(soil, tread, memory, (way * f[0], way * f[1], 0.0), vectors, max(depth, 1e-6), 0.0)
        out[k] = -pressed.push
        # half of critical damping for the stiffness of a tyre on firm soil
        sinking += DT_S * (9.81 - (pressed.load + sqrt(3e5 * mass) * sinking) / mass)
        depth += DT_S * sinking


def passes(tyre: Ruts, count: int, tread: Tread | None = None) -> list[Pass]:
    """Return the results of `count` passes of a rear wheel along the same track."""
    soil = tyre.structure().bearing
    tread = tread or treads(soil, TRACTOR)[1]
    ground: Ground = with_soil_memory(plane(0.0, 0.0, 2 * WAY_M), soil)
    c, s = np.cos(HEADING), np.sin(HEADING)
    frame = np.array([[0.0, 0.0, 1.0], [c, s, 0.0], [-s, c, 0.0]])
    found, out = [], np.zeros(round(WAY_M / STEP_M))
    for _ in range(count):
        tow(soil, tread, ground.memory, LOAD_N, frame, out)
        ruts = rut_map(ground.memory)
        third = slice(out.size // 3, 2 * out.size // 3)
        used = int(ground.memory.used[0])
        found.append(Pass(float(out[third].mean()), *_rut(ruts, soil, tread.width), used))
    return found


def _rut(ruts: RutMap, soil: Bearing, width: float) -> tuple[float, float]:
    """Return the depth at the centre of the rut [m], and the work of compaction per unit length [N]."""
    along = ruts.x * np.cos(HEADING) + ruts.y * np.sin(HEADING)
    aside = np.abs(ruts.y * np.cos(HEADING) - ruts.x * np.sin(HEADING))
    here = (along > WAY_M / 3) & (along < 2 * WAY_M / 3)
    covered = np.clip(0.5 + (width / 2 - aside) / ruts.cell, 0.0, 1.0)
    k = soil.k_c / width + soil.k_phi
    work = k * ruts.depth ** (soil.n + 1) / (soil.n + 1) * covered * ruts.cell**2
    middle = here & (aside < ruts.cell)
    return float(ruts.depth[middle].mean()), float(work[here].sum() / (WAY_M / 3))


def plate(m: Trial, tyre: Ruts) -> Iterator[Check]:
    """Yield checks of a plate on soil: pressure versus plastic sinkage, rebound stiffness, and repeated loading."""
    soil, b = tyre.structure().bearing, 0.2
    k = soil.k_c / b + soil.k_phi
    cell = SoilCell(0.0, 0.0, 0.0, 0.0, 0.0)
    for aim in (0.01, 0.03):
        while cell.sinkage < aim:
            depth = cell.sinkage + cell.pressure / soil.rebound + 2e-4
            cell = load_cell(soil, k, soil.rebound, 1.0, depth, cell)
        about = m.about(f"pressure of a plate {1e3 * aim:g} mm deep", tyre.kind, "kPa")
        yield about.near(1e-3 * cell.pressure, 1e-3 * k * cell.sinkage**soil.n, CLOSED)
    depth = cell.sinkage + 0.5 * cell.pressure / soil.rebound
    back = load_cell(soil, k, soil.rebound, 1.0, depth, cell)
    stiffness = (cell.pressure - back.pressure) / (0.5 * cell.pressure / soil.rebound)
    yield m.about("rebound of a plate", tyre.kind, "MPa/m").near(1e-6 * stiffness, tyre.rebound_mpa_m, CLOSED)
    for count in (2, 3, 10):
        about = m.about(f"sinkage of a plate after {count} equal loadings divided by the sinkage after one", tyre.kind)
        yield about.near(repeated_sinkage_ratio(soil, k, count), count ** (1 / soil.multipass), CLOSED)


def repeated_sinkage_ratio(soil: Bearing, k: float, count: int) -> float:
    """Return the plastic sinkage of a plate after `count` loadings to 100 kPa, divided by the sinkage after one loading
    [-]."""
    cell, depth, sunk = SoilCell(0.0, 0.0, 0.0, 0.0, 0.0), 0.0, []
    for _ in range(count):
        while cell.pressure < 1e5:
            depth += 1e-5
            cell = load_cell(soil, k, soil.rebound, 1.0, depth, cell)
        sunk.append(cell.sinkage)
        depth = cell.sinkage
        cell = load_cell(soil, k, soil.rebound, 1.0, depth, cell)
    return sunk[-1] / sunk[0]


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of plate, towed wheel and repeated passes on several soils. Quick mode tests only one soil."""
    yield from plate(m, Ruts())
    for name, tyre in list(SOILS.items())[: 1 if m.quick else None]:
        soil, width = tyre.structure().bearing, TRACTOR.rear_wheel_width_m
        k, n = soil.k_c / width + soil.k_phi, soil.n
        (rigid,) = passes(tyre, 1, Tread(TRACTOR.rear_wheel_radius_m, width, 1e3, 1e12))
        found = passes(tyre, PASSES if name == "sandy loam" else 3)
        first, second, third = found[:3]
        about = m.about(f"resistance of a rigid wheel, {name}", "ruts", "N")
        yield about.near(rigid.resistance, width * k * rigid.depth ** (n + 1) / (n + 1), BAND)
        about = m.about(f"resistance of a tyre against the work of compaction, {name}", "ruts", "N")
        yield about.near(first.resistance, first.work, BAND)
        yield m.about(f"resistance divided by load, first pass, {name}", "ruts").reported(first.resistance / LOAD_N)
        about = m.about(f"sinkage added by the second pass, relative to the first pass, {name}", "ruts", "%")
        yield about.between(100 * (second.depth / first.depth - 1), 10.0, 50.0)
        about = m.about(f"work of the second pass divided by the work of the first pass, {name}", "ruts")
        yield about.between(second.resistance / first.resistance, 0.0, 1.0)
        for count, one in ((2, second), (3, third)):
            about = m.about(f"depth after {count} passes divided by the depth after one, equal load, {name}", "ruts")
            yield about.reported(one.depth / first.depth, count ** (1 / soil.multipass))
        if len(found) == PASSES:
            yield m.about(f"tiles taken by passes 2 to {PASSES}", "ruts").none(found[-1].tiles - first.tiles)
