"""Patches of ground with a separate friction or soil, rasterised into one grid of uniform cells."""

from math import ceil
from typing import Annotated

import numpy as np
from pydantic import Field

from agrobot_mj.terrain.grid import Surface, rounded_up
from agrobot_mj.terrain.shapes import Bounds, CirclePatch, PicturePatch, PolygonPatch, RectanglePatch, Special

MOST_CELLS = 4_000_000
"""Maximum number of cells in the grid of properties: 64 MB."""
MOST_TESTS = 2e8
"""Maximum number of cells to fill, summed over all patches [-]: several seconds."""

GroundPatch = Annotated[RectanglePatch | CirclePatch | PolygonPatch | PicturePatch, Field(discriminator="kind")]


def surface(patches: tuple[Special, ...], extent: Bounds) -> Surface:
    """Return the grid of ground properties for `patches` on a field [m]. Raises ValueError naming the key."""
    boxes = [_inside(k, patch, extent) for k, patch in enumerate(patches)]
    low_x, low_y = min(box[0] for box in boxes), min(box[2] for box in boxes)
    width, height = max(box[1] for box in boxes) - low_x, max(box[3] for box in boxes) - low_y
    cell = min(patch.cell_m for patch in patches)
    rows, columns = ceil(height / cell), ceil(width / cell)
    if rows * columns > MOST_CELLS:
        raise ValueError(
            f"patch: {rows} x {columns} cells are more than {MOST_CELLS}; make cell_m larger, e.g. "
            f"{_coarse_enough(cell, width, height):g}"
        )
    x, y = low_x + cell * (np.arange(columns) + 0.5), low_y + cell * (np.arange(rows) + 0.5)
    tests = sum((box[1] - box[0]) * (box[3] - box[2]) for box in boxes) / cell**2
    if tests > MOST_TESTS:
        raise ValueError(
            f"patch: {len(patches)} patches overlap so much that {tests:.2g} cells must be filled, at most "
            f"{MOST_TESTS:.2g}; increase cell_m above {cell:g}, or use fewer patches"
        )
    friction, cone_index = np.ones((rows, columns)), np.zeros((rows, columns))
    for k, (patch, box) in enumerate(zip(patches, boxes, strict=True)):
        window = _window(low_y, box[2:], cell), _window(low_x, box[:2], cell)
        grid = np.meshgrid(x[window[1]], y[window[0]], sparse=True)
        covered = patch.covers(*grid)
        if not covered.any():
            raise ValueError(f"patch[{k}]: covers no cell of {cell:g} m; make it larger or cell_m smaller")
        found = patch.properties(*(along[covered] for along in np.broadcast_arrays(*grid)))
        friction[window][covered], cone_index[window][covered] = found
    return Surface(low_x, low_y, cell, friction, cone_index)


def _window(first: float, between: tuple[float, ...], cell: float) -> slice:
    """Return the slice of the cells in the interval `between` [m], padded by one cell; the first cell is at `first`
    [m]."""
    low, high = between
    return slice(max(0, int((low - first) / cell) - 1), int((high - first) / cell) + 2)


def _coarse_enough(cell: float, width: float, height: float) -> float:
    """Return the size of the smallest cells for which the grid is small enough [m]."""
    while ceil(height / cell) * ceil(width / cell) > MOST_CELLS:
        cell = rounded_up(1.05 * cell)
    return cell


def _inside(k: int, patch: Special, extent: Bounds) -> Bounds:
    try:
        box = patch.bounds()
    except ValueError as error:
        raise ValueError(f"patch[{k}].{error}") from None
    x_min, x_max = max(box[0], extent[0]), min(box[1], extent[1])
    y_min, y_max = max(box[2], extent[2]), min(box[3], extent[3])
    if x_min >= x_max or y_min >= y_max:
        raise ValueError(
            f"patch[{k}]: lies outside the field ({extent[0]:g} to {extent[1]:g} m east, {extent[2]:g} to "
            f"{extent[3]:g} m north); move it or make the terrain larger"
        )
    return x_min, x_max, y_min, y_max
