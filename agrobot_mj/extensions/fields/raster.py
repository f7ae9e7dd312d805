"""Raster map with the number of passes as a GeoTIFF, for display. Areas are computed from polygons instead.

The band has one byte per cell: the number of passes that worked the centre of the cell, 0 for missed ground, or 255
outside the field. For a field with a known position, the map is in degrees of WGS 84. Cells are then displaced by at
most a few centimetres at 500 m from the origin. Other maps are in metres east and north.
"""

from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.coverage import FieldCoverage
from agrobot_mj.terrain.geotiff import write_tiff

CELL_M, MOST_CELLS = 0.25, 2000  # Minimum size of a cell [m], and maximum number of cells along each side of the map
OUTSIDE = 255  # Value of cells outside the field
BLOCK = 64  # Number of rows of cells that are computed at a time


class PassMap(NamedTuple):
    """Number of passes in each cell of a field map, or `OUTSIDE`; row 0 is in the north."""

    cells: "np.ndarray[tuple[int, int], np.dtype[np.uint8]]"
    cell: float  # Side length of a cell [m]
    bounds: tuple[float, float, float, float]  # Western, southern, eastern and northern limits of the field [m]


def pass_map(found: FieldCoverage) -> PassMap:
    """Return the number of passes in each cell of the bounding box of a field."""
    west, south, east, north = found.field.bounds
    cell = max(CELL_M, (east - west) / MOST_CELLS, (north - south) / MOST_CELLS)
    columns, rows = ceil((east - west) / cell), ceil((north - south) / cell)
    x, y = west + (np.arange(columns) + 0.5) * cell, north - (np.arange(rows) + 0.5) * cell
    counts = np.zeros((rows, columns), dtype=np.uint16)
    for ground in found.passes:
        _count(counts, ground, x, y)
    inside = np.zeros_like(counts)
    _count(inside, found.field, x, y)
    return PassMap(
        np.where(inside > 0, counts.clip(max=OUTSIDE - 1), OUTSIDE).astype(np.uint8), cell, found.field.bounds
    )


def write_raster(path: Path, found: PassMap, plane: Origin | None) -> None:
    """Write the number of passes in each cell of a field map to a GeoTIFF file."""
    cells, cell, (west, south, east, north) = found
    step, corner = (cell, cell), (west, north)
    if plane is not None:
        low, high = to_geodetic(plane, west, south), to_geodetic(plane, east, north)
        step = cell * (high[1] - low[1]) / (east - west), cell * (high[0] - low[0]) / (north - south)
        corner = to_geodetic(plane, west, (north + south) / 2)[1], high[0]
    write_tiff(path, cells, step, corner, plane is not None, OUTSIDE)


def _count(counts: "np.ndarray[tuple[int, ...], np.dtype[np.uint16]]", area: BaseGeometry, x: Array, y: Array) -> None:
    """Add 1 to each cell whose centre is inside an area. The cell centres have ascending `x` and descending `y` [m]."""
    west, south, east, north = area.bounds
    wide = slice(*np.searchsorted(x, [west, east]).tolist())
    first, end = np.searchsorted(-y, [-north, -south]).tolist()
    shapely.prepare(area)
    for row in range(first, end, BLOCK):  # in blocks, to limit memory usage
        high = slice(row, min(row + BLOCK, end))
        counts[high, wide] += shapely.contains_xy(area, *np.meshgrid(x[wide], y[high]))
