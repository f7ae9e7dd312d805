"""Conversion of the ground patches of a terrain to one grid of ground properties."""

from math import ceil, inf
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.terrain.grid import Surface, rounded_up
from agrobot_mj.terrain.shapes import Bounds, CirclePatch, PicturePatch, PolygonPatch, RectanglePatch, Special
from agrobot_mj.terrain.variation import Variation

MOST_CELLS = 4_000_000  # Maximum number of cells in the property grid, which use 64 MB
MOST_TESTS = 2e8
"""Maximum number of point-in-patch tests [-], summed over all patches. This number of tests takes several seconds."""

GroundPatch = Annotated[RectanglePatch | CirclePatch | PolygonPatch | PicturePatch, Field(discriminator="kind")]


class Base(NamedTuple):
    """Ground properties outside the patches."""

    properties: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Friction factor [-], cone index [Pa] and rolling resistance [-]; 0 in the last two selects the tyre law."""
    variation: Variation | None = None  # Random variation about these properties, or None for uniform ground


def surface(patches: tuple[Special, ...], extent: Bounds, base: Base) -> Surface:
    """Return the property grid of `patches` on the ground `base`. Raises a ValueError that names an invalid key."""
    boxes = [_inside(k, patch, extent) for k, patch in enumerate(patches)]
    covered_boxes = boxes if base.variation is None else [extent]
    low_x, low_y = min(box[0] for box in covered_boxes), min(box[2] for box in covered_boxes)
    width = max(box[1] for box in covered_boxes) - low_x
    height = max(box[3] for box in covered_boxes) - low_y
    varied = () if base.variation is None else (base.variation.cell,)
    cell = min(*varied, *(patch.cell_m for patch in patches), inf)
    rows, columns = ceil(height / cell), ceil(width / cell)
    if rows * columns > MOST_CELLS:
        key = "patch" if base.variation is None else "variation"
        raise ValueError(
            f"{key}: {rows} x {columns} cells are more than {MOST_CELLS}; make cell_m larger, e.g. "
            f"{_coarse_enough(cell, width, height):g}"
        )
    x, y = low_x + cell * (np.arange(columns) + 0.5), low_y + cell * (np.arange(rows) + 0.5)
    tests = sum((box[1] - box[0]) * (box[3] - box[2]) for box in boxes) / cell**2
    if tests > MOST_TESTS:
        raise ValueError(
            f"patch: {len(patches)} patches overlap, so {tests:.2g} cells must be filled, above the limit of "
            f"{MOST_TESTS:.2g}; increase cell_m above {cell:g}, or use fewer patches"
        )
    friction, cone_index, rolling = _ground_outside(base, (rows, columns), cell)
    for k, (patch, box) in enumerate(zip(patches, boxes, strict=True)):
        window = _window(low_y, box[2:], cell), _window(low_x, box[:2], cell)
        grid = np.meshgrid(x[window[1]], y[window[0]], sparse=True)
        covered = patch.covers(*grid)
        if not covered.any():
            raise ValueError(f"patch[{k}]: the patch covers no cell of {cell:g} m; enlarge the patch or reduce cell_m")
        painted = patch.properties(*(along[covered] for along in np.broadcast_arrays(*grid)))
        friction[window][covered] = painted[0]
        cone_index[window][covered] = np.where(painted[1] > 0.0, painted[1], base.properties[1])
        own = patch.rolling_resistance
        rolling[window][covered] = base.properties[2] if own is None else own
    resists = rolling if rolling.any() else np.empty((0, 0))
    return Surface(low_x, low_y, cell, friction, cone_index, resists, base.properties)


def _ground_outside(base: Base, shape: tuple[int, int], cell: float) -> tuple[Array, Array, Array]:
    """Return grids of friction factor [-], cone index [Pa] and rolling resistance [-] of the ground without patches."""
    fields: list[Array] = [np.full(shape, value) for value in base.properties]
    friction, strength, rolling = fields
    if base.variation is None:
        return friction, strength, rolling
    mean = base.properties[1] / 1e3 or None
    try:
        scale, strength = base.variation.properties(shape, cell, mean)
    except ValueError as error:
        raise ValueError(f"variation.{error}") from None
    return friction * scale, strength, rolling


def _window(first: float, between: tuple[float, ...], cell: float) -> slice:
    """Return the slice of the cells in an interval [m] and one cell on both sides; cell 0 begins at `first` [m]."""
    low, high = between
    return slice(max(0, int((low - first) / cell) - 1), int((high - first) / cell) + 2)


def _coarse_enough(cell: float, width: float, height: float) -> float:
    """Return a rounded cell size [m], at least `cell`, for which the property grid has at most `MOST_CELLS` cells."""
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
            f"patch[{k}]: the patch is outside the field ({extent[0]:g} to {extent[1]:g} m east, {extent[2]:g} to "
            f"{extent[3]:g} m north); move it or make the terrain larger"
        )
    return x_min, x_max, y_min, y_max
