"""Import of positions: polylines and rings from files of other programs.

`read_shapes` reads the shapes in a file, in file coordinates. `local_shapes` converts these shapes to a local plane in
metres. `clean` removes points that a tractor cannot follow.
"""

from agrobot_mj.paths.imports.cleaning import clean
from agrobot_mj.paths.imports.plane import local_shapes
from agrobot_mj.paths.imports.reading import READERS, read_shapes, text_type
from agrobot_mj.paths.imports.shapes import LocalShapes, Polyline, ShapeFile

__all__ = ["READERS", "LocalShapes", "Polyline", "ShapeFile", "clean", "local_shapes", "read_shapes", "text_type"]
