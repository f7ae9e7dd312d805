"""Map of the number of passes as a GeoTIFF in the plane of a field; for pictures, not for areas.

The first band has one byte per cell: the number of passes whose section worked the middle of the cell, 0 for missed
ground, and 255 outside the field. A field with a known position has degrees of WGS 84; the cells are then at most a few
centimetres off at 500 m from the origin. A field without has metres east and north.
"""

from math import ceil
from pathlib import Path

import numpy as np
import shapely
from PIL import Image, ImageDraw, TiffImagePlugin
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.extensions.fields.coverage import FieldCoverage

CELL_M, MOST_CELLS = 0.25, 4000
"""Minimum size of a cell [m], and maximum number of cells per side."""
OUTSIDE = 255
"""Value of the cells outside the field."""
SCALE, TIEPOINT, KEYS, NO_DATA = 33550, 33922, 34735, 42113
"""Tags of GeoTIFF: size of a cell, position of the first cell, coordinate system, value without data."""
DEGREES = (1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326)
METRES = (1, 1, 0, 2, 1024, 0, 1, 32767, 1025, 0, 1, 1)
"""Keys of the coordinate system: geographic WGS 84, or user-defined; cells are areas."""


def write_raster(path: Path, found: FieldCoverage, plane: Origin | None) -> None:
    """Write the number of passes in each cell of a field."""
    west, south, east, north = found.field.bounds
    cell = max(CELL_M, (east - west) / MOST_CELLS, (north - south) / MOST_CELLS)
    size = ceil((east - west) / cell), ceil((north - south) / cell)

    def filled(area: BaseGeometry) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
        """Return 1 in the cells of an area."""
        image = Image.new("L", size)
        draw = ImageDraw.Draw(image)
        for part in shapely.get_parts(area):
            if part.geom_type == "Polygon" and part.area > 0:
                for value, ring in ((1, part.exterior), *((0, inner) for inner in part.interiors)):
                    points = (shapely.get_coordinates(ring) - [west, north]) / [cell, -cell] - 0.5
                    draw.polygon([tuple(point) for point in points.tolist()], fill=value)
        return np.asarray(image, dtype=np.uint8)

    counts = np.zeros(size[::-1], dtype=np.uint16)
    for ground in found.passes:
        counts += filled(ground)
    cells = np.where(filled(found.field) > 0, np.minimum(counts, OUTSIDE - 1), OUTSIDE).astype(np.uint8)
    keys: tuple[int, ...] = METRES
    steps, corner = (cell, cell, 0.0), (west, north, 0.0)
    if plane is not None:
        low, high = to_geodetic(plane, west, south), to_geodetic(plane, east, north)
        steps = cell * (high[1] - low[1]) / (east - west), cell * (high[0] - low[0]) / (north - south), 0.0
        corner, keys = (to_geodetic(plane, west, (north + south) / 2)[1], high[0], 0.0), DEGREES
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, kind, value in (
        (SCALE, 12, steps),
        (TIEPOINT, 12, (0.0, 0.0, 0.0, *corner)),
        (KEYS, 3, keys),
        (NO_DATA, 2, str(OUTSIDE)),
    ):
        tags.tagtype[tag] = kind
        tags[tag] = value
    Image.fromarray(cells).save(path, "TIFF", tiffinfo=tags, compression="tiff_adobe_deflate")
