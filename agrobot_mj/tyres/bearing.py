"""Soil that carries a wheel, yields below it and remembers: pressure-sinkage of the cells below a tyre.

The wheel is a shallow paraboloid with the free radius R lengthwise and the crown's radius r_c across. A cell at s ahead
and l to the left of its lowest point, d below the untouched ground, lies under a depth

    D = d - s^2 / 2 R - l^2 / 2 r_c,

which the carcass' deflection and the soil's sinkage share: both see the same pressure p. With kappa the carcass'
stiffness per area, K_e the soil's rebound and z its plastic sinkage,

    p = E (D - z),  1/E = 1/kappa + 1/K_e               up to the yield pressure q of the cell;
    p = (k_c / b + k_phi) z^n = k z^n                   on untouched soil [Bekker1969]: q goes with p;
    dz = z_q (z / z_q)^(1 - a) / a d(p / q)             on soil that is loaded again, z_q = (q / k)^(1/n).

The last line makes the sinkage of N equal passes z_1 N^(1/a), the multipass law of [Abebe1989]; without it soil that
was loaded once would be elastic ever after. Slip i multiplies the plastic sinkage by (1 + i) / (1 - i / 2)
[Lyasko2010]. The force of a cell is the power conjugate of D: p dA along the normal, p dA s / R against the way and
p dA l / r_c away from its side. So the work that the wheel does along its way is the soil's plastic work exactly, and
the walls of a rut hold the wheel.
"""

from math import ceil, floor, sqrt
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.vectors import Vector
from agrobot_mj.terrain.memory import LEVEL, SINKAGE, TILE, YIELD, SoilMemory, tile_of

ITERATIONS = 4
"""Newton steps for the pressure on yielding soil; in each physics step it moves by little [-]."""
MOST_SLIP = 0.8
"""Slip beyond which slip sinkage does not grow: three times that without slip [-]. Estimate: the printed curves end
there."""


class Bearing(NamedTuple):
    """How soil carries a pressure."""

    k_c: float
    """Cohesive modulus, divided by the contact's width [Pa/m^(n-1)]."""
    k_phi: float
    """Frictional modulus; 0 for firm ground [Pa/m^n]."""
    n: float
    """Exponent of sinkage [-]."""
    rebound: float
    """Elastic stiffness K_e [Pa/m]."""
    multipass: float
    """Exponent a of the multipass law [-]."""
    crown_share: float
    """Radius of the tread's crown over the tyre's width [-]."""
    cell: float
    """Side of a cell [m]."""


FIRM = Bearing(0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0)
"""Ground that does not sink."""


class Tread(NamedTuple):
    """One tyre as the soil sees it."""

    radius: float
    """Free radius R [m]."""
    width: float
    """Section width b [m]."""
    crown: float
    """Radius of the crown r_c [m]."""
    stiffness: float
    """Stiffness of the carcass per area kappa [Pa/m]."""


class Cell(NamedTuple):
    """State of one cell of soil under a pressure."""

    pressure: float
    """Pressure [Pa]."""
    sinkage: float
    """Plastic sinkage z [m]."""
    yielded: float
    """Yield pressure q [Pa]."""
    level: float
    """Pressure over yield pressure [-]."""


class Pressed(NamedTuple):
    """What the soil under one wheel does to it."""

    load: float
    """Force along the normal [N]."""
    push: float
    """Force forward on the wheel's centre: the resistance to compaction, negative in forward travel [N]."""
    edge: float
    """Force to the left, of a rut's walls and of a wheel that slides down into one [N]."""
    area: float
    """Contact area [m2]."""
    length: float
    """Contact length [m]."""
    deflection: float
    """Largest deflection of the carcass [m]."""


@kernel
def load_cell(soil: Bearing, k: float, E: float, slip_factor: float, D: float, before: Cell) -> Cell:
    """A cell under a depth `D` [m] of wheel, from its state in the step before; `k` [Pa/m^n], `E` [Pa/m]."""
    z, q, level = before.sinkage, before.yielded, before.level
    trial = E * (D - z)
    if trial <= 0.0:
        return Cell(0.0, z, q, 0.0)
    if trial <= level * q:
        return Cell(trial, z, q, trial / q)
    z_q = 0.0
    if q > 0.0:
        z_q = (q / k) ** (1.0 / soil.n)
        # linear in the level, so that the implicit step has a closed form
        c = slip_factor * z_q * (max(z, z_q) / z_q) ** (1.0 - soil.multipass) / soil.multipass
        reached = (trial + E * c * level) / (q + E * c)
        if reached <= 1.0:
            return Cell(reached * q, z + c * (reached - level), q, reached)
        z += c * (1.0 - level)
        trial = E * (D - z)
    # g(p) = p + E f ((p/k)^(1/n) - z_q) - trial = 0 between q and trial
    p, m = (trial if soil.n <= 1.0 or q <= 0.0 else q), 1.0 / soil.n
    for _ in range(ITERATIONS):
        sunk = (p / k) ** m
        g = p + E * slip_factor * (sunk - z_q) - trial
        p = min(max(p - g / (1.0 + E * slip_factor * m * sunk / p), q, 1e-3 * trial), trial)
    return Cell(p, D - p / E, p, 1.0)


@kernel
def read_cell(memory: SoilMemory, row: int, column: int) -> Cell:
    """State of a cell of the grid; untouched where the store of tiles is used up."""
    tile = tile_of(memory, row // TILE, column // TILE)
    if tile < 0:
        return Cell(0.0, 0.0, 0.0, 0.0)
    y, x, cells = row % TILE, column % TILE, memory.cells
    return Cell(
        0.0, cells[tile, y, x, SINKAGE], cells[tile, y, x, YIELD], cells[tile, y, x, LEVEL]
    )


@kernel
def write_cell(memory: SoilMemory, row: int, column: int, cell: Cell) -> None:
    """Let the soil remember a cell."""
    tile = memory.tiles[row // TILE, column // TILE]
    if tile >= 0:
        y, x, cells = row % TILE, column % TILE, memory.cells
        cells[tile, y, x, SINKAGE] = cell.sinkage
        cells[tile, y, x, YIELD] = cell.yielded
        cells[tile, y, x, LEVEL] = cell.level


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
    """Press a wheel `d` [m] deep into the soil and let it yield.

    `place` is the point of the untouched ground above the wheel's lowest one, `frame` the ground's normal, forward and
    left, in the world's axes; `slip` is that of the faster of rim and ground [-].
    """
    n, f, left = frame
    R, r_c, c = tread.radius, tread.crown, memory.cell
    k = soil.k_c / tread.width + soil.k_phi
    E = 1.0 / (1.0 / tread.stiffness + 1.0 / soil.rebound)
    i = min(slip, MOST_SLIP)
    slip_factor = (1.0 + i) / (1.0 - 0.5 * i)
    # distances along the ground's plane from those on the map
    s_x, s_y = f[0] - f[2] * n[0] / n[2], f[1] - f[2] * n[1] / n[2]
    l_x, l_y = left[0] - left[2] * n[0] / n[2], left[1] - left[2] * n[1] / n[2]
    half = 0.5 * tread.width
    a, b = sqrt(2.0 * R * d), min(sqrt(2.0 * r_c * d), half + c)
    reach_x, reach_y = abs(f[0]) * a + abs(left[0]) * b, abs(f[1]) * a + abs(left[1]) * b
    u, v = (place[0] - memory.x0) / c, (place[1] - memory.y0) / c
    first_i = max(int(ceil(u - reach_x / c - 0.5)), 0)
    last_i = min(int(floor(u + reach_x / c - 0.5)), memory.tiles.shape[1] * TILE - 1)
    first_j = max(int(ceil(v - reach_y / c - 0.5)), 0)
    last_j = min(int(floor(v + reach_y / c - 0.5)), memory.tiles.shape[0] * TILE - 1)
    cell_area = c * c / n[2]
    load, push, edge, area, most = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(first_j, last_j + 1):
        dy = (j + 0.5 - v) * c
        for column in range(first_i, last_i + 1):
            dx = (column + 0.5 - u) * c
            s, l = s_x * dx + s_y * dy, l_x * dx + l_y * dy  # noqa: E741
            D = d - 0.5 * s * s / R - 0.5 * l * l / r_c
            # a cell at the edge of the tread counts with the part of it that is covered
            cover = min(0.5 + (half - abs(l)) / c, 1.0)
            if D <= 0.0 or cover <= 0.0:
                continue
            cell = load_cell(soil, k, E, slip_factor, D, read_cell(memory, j, column))
            write_cell(memory, j, column, cell)
            if cell.pressure <= 0.0:
                continue
            covered = cover * cell_area
            force = cell.pressure * covered
            load += force
            push -= force * s / R
            edge -= force * l / r_c
            area += covered
            most = max(most, cell.pressure)
    deflection = most / tread.stiffness
    return Pressed(load, push, edge, area, area / min(2.0 * b, tread.width), deflection)
