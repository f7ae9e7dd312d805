"""Reader of polygons and lines in well-known text (WKT), with an optional coordinate system: SRID=25832;POLYGON ..."""

import re
from collections.abc import Iterator

import numpy as np
import shapely

from agrobot_mj.paths.imports import Polyline, ShapeFile
from agrobot_mj.paths.imports.shapes import DEGREES

START = re.compile(
    r"\s*(SRID=\d+;)?\s*((MULTI)?(POLYGON|LINESTRING|POINT)|GEOMETRYCOLLECTION)\s*(Z|M|ZM)?\s*(\(|EMPTY)", re.I
)
"""Pattern of the start of well-known text. The last group rejects CSV title rows that begin with the word point."""
LARGEST_DEG = 1.0  # Extent below which coordinates of an unknown system are treated as degrees [deg]


def is_wkt(head: str) -> bool:
    """Return whether a text starts with a WKT geometry."""
    return bool(START.match(head))


def read_wkt(text: str) -> ShapeFile:
    """Return the shapes in a text with one or more WKT geometries. Raise ValueError if a geometry is invalid."""
    shapes, crs = list[Polyline](), ""
    for number, line in _statements(text):
        srid, semicolon, body = line.rpartition(";")
        if semicolon:
            crs = f"EPSG:{srid.strip()[5:]}"
        try:
            with np.errstate(all="ignore"):  # numbers that are too large are reported with their position
                geometry = shapely.from_wkt(body)
        except shapely.errors.GEOSException:
            raise ValueError(f"line {number}: the line is not valid WKT; write POLYGON ((x y, ...))") from None
        shapes += of_shapely(geometry)
    points = np.vstack([shape.points for shape in shapes if len(shape.points)] or [np.empty((0, 2))])
    if not crs and len(points) > 1 and np.ptp(points, axis=0).max() < LARGEST_DEG and np.abs(points[:, 1]).max() <= 90:
        crs = DEGREES
    return ShapeFile(tuple(shapes), crs)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield the first line number and the text of each geometry. A geometry may extend over several lines."""
    collected, first = "", 1
    for number, line in enumerate(text.splitlines(), start=1):
        if START.match(line) and collected:
            yield first, collected
            collected, first = "", number
        collected = f"{collected} {line.strip()}".strip()
    if collected:
        yield first, collected


def of_shapely(geometry: shapely.Geometry) -> Iterator[Polyline]:
    """Yield the rings, lines and points of a shapely geometry as polylines."""
    for part in getattr(geometry, "geoms", [geometry]):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            yield Polyline(shapely.get_coordinates(part.exterior), True)
            for ring in part.interiors:
                yield Polyline(shapely.get_coordinates(ring), True, "hole")
        elif hasattr(part, "geoms"):
            yield from of_shapely(part)
        elif not part.is_empty:
            role = "point" if isinstance(part, shapely.Point) else ""
            yield Polyline(shapely.get_coordinates(part), False, role)
