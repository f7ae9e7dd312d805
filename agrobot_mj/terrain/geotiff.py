"""Reading of elevation models from GeoTIFF files, and writing of maps to GeoTIFF files for other programs.

Pillow reads the images; cell size and position follow from the tags of OGC GeoTIFF 1.1. Grids in degrees and rotated
grids are rejected with a message that contains the command for their conversion.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from agrobot_mj.core.resources import refuse
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import HUGE

PIXEL_SCALE, TIE_POINT, TRANSFORMATION, GEO_KEYS, NODATA = 33550, 33922, 34264, 34735, 42113
"""Numbers of the TIFF tags for cell size, position, transformation, GeoKeys and missing data in GeoTIFF files."""
MODEL_TYPE, RASTER_TYPE, GEOGRAPHIC, IS_POINT = 1024, 1025, 2, 2
"""GeoKeys of coordinate system and raster type, and their numbers for coordinates in degrees and for point data."""
PROJECTED, FIRST_EPSG, USER_DEFINED = 3072, 1024, 32767
"""GeoKey of the projected coordinate system, its first EPSG code, and the number of a system without a code."""
IN_DEGREES = (1, 1, 0, 3, MODEL_TYPE, 0, 1, GEOGRAPHIC, RASTER_TYPE, 0, 1, 1, 2048, 0, 1, 4326)
IN_METRES = (1, 1, 0, 2, MODEL_TYPE, 0, 1, 32767, RASTER_TYPE, 0, 1, 1)
"""GeoKey directories of written files: `IN_DEGREES` for WGS 84, `IN_METRES` for a grid without a map position."""
HEIGHT_MODES = ("F", "I", "L", "I;16", "I;16B", "I;16S")  # Pillow image modes with one number per cell


def open_tiff(path: Path) -> Any:
    """Return an opened TIFF image. Raises ValueError if the file is not a TIFF image."""
    from PIL import Image  # imported here, because most terrains are not images

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            return Image.open(path, formats=["TIFF"])
        except (Image.DecompressionBombWarning, Image.DecompressionBombError):
            refuse(path, "the image exceeds the limit of nodes by far; crop it or reduce its resolution")
        except Exception:
            refuse(path, "the file is not a TIFF image; export the file again as GeoTIFF with one band")


def cell_and_corner(path: Path, image: Any) -> tuple[float, tuple[float, float]]:
    """Return cell size [m] and (easting, northing) [m] of the south-west node. Raises ValueError for unsupported
    grids."""
    tags = image.tag_v2
    keys = _geo_keys(tags)
    if keys.get(MODEL_TYPE) == GEOGRAPHIC:
        refuse(path, "the cells are in degrees; reproject the grid to metres, e.g. with gdalwarp -t_srs EPSG:32632")
    if TRANSFORMATION in tags or PIXEL_SCALE not in tags or len(tags.get(TIE_POINT, ())) < 6:
        refuse(path, "the file has no north-up position on a map; convert it with gdalwarp -of GTiff")
    try:
        dx, dy = (float(size) for size in tags[PIXEL_SCALE][:2])
        i, j, _, x, y, _ = (float(value) for value in tags[TIE_POINT][:6])
    except (TypeError, ValueError):
        refuse(path, "the tags of the map position are damaged; convert the file with gdalwarp -of GTiff")
    if not (0 < dx < np.inf and abs(dx - dy) <= 1e-9 * dx):
        refuse(path, f"the cells are {dx:g} x {dy:g} m; resample them to squares with gdalwarp -tr {dx:g} {dx:g}")
    if not max(abs(x), abs(y)) <= HUGE:
        refuse(path, f"the map position ({x:g}, {y:g}) m is out of range; convert the file with gdalwarp -of GTiff")
    half = 0.0 if keys.get(RASTER_TYPE) == IS_POINT else 0.5
    west, north = x + (half - i) * dx, y - (half - j) * dx
    return dx, (west, north - (image.height - 1) * dx)


def without_gaps(path: Path, values: Array, tags: Any) -> Array:
    """Return the values of an image, shape (rows, columns), with row 0 in the south. Raise ValueError for missing
    values."""
    if holes := int((values == _nodata(path, tags)).sum()):
        refuse(path, f"the grid has {holes} missing values (NODATA); fill them, e.g. with gdal_fillnodata")
    return np.flipud(values)


def map_system(path: Path) -> str:
    """Return the projected coordinate system of a GeoTIFF, for example `EPSG:32632`, or an empty string if the file
    names none. Raise ValueError if the file is not a TIFF image."""
    with open_tiff(path) as image:
        code = _geo_keys(image.tag_v2).get(PROJECTED, 0)
    return f"EPSG:{code}" if FIRST_EPSG <= code < USER_DEFINED else ""


def _geo_keys(tags: Any) -> dict[int, int]:
    words = [int(word) for word in tags.get(GEO_KEYS, ())]
    rows = zip(*(words[k::4] for k in range(4)), strict=False)
    return {key: value for key, where, _, value in list(rows)[1:] if where == 0}


def _nodata(path: Path, tags: Any) -> float:
    if NODATA not in tags:
        return float("nan")
    try:
        return float(str(tags[NODATA]).strip("\0 "))
    except ValueError:
        refuse(path, f"the NODATA value is not a number: {str(tags[NODATA])[:20]!r}; set it with gdal_edit -a_nodata")


def write_tiff(
    path: Path, cells: Any, step: tuple[float, float], corner: tuple[float, float], degrees: bool, no_data: int
) -> None:
    """Write an array of bytes with shape (rows, columns), whose row 0 is north, to a GeoTIFF file.

    `step` is the size of a cell and `corner` the north-west corner of the first cell, both as (east, north), in degrees
    if `degrees` is true, otherwise in metres. Cells without data have the value `no_data`.
    """
    from PIL import Image, TiffImagePlugin

    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, kind, value in (
        (PIXEL_SCALE, 12, (*step, 0.0)),
        (TIE_POINT, 12, (0.0, 0.0, 0.0, *corner, 0.0)),
        (GEO_KEYS, 3, IN_DEGREES if degrees else IN_METRES),
        (NODATA, 2, str(no_data)),
    ):
        tags.tagtype[tag] = kind
        tags[tag] = value
    Image.fromarray(cells).save(path, "TIFF", tiffinfo=tags, compression="tiff_adobe_deflate")
