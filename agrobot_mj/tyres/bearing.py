"""Soil with plastic sinkage: pressure and sinkage of the soil cells below a tyre.

The wheel is a shallow paraboloid with the free radius R lengthwise and the crown radius r_c across. If its lowest point
is d below the untouched ground, the wheel overlaps a cell at s ahead and l to the left of this point by

    D = d - s^2 / 2 R - l^2 / 2 r_c,

the sum of carcass deflection and soil sinkage, which have the same pressure p. With the carcass stiffness per area
kappa, the elastic stiffness K_e of the soil and its plastic sinkage z,

    p = E (D - z),  1/E = 1/kappa + 1/K_e               up to the yield pressure q of the cell;
    p = (k_c / b + k_phi) z^n = k z^n                   on untouched soil [Bekker1969]: q = p;
    dz = z_q (z / z_q)^(1 - a) / a d(p / q)             on reloaded soil, z_q = (q / k)^(1/n).

With the last equation, N equal passes cause the sinkage z_1 N^(1/a), the multipass law of [Abebe1989] with exponent a.
Without this equation, soil would remain elastic after the first load. The equation applies where p / q exceeds the
level of the cell: the maximum of p / q since the last unloading, but at most `REVERSAL` times its later minimum. Soil
is therefore elastic under a vibrating load. Slip i multiplies the plastic sinkage by (1 + i) / (1 - i / 2)
[Lyasko2010]. The force of a cell is the power conjugate of D: p dA along the normal, p dA s / R against the motion and
p dA l / r_c towards the opposite side. The work of the wheel along its path is therefore exactly the plastic work of
the soil, and the walls of a rut guide the wheel.
"""

from math import ceil, floor, sqrt
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.vectors import Vector
from agrobot_mj.terrain.memory import HARDENING, LEVEL, SINKAGE, TILE, YIELD, AnyArray, SoilMemory, tile_of

ITERATIONS = 8  # Maximum number of Newton steps for the pressure on yielding soil
NEAR = 0.05
"""Relative change of the yield pressure below which approximations are used [-].

One Newton step then has an error of 4e-4, which the next physics step corrects. The cubic polynomial that replaces the
power function has an error of 2e-6.
"""
REVERSAL = 2.0
"""Maximum pressure of elastic reloading divided by the minimum pressure since the last plastic sinkage [-]. Assumed
value: a load that decreases by less than half and increases again is not a separate pass."""
MOST_SLIP = 0.8
"""Slip above which the sinkage is constant [-], at three times the value without slip. Assumed value: published curves
end at this slip."""

Cell = tuple[int, int, int]  # Tile number of a stored cell, with its row and column in the tile


class Bearing(NamedTuple):
    """Pressure-sinkage parameters of soil."""

    k_c: float  # Cohesive modulus k_c, which is divided by the contact width [Pa/m^(n-1)]
    k_phi: float  # Frictional modulus k_phi [Pa/m^n], or 0 for firm ground
    n: float  # Exponent n of the sinkage [-]
    rebound: float  # Elastic stiffness K_e [Pa/m]
    multipass: float  # Exponent a of the multipass law [-]
    crown_share: float  # Radius of the tread crown divided by the tyre width [-]
    cell: float  # Side length of a cell [m]


FIRM = Bearing(0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0)  # Parameters of firm ground, which has no sinkage


class Tread(NamedTuple):
    """Dimensions and carcass stiffness of a tyre on soil."""

    radius: float  # Free radius R [m]
    width: float  # Section width b [m]
    crown: float  # Crown radius r_c [m]
    stiffness: float  # Carcass stiffness per area kappa [Pa/m]


class SoilCell(NamedTuple):
    """State of one soil cell under a wheel."""

    pressure: float  # Pressure [Pa]
    sinkage: float  # Plastic sinkage z [m]
    yielded: float  # Yield pressure q of the cell [Pa]
    hardened: float  # Sinkage z_q of untouched soil at this yield pressure [m]
    level: float  # Pressure divided by yield pressure up to which the cell is elastic [-]


class Pressed(NamedTuple):
    """Force of the soil on one wheel, with the contact area and the deflection of the tyre."""

    load: float  # Force along the ground normal [N]
    push: float  # Compaction resistance as a forward force at the wheel centre [N], negative in forward travel
    edge: float  # Force to the left [N], from rut walls and from sliding down into a rut
    area: float  # Contact area [m2]
    length: float  # Contact length [m]
    deflection: float  # Maximum deflection of the carcass [m]


@kernel
def load_cell(soil: Bearing, k: float, E: float, factor: float, D: float, before: SoilCell) -> SoilCell:
    """Return the state of a soil cell under a wheel at the depth `D` [m], from its state `before` in the previous step.

    `k` [Pa/m^n] and `E` [Pa/m] are the moduli of sinkage and elastic deflection; `factor` multiplies the sinkage [-].
    """
    _, z, q, z_q, level = before
    trial = E * (D - z)
    if trial <= 0.0:
        return SoilCell(0.0, z, q, z_q, 0.0)
    if trial <= level * q:
        return SoilCell(trial, z, q, z_q, min(level, REVERSAL * trial / q))
    if level < 1.0 and q > 0.0:
        c = factor * z_q / soil.multipass
        if z > z_q:
            c *= (z / z_q) ** (1.0 - soil.multipass)
        # the sinkage is linear in the level: the implicit step has a closed form
        reached = (trial + E * c * level) / (q + E * c)
        if reached <= 1.0:
            return SoilCell(reached * q, z + c * (reached - level), q, z_q, reached)
        z += c * (1.0 - level)
        trial = E * (D - z)
    p, sunk = harden(soil.n, k, E * factor, trial, q, z_q)
    return SoilCell(p, z + factor * (sunk - z_q), p, sunk, 1.0)


@kernel
def harden(n: float, k: float, E: float, trial: float, q: float, z_q: float) -> tuple[float, float]:
    """Return the yield pressure p [Pa] and sinkage z [m] for which p + E (z - z_q) = `trial` and z = (p / k)^(1/n)."""
    m, p = 1.0 / n, max(q, 1e-3 * trial)
    sunk = z_q if q > 0.0 else (p / k) ** m
    for _ in range(ITERATIONS):
        step = (trial - p - E * (sunk - z_q)) / (1.0 + E * m * sunk / p)
        p = min(max(p + step, q, 1e-3 * trial), trial)
        x = p / q - 1.0 if q > 0.0 else 1.0
        # in most steps the pressure changes little, and no power function is needed
        sunk = (
            z_q * (1.0 + m * x * (1.0 + 0.5 * (m - 1.0) * x * (1.0 + (m - 2.0) / 3.0 * x)))
            if x < NEAR
            else (p / k) ** m
        )
        if abs(step) < NEAR * p:
            break
    return p, sunk


@kernel
def hold_cell(E: float, D: float, cells: AnyArray, at: Cell) -> float:
    """Return the pressure [Pa] on a stored cell at the depth `D` [m], or -1 if the cell yields or is not yet stored."""
    tile, y, x = at
    if tile < 0:
        return -1.0
    trial, q = E * (D - cells[tile, y, x, SINKAGE]), cells[tile, y, x, YIELD]
    elastic = cells[tile, y, x, LEVEL] * q
    if trial > elastic:
        return -1.0
    if REVERSAL * trial < elastic:
        cells[tile, y, x, LEVEL] = REVERSAL * trial / q if trial > 0.0 else 0.0
    return float(max(trial, 0.0))


@kernel
def yield_cell(soil: Bearing, k: float, E: float, factor: float, D: float, cells: AnyArray, at: Cell) -> float:
    """Return the pressure [Pa] on a yielding cell and store its new state. A cell without a tile is untouched soil."""
    tile, y, x = at
    if tile < 0:
        return load_cell(soil, k, E, factor, D, SoilCell(0.0, 0.0, 0.0, 0.0, 0.0)).pressure
    before = SoilCell(
        0.0,
        cells[tile, y, x, SINKAGE],
        cells[tile, y, x, YIELD],
        cells[tile, y, x, HARDENING],
        cells[tile, y, x, LEVEL],
    )
    after = load_cell(soil, k, E, factor, D, before)
    cells[tile, y, x, LEVEL] = after.level
    if after.sinkage != before.sinkage:
        cells[tile, y, x, SINKAGE] = after.sinkage
        cells[tile, y, x, YIELD], cells[tile, y, x, HARDENING] = after.yielded, after.hardened
    return after.pressure


@kernel
def press_cell(
    soil: Bearing, k: float, E: float, factor: float, D: float, memory: SoilMemory, row: int, column: int
) -> float:
    """Press the soil cell at `row` and `column` of the soil memory to the depth `D` [m]; return its pressure [Pa]."""
    at = (tile_of(memory, row // TILE, column // TILE), row % TILE, column % TILE)
    pressure = hold_cell(E, D, memory.cells, at)
    return pressure if pressure >= 0.0 else yield_cell(soil, k, E, factor, D, memory.cells, at)


@kernel
def window(middle: float, reach: float, cells: int) -> tuple[int, int]:
    """Return the first index and last index + 1 of the cells within `reach` of `middle` along an axis [cell widths]."""
    return max(ceil(middle - reach - 0.5), 0), min(floor(middle + reach - 0.5) + 1, cells)


@kernel
def press(
    soil: Bearing,
    tread: Tread,
    memory: SoilMemory,
    place: Vector,
    frame: tuple[Vector, Vector, Vector],
    d: float,
    slip: float,
) -> Pressed:
    """Press a wheel `d` [m] deep into the soil, update the soil cells, and return the force of the soil on the wheel.

    `place` is the point of the untouched ground above the lowest point of the wheel. `frame` contains the ground normal
    and the forward and left vectors in world axes. `slip` is relative to the faster of rim and ground [-].
    """
    n, f, left = frame
    c, half, i = memory.cell, 0.5 * tread.width, min(slip, MOST_SLIP)
    k, E = soil.k_c / tread.width + soil.k_phi, 1.0 / (1.0 / tread.stiffness + 1.0 / soil.rebound)
    factor = (1.0 + i) / (1.0 - 0.5 * i)
    # distances in the ground plane from distances on the map
    s_x, s_y = f[0] - f[2] * n[0] / n[2], f[1] - f[2] * n[1] / n[2]
    l_x, l_y = left[0] - left[2] * n[0] / n[2], left[1] - left[2] * n[1] / n[2]
    a, b = sqrt(2.0 * tread.radius * d), min(sqrt(2.0 * tread.crown * d), half + c)
    u, v = (place[0] - memory.x0) / c, (place[1] - memory.y0) / c
    columns = window(u, (abs(f[0]) * a + abs(left[0]) * b) / c, memory.tiles.shape[1] * TILE)
    rows = window(v, (abs(f[1]) * a + abs(left[1]) * b) / c, memory.tiles.shape[0] * TILE)
    bend_s, bend_l, per_cell = 1.0 / tread.radius, 1.0 / tread.crown, 1.0 / c
    load, push, edge, area, most = 0.0, 0.0, 0.0, 0.0, 0.0
    for row in range(rows[0], rows[1]):
        dy = (row + 0.5 - v) * c
        for column in range(columns[0], columns[1]):
            dx = (column + 0.5 - u) * c
            s, l = s_x * dx + s_y * dy, l_x * dx + l_y * dy  # noqa: E741
            D = d - 0.5 * (bend_s * s * s + bend_l * l * l)
            # a cell at the edge of the tread is weighted with its covered fraction
            cover = min(0.5 + (half - abs(l)) * per_cell, 1.0)
            if D <= 0.0 or cover <= 0.0:
                continue
            pressure = press_cell(soil, k, E, factor, D, memory, row, column)
            if pressure > 0.0:
                force = pressure * cover
                load += force
                push -= force * s * bend_s
                edge -= force * l * bend_l
                area += cover
                most = max(most, pressure)
    cell = c * c / n[2]
    length = area * cell / min(2.0 * b, tread.width)
    return Pressed(load * cell, push * cell, edge * cell, area * cell, length, most / tread.stiffness)
