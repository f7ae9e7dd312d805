"""Waypoints from a file of positions: CSV, KML, GeoJSON, GPX, a file of an AgOpenGPS field, or a shapefile.

The longest line of the file is the track; a file without lines gives its longest ring, or its points in their order.
Every error is a ValueError that names the file, the row of a table and the fix.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.resources import Stamp, checked, refuse, stamp
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import FASTEST_M_S, SLOWEST_M_S
from agrobot_mj.paths.imports import Polyline, cleaned, local_shapes, read_shapes
from agrobot_mj.paths.imports.cleaning import CLOSEST_M

__all__ = ["CLOSEST_M", "Track", "stamp_of", "track"]

MAX_BYTES = 2_000_000
MAX_ROWS = 20_000


class Track(NamedTuple):
    """Waypoints of a file."""

    points: Array
    """Waypoints, shape (n, 2) or (n, 3): x, y [m] and speed [m/s]."""
    notes: tuple[str, ...]
    """Sentences about columns, shapes and points that were left out, and about a shift."""


def stamp_of(name: str) -> Stamp:
    """Return the stamp of the current file content. Raise ValueError if the file cannot contain waypoints."""
    path = checked(name, (), MAX_BYTES)
    return stamp(name) or refuse(path, "the file no longer exists; create it again")


@lru_cache(maxsize=8)
def track(stamp: Stamp, crs: str, closed: bool) -> Track:
    """Return at least three waypoints in metres. Raise ValueError if the file is invalid."""
    file = Path(stamp[0])
    read = read_shapes(stamp[0], MAX_BYTES)
    try:
        shape, left = _chosen(read.shapes)
        found = local_shapes(replace(read, shapes=(shape,)), crs)
        points, notes = _checked(found.shapes[0], closed)
    except ValueError as error:
        refuse(file, str(error))
    return Track(points, (*found.notes, *left, *notes))


def _chosen(shapes: tuple[Polyline, ...]) -> tuple[Polyline, list[str]]:
    lines = [shape for shape in shapes if not shape.ring and shape.role != "point"]
    rings = [shape for shape in shapes if shape.ring and shape.role != "hole"]
    if not (choice := lines or rings):
        return Polyline(np.vstack([np.empty((0, 2)), *(shape.points for shape in shapes)]), name="points"), []
    best = max(choice, key=lambda shape: float(np.hypot(*np.diff(shape.points, axis=0).T).sum()))
    if len(choice) == 1:
        return best, []
    named = f", {best.name!r}," if best.name else ""
    return best, [f"the longest{named} of {len(choice)} {'lines' if lines else 'rings'} is used"]


def _checked(shape: Polyline, closed: bool) -> tuple[Array, list[str]]:
    points = shape.points
    if len(points) > MAX_ROWS:
        raise ValueError(f"the file has {len(points)} waypoints, and the limit is {MAX_ROWS}; remove some rows")
    notes = list[str]()
    if len(points) >= 3:
        kept, notes = cleaned(points, closed)
        rows = shape.columns.get("row", np.arange(1, len(points) + 1))[kept]
        points = points[kept]
        if "speed" in shape.columns:
            speeds = shape.columns["speed"][kept]
            wrong = np.flatnonzero((speeds < SLOWEST_M_S) | (speeds > FASTEST_M_S))
            if wrong.size:
                raise ValueError(
                    f"row {rows[wrong[0]]}: speed is {speeds[wrong[0]]:g} m/s; use a speed from {SLOWEST_M_S:g} to "
                    f"{FASTEST_M_S:g}"
                )
            points = np.column_stack([points, speeds])
    if len(points) < 3:
        raise ValueError(f"the file has {len(points)} waypoints; at least 3 are required")
    return points, notes
