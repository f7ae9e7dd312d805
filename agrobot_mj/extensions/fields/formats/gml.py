"""Reader of polygons and lines in GML 2 and GML 3.

If the coordinate system has a short name (EPSG:4326), the first coordinate is east, as in the files of most programs.
With a long name (urn:ogc:def:crs:EPSG::4326 or a web address), the coordinate system defines the order of the axes,
often north first.
"""

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports import Polyline, ShapeFile
from agrobot_mj.paths.imports.xml_files import parsed_xml

CODE = re.compile(r"(?:EPSG|epsg)[:/#]+(?:[\d.]+[:/])?(\d+)$|CRS84$")
"""Pattern of the EPSG code at the end of a coordinate system name."""
OUTER, INNER = ("exterior", "outerBoundaryIs"), ("interior", "innerBoundaryIs")
"""XML tags of the outer and inner rings of a polygon: GML 3 first, GML 2 second."""


def read_gml(text: str) -> ShapeFile:
    """Return the shapes in the text of a GML file. Raise ValueError if the file is damaged."""
    root = parsed_xml(text)
    crs, north_first = _system(root)
    shapes = [*_polygons(root), *_lines(root)]
    if north_first:
        shapes = [Polyline(shape.points[:, ::-1], shape.ring, shape.role, shape.name) for shape in shapes]
    name = next((each.text or "" for each in root.iter() if each.tag in ("name", "Name")), "")
    return ShapeFile(tuple(shapes), crs, name=name.strip())


def _system(root: Element) -> tuple[str, bool]:
    """Return the coordinate system of a document, and whether its north coordinate precedes the east coordinate."""
    named = next((each.get("srsName", "") for each in root.iter() if each.get("srsName")), "")
    code = CODE.search(named)
    if not code:
        return named or "EPSG:4326", False
    crs = f"EPSG:{code[1]}" if code[1] else "EPSG:4326"
    if named.upper().startswith("EPSG:") or not code[1] or "epsg.xml#" in named:
        return crs, False
    pyproj = import_extra("pyproj", "fields", f"the coordinate system {crs}")
    try:
        return crs, pyproj.CRS(crs).axis_info[0].direction == "north"
    except pyproj.exceptions.CRSError:
        raise ValueError(f"srsName: {named[:60]!r} is an unknown coordinate system; specify one with crs") from None


def _polygons(root: Element) -> Iterator[Polyline]:
    for polygon in (each for each in root.iter() if each.tag in ("Polygon", "PolygonPatch")):
        for tags, role in ((OUTER, ""), (INNER, "hole")):
            for ring in (each for each in polygon if each.tag in tags):
                yield Polyline(_points(ring), True, role)


def _lines(root: Element) -> Iterator[Polyline]:
    for line in root.iter("LineString"):
        yield Polyline(_points(line))


def _points(element: Element) -> Array:
    width, numbers = 2, list[str]()
    for each in element.iter():
        text = each.text or ""
        if each.tag in ("posList", "pos"):
            width = int(each.get("srsDimension") or (len(text.split()) if each.tag == "pos" else 2))
            numbers += text.split()
        elif each.tag == "coordinates":
            pairs = [pair.split(",") for pair in text.split()]
            width = max((len(pair) for pair in pairs), default=2)
            numbers += [number for pair in pairs for number in pair]
    try:
        points = np.array([float(number) for number in numbers]).reshape(-1, width)[:, :2]
    except ValueError:
        raise ValueError("the file has coordinates that are not numeric; export the file again") from None
    return points
