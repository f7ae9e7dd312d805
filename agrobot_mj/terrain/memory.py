"""Soil memory: a grid of plastic sinkage, finer than the height grid and stored in square tiles.

The memory has a fixed number of tiles. A tile is allocated when a wheel first deforms its soil, so that the memory
usage grows with the area driven on, not with the distance or the number of passes. When all tiles are allocated, no new
ruts are recorded.
"""

from math import ceil
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array

TILE = 32  # Number of cells along the side of a tile
MOST_TILES = 8192
"""Maximum number of tiles. With cells of 5 cm a tile is 1.6 m wide; all tiles together cover 2 ha and use 270 MB."""
MOST_PLACES = 16_000_000  # Maximum number of tile positions on a field, which use 64 MB
SINKAGE, YIELD, HARDENING, LEVEL = range(VALUES := 4)
"""Indices of the numbers stored for a soil cell: plastic sinkage [m], yield pressure [Pa], sinkage of untouched soil at
the yield pressure [m], and fraction of the yield pressure up to which the cell is elastic [-]."""
AnyArray = np.ndarray[Any, Any]


class SoilMemory(NamedTuple):
    """Grid of soil cells in tiles, with the south-west corner at (x0, y0). Wheels modify the arrays."""

    x0: float  # West edge [m]
    y0: float  # South edge [m]
    cell: float  # Side length of a cell [m]
    tiles: AnyArray  # Index of each tile in `cells`, or -1 for untouched ground, int32 of shape (rows, columns)
    cells: AnyArray  # Numbers of each cell (see `SINKAGE`), float64 of shape (tiles, TILE, TILE, VALUES)
    used: AnyArray  # Number of tiles in use, int64 of shape (1,)


FORGETS = SoilMemory(
    0.0, 0.0, 1.0, np.empty((0, 0), np.int32), np.empty((0, TILE, TILE, VALUES), np.float64), np.zeros(1, np.int64)
)
"""Soil memory of firm ground, which has no tiles and records no ruts."""


class SavedSoil(NamedTuple):
    """Copy of a soil memory without its unused tiles."""

    places: AnyArray  # Row and column of each tile, int32 of shape (n, 2), in the order of `cells`
    cells: AnyArray  # Numbers of each cell (see `SINKAGE`), float64 of shape (n, TILE, TILE, VALUES)


class RutMap(NamedTuple):
    """Ruts on a field: position and depth of each cell with plastic sinkage."""

    cell: float  # Side length of a cell [m]
    x: Array  # East coordinates of the cell centres [m], shape (n,)
    y: Array  # North coordinates of the cell centres [m], shape (n,)
    depth: Array  # Plastic sinkage [m], shape (n,)


def untouched_soil(extent: tuple[float, float, float, float], cell: float) -> SoilMemory:
    """Return a soil memory without ruts for a field (x_min, x_max, y_min, y_max) [m].

    Raises ValueError if the cell size `cell` [m] is too small for the size of the field.
    """
    x_min, x_max, y_min, y_max = extent
    columns, rows = (max(1, ceil(side / (TILE * cell))) for side in (x_max - x_min, y_max - y_min))
    if rows * columns > MOST_PLACES:
        least = cell * (rows * columns / MOST_PLACES) ** 0.5
        raise ValueError(f"cell_m: {cell:g} m is too fine for this field; set a value of at least {1.05 * least:.2g}")
    store = min(MOST_TILES, rows * columns)
    return SoilMemory(
        x_min,
        y_min,
        cell,
        np.full((rows, columns), -1, np.int32),
        np.zeros((store, TILE, TILE, VALUES), np.float64),  # the system allocates a page on the first write
        np.zeros(1, np.int64),
    )


@kernel
def tile_of(memory: SoilMemory, row: int, column: int) -> int:
    """Return the index in `memory.cells` of a tile, which is allocated if needed, or -1 if all tiles are in use."""
    number = memory.tiles[row, column]
    if number < 0 and memory.used[0] < memory.cells.shape[0]:
        number = memory.used[0]
        memory.tiles[row, column] = number
        memory.used[0] = number + 1
    return int(number)


def _places(memory: SoilMemory) -> AnyArray:
    found = np.argwhere(memory.tiles >= 0)
    ordered: AnyArray = found[np.argsort(memory.tiles[tuple(found.T)])].astype(np.int32)
    return ordered


def forget(memory: SoilMemory) -> None:
    """Remove all ruts from a soil memory."""
    memory.cells[: memory.used[0]] = 0.0
    memory.tiles[:] = -1
    memory.used[0] = 0


def save_memory(memory: SoilMemory) -> SavedSoil:
    """Return a copy of a soil memory, which `restore` can load again."""
    return SavedSoil(_places(memory), memory.cells[: memory.used[0]].copy())


def restore(memory: SoilMemory, state: SavedSoil) -> None:
    """Replace the contents of a soil memory with the saved copy `state`."""
    forget(memory)
    count = len(state.places)
    memory.tiles[tuple(state.places.T)] = np.arange(count, dtype=np.int32)
    memory.cells[:count] = state.cells
    memory.used[0] = count


def rut_map(memory: SoilMemory) -> RutMap:
    """Return the positions and depths of all cells with plastic sinkage in a soil memory."""
    places, cells = _places(memory), memory.cells[: memory.used[0]]
    k, j, i = np.nonzero(cells[..., SINKAGE])
    x = memory.x0 + memory.cell * (TILE * places[k, 1] + i + 0.5)
    y = memory.y0 + memory.cell * (TILE * places[k, 0] + j + 0.5)
    return RutMap(memory.cell, x, y, cells[k, j, i, SINKAGE])
