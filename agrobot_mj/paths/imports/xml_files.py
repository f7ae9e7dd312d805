"""KML and GPX files: lines, rings and points with longitude and latitude."""

from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.shapes import DEGREES, Polyline, ShapeFile, height_column


def parsed_xml(text: str) -> ElementTree.Element:
    """Return the root of an XML document, with namespaces removed. Raise ValueError if the document is damaged."""
    try:
        root = ElementTree.fromstring(text)  # a text, so that a declared encoding has no effect
    except (ElementTree.ParseError, ValueError) as error:
        line = getattr(error, "position", (0,))[0]
        raise ValueError(f"the file is not valid XML (line {line}); export the file again") from None
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    return root


def read_kml(text: str) -> ShapeFile:
    """Return the lines, rings, tracks and points in the placemarks of a KML file."""
    root = parsed_xml(text)
    shapes = tuple(shape for mark in root.iter("Placemark") for shape in _of_placemark(mark))
    name = root.findtext(".//Placemark/name") or root.findtext(".//Document/name") or ""
    return ShapeFile(shapes, DEGREES, name=name.strip())


def _of_placemark(mark: ElementTree.Element) -> Iterator[Polyline]:
    name = (mark.findtext("name") or "").strip()
    for polygon in mark.iter("Polygon"):
        for side, role in (("outerBoundaryIs", ""), ("innerBoundaryIs", "hole")):
            for ring in polygon.findall(f"{side}/LinearRing"):
                yield _ring(ring, role, name)
    for line in mark.iter("LineString"):
        yield Polyline(_coordinates(line), False, "", name)
    for ring in [each for kind in ("MultiGeometry", ".") for each in mark.findall(f"{kind}/LinearRing")]:
        yield _ring(ring, "", name)
    for track in mark.iter("Track"):
        yield Polyline(_numbers([(each.text or "").split() for each in track.findall("coord")]), False, "", name)
    for point in mark.iter("Point"):
        yield Polyline(_coordinates(point), False, "point", name)


def _ring(element: ElementTree.Element, role: str, name: str) -> Polyline:
    cells = _cells(element)
    points = _numbers(cells)
    try:
        heights = [float(cell[2]) for cell in cells if len(cell) > 2]
    except ValueError:
        heights = []
    return Polyline(points, True, role, name, height_column(heights, len(points)))


def _coordinates(element: ElementTree.Element) -> Array:
    """Return the positions in a KML element, shape (n, 2) [deg]."""
    return _numbers(_cells(element))


def _cells(element: ElementTree.Element) -> list[list[str]]:
    """Return the tuples longitude,latitude[,height] in a KML element."""
    text = "".join(each.text or "" for each in element.iter("coordinates"))
    return [part.split(",") for part in text.split()]


def _numbers(cells: list[list[str]]) -> Array:
    try:
        if any(len(cell) > 3 for cell in cells):
            raise ValueError("decimal commas")
        points = np.array([(float(cell[0]), float(cell[1])) for cell in cells]).reshape(-1, 2)
    except (ValueError, IndexError):
        raise ValueError("a position is not longitude,latitude in degrees; export the file again") from None
    return points


def read_gpx(text: str) -> ShapeFile:
    """Return the tracks and routes of a GPX file, or else its waypoints. Track segments are separate lines."""
    root, shapes = parsed_xml(text), list[Polyline]()
    for parent, part, point in (("trk", "trkseg", "trkpt"), ("rte", ".", "rtept")):
        for line in root.findall(parent):
            name = (line.findtext("name") or "").strip()
            for segment in line.findall(part):
                cells = [[each.get("lon", ""), each.get("lat", "")] for each in segment.findall(point)]
                if cells:
                    shapes.append(Polyline(_numbers(cells), False, "", name))
    if not shapes and (marks := [[each.get("lon", ""), each.get("lat", "")] for each in root.findall("wpt")]):
        shapes = [Polyline(_numbers(marks), False, "", "waypoints")]
    return ShapeFile(tuple(shapes), DEGREES, name=shapes[0].name if shapes else "")
