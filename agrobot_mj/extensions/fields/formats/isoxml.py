"""Reader of ISO 11783-10 task data, versions 3 and 4: boundaries, obstacles, headlands and guidance patterns.

Polygons (PLN) consist of rings (LSG) of points (PNT) with latitude C and longitude D. An area excluded from the field
is an interior ring of the boundary, or a polygon of the type obstacle, building or water.
"""

from collections.abc import Iterator
from math import cos, radians, sin
from xml.etree.ElementTree import Element

import numpy as np

from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports import Polyline, ShapeFile
from agrobot_mj.paths.imports.shapes import DEGREES
from agrobot_mj.paths.imports.xml_files import parsed_xml

BOUNDARY, MAIN_FIELD, HEADLAND = "1", "9", "10"  # Type numbers of polygons: partfield boundary, main field, headland
OBSTACLES = ("3", "4", "6")  # Type numbers of polygons that the tractor must not enter: water, building, obstacle
EXTERIOR, INTERIOR, GUIDANCE = "1", "2", "5"
"""Type codes of line strings: exterior ring, interior ring, guidance line."""
AB, A_PLUS, BOTH_ENDS = "1", "2", "1"
"""Type codes of guidance patterns (AB: two points, A+: point and heading), and code for extension at both ends."""
LINE_M = 1000.0  # Length of a guidance line on each side of its point, for a pattern given by a point and a heading [m]


def read_task_data(text: str) -> ShapeFile:
    """Return the shapes of all partfields. The property `field` of a shape contains the name of its partfield."""
    root = parsed_xml(text)
    shapes = tuple(shape for field in root.iter("PFD") for shape in _of_field(field))
    return ShapeFile(shapes, DEGREES, name=shapes[0].name if shapes else "")


def _of_field(field: Element) -> Iterator[Polyline]:
    name = field.get("C") or field.get("A") or ""
    polygons = field.findall("PLN")
    main = BOUNDARY if any(each.get("A") == BOUNDARY for each in polygons) else MAIN_FIELD
    for polygon in sorted(polygons, key=lambda each: each.get("A") != main):
        kind = polygon.get("A")
        role = "boundary" if kind == main else "headland" if kind == HEADLAND else "obstacle"
        if kind in (main, HEADLAND, *OBSTACLES):
            yield from _rings(polygon, role, name, _hectares(field))
    for line in field.findall("LSG"):
        if line.get("A") == GUIDANCE:
            yield Polyline(_points(line), False, "track", line.get("B") or name)
    for pattern in field.findall("GGP/GPN"):
        yield from _pattern(pattern, name)


def _hectares(field: Element) -> float:
    """Return the area of a partfield [ha], or 0 if the area is missing."""
    try:
        return float(field.get("D", "")) / 1e4
    except ValueError:
        return 0.0


def _rings(polygon: Element, role: str, name: str, area: float) -> Iterator[Polyline]:
    """Yield the rings of a polygon, exterior ring first. For a headland with interior rings, only the interior rings
    are yielded."""
    lines = sorted(polygon.findall("LSG"), key=lambda line: line.get("A") == INTERIOR)
    if role == "headland":
        lines = [line for line in lines if line.get("A") == INTERIOR] or lines
    for line in lines:
        inner = line.get("A") == INTERIOR and role == "boundary"
        yield Polyline(_points(line), True, "hole" if inner else role, name, properties={"field": name, "area": area})


def _pattern(pattern: Element, name: str) -> Iterator[Polyline]:
    """Yield the lines of a guidance pattern. The property `extends` marks AB lines that extend beyond both points."""
    kind, designator = pattern.get("C"), pattern.get("B") or name
    for line in pattern.findall("LSG"):
        points = _points(line)
        if kind == A_PLUS and len(points):
            points = _through(points[0], _heading(pattern))
        if len(points) >= 2:
            extends = kind == AB and pattern.get("F", BOTH_ENDS) == BOTH_ENDS
            yield Polyline(points, False, "track", designator, properties={"extends": extends, "field": name})


def _heading(pattern: Element) -> float:
    """Return the compass heading of a guidance pattern [rad]. Raise ValueError if the heading is missing."""
    try:
        return radians(float(pattern.get("G", "")))
    except ValueError:
        raise ValueError(f"GPN {pattern.get('A', '')}: the pattern has no heading G; export the file again") from None


def _through(point: Array, heading: float) -> Array:
    """Return a line through `point` (longitude, latitude) [deg] at a compass heading [rad], which extends LINE_M on
    each side of the point."""
    origin = Origin(float(point[1]), float(point[0]))
    east, north = LINE_M * sin(heading), LINE_M * cos(heading)
    ends = [to_geodetic(origin, -east, -north), to_geodetic(origin, east, north)]
    return np.array([(lon, lat) for lat, lon in ends])


def _points(line: Element) -> Array:
    """Return the longitudes and latitudes of the points of a line, shape (n, 2) [deg]."""
    try:
        found = np.array([(float(each.get("D", "")), float(each.get("C", ""))) for each in line.iter("PNT")])
    except ValueError:
        raise ValueError("the file has a point PNT without the numbers C and D; export the file again") from None
    return found.reshape(-1, 2)
