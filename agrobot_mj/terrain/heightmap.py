"""Terrain with heights from a file, such as a digital elevation model.

By default the centre of the grid is at the origin. With `map_origin_m` the nodes have their map positions relative to
this map origin. Row 0 of an image (`.png`, `.tif`) and of an ESRI grid (`.asc`) is the north edge, as on maps. Row 0 of
an array (`.npy`) is the south edge: row and column numbers increase with y and x. Column 0 is west. `Elevation.txt`
contains points, which `elevation.py` interpolates; the origin of its map is the start fix.
"""

from math import radians, tan
from typing import Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.terrain.base import STEEPEST_DEG, Tilted
from agrobot_mj.terrain.files import Sheet, read_grid
from agrobot_mj.terrain.grid import Ground, rounded_down
from agrobot_mj.terrain.shapes import Coordinate


class Heightmap(Tilted):
    """Terrain with heights from a file: `.npy`, `.png` (grey, 16 or 8 bits), `.asc`, `.tif` (GeoTIFF) or
    `Elevation.txt` (AgOpenGPS)."""

    kind: Literal["heightmap"] = "heightmap"
    file: str = Field(default="hills.asc", min_length=1)
    """Height file: path relative to the folder of the scenario, or name of a file shipped with the package."""
    scale: float = 1.0
    """Height per unit of the values in the file [m]. For a 16-bit image: height range divided by 65535."""
    offset_m: float = 0.0
    """Height added to all values of the file after scaling [m]."""
    spacing_m: Positive | None = None
    """Distance between nodes of a .npy or .png file [m]. Default: 1. Other file types contain the distance."""
    map_origin_m: tuple[Coordinate, Coordinate] | None = None
    """Easting and northing of the point x = y = 0 on the map of an .asc or .tif file [m]. Subtract the same numbers
    from a path surveyed on this map. Default: x = y = 0 is the centre of the grid, or the start fix of
    Elevation.txt."""
    rectangular: bool = False
    """Whether a .npy or .png file may have different numbers of rows and columns. Default: only square grids."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the interpolation of the heights in the file."""
        return read_grid(self.file).notes if self.file.lower().endswith(".txt") else ()

    def relief(self) -> Ground:
        """Return the height grid. Raises a ValueError that names an invalid key."""
        sheet = read_grid(self.file)
        rows, columns = sheet.values.shape
        if rows != columns and sheet.cell is None and not self.rectangular:
            raise ValueError(
                f"file: {self._name}: the grid has {rows} rows and {columns} columns; set rectangular = true if this "
                "is its shape, or make it square"
            )
        spacing = self._spacing(sheet)
        corner = self._corner(sheet, -spacing * (columns - 1) / 2, -spacing * (rows - 1) / 2)
        ground = Ground(*corner, spacing, self._heights(sheet.values))
        if ground.steepest > (limit := tan(radians(STEEPEST_DEG))):
            raise ValueError(
                f"scale: {self._name} rises {ground.steepest * spacing:.3g} m between nodes {spacing:g} m apart, "
                f"a slope above {STEEPEST_DEG:g} deg; its heights are probably in another unit; set a scale of at "
                f"most {rounded_down(abs(self.scale) * limit / ground.steepest):g}"
            )
        return self.tilt(ground)

    @property
    def _name(self) -> str:
        return self.file.replace("\\", "/").rpartition("/")[2]

    def _spacing(self, sheet: Sheet) -> float:
        if sheet.cell is None:
            return 1.0 if self.spacing_m is None else self.spacing_m
        if self.spacing_m is not None and self.spacing_m != sheet.cell:
            raise ValueError(f"spacing_m: {self._name} already has a cellsize of {sheet.cell:g} m; omit the key")
        return sheet.cell

    def _corner(self, sheet: Sheet, x: float, y: float) -> tuple[float, float]:
        """Return the south-west node (x, y) [m], or its map position minus `map_origin_m` if this key is given."""
        origin = (0.0, 0.0) if self.map_origin_m is None and sheet.local else self.map_origin_m
        if origin is None:
            return x, y
        if sheet.corner is None:
            raise ValueError(f"map_origin_m: {self._name} has no coordinates; omit the key, or use .asc or .tif")
        return sheet.corner[0] - origin[0], sheet.corner[1] - origin[1]

    def _heights(self, values: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            heights = self.scale * values + self.offset_m
        if not np.abs(heights).max() < 1e6:
            raise ValueError(f"scale: the heights of {self._name} exceed 1000 km; reduce the value")
        return heights
