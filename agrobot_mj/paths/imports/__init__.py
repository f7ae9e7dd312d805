"""Import of positions: polylines and rings from files of other programs.

`read_shapes` reads a file into shapes in its own coordinates, `local_shapes` moves them into a local plane in metres,
and `cleaned` removes what a tractor cannot drive.
"""

from agrobot_mj.paths.imports.cleaning import cleaned
from agrobot_mj.paths.imports.plane import local_shapes
from agrobot_mj.paths.imports.reading import READERS, read_shapes
from agrobot_mj.paths.imports.shapes import LocalShapes, Polyline, ShapeFile

__all__ = ["READERS", "LocalShapes", "Polyline", "ShapeFile", "cleaned", "local_shapes", "read_shapes"]
