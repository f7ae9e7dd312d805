"""GeoJSON and fiboa files: polygons, lines and points in degrees (RFC 7946) or in another coordinate system."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.shapes import DEGREES, Polyline, ShapeFile, height_column

NAME_KEYS = ("name", "Name", "NAME", "id", "title")
LOCAL = {"type": "name", "properties": {"name": "local plane in metres"}}
"""Content of the member `crs` in files with coordinates in metres east and north of an unknown origin."""
SCRIPT = re.compile(r"\s*(?:export\s+)?(?:var|let|const)\s+\w+\s*=\s*(?=[{\[])")
"""Pattern of the JavaScript assignment before GeoJSON data in a web map."""
LONGEST = 300  # Number of digits above which an integer may exceed the range of a float
NUMBERS = ("speed", "speed_m_s", "working", "direction")
"""Names of feature properties that contain one number for each point of a line."""


def read_geojson(text: str) -> ShapeFile:
    """Return the shapes in the text of a GeoJSON file. Raise ValueError for text that is not GeoJSON."""
    try:
        script = SCRIPT.sub("", text, count=1).rstrip().rstrip(";") if SCRIPT.match(text) else text
        content = json.loads(script, parse_int=_whole)
    except (json.JSONDecodeError, RecursionError) as error:
        place = f" (line {error.lineno})" if isinstance(error, json.JSONDecodeError) else ""
        raise ValueError(f"the file is not valid JSON{place}; export the file again") from None
    if not isinstance(content, dict):
        raise ValueError("the file is JSON, but not GeoJSON; export it as a FeatureCollection")
    shapes = tuple(shape for feature in _features(content) for shape in of_geometry(*feature))
    return ShapeFile(shapes, _crs(content), name=shapes[0].name if shapes else "")


def _whole(digits: str) -> float:
    """Return an integer, or infinity for an integer that exceeds the range of a float."""
    return int(digits) if len(digits) < LONGEST else float(digits)


def _features(content: Mapping[str, Any]) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    kind = content.get("type")
    if kind == "FeatureCollection":
        features = content.get("features")
        for feature in features if isinstance(features, list) else []:
            if isinstance(feature, dict):
                yield feature.get("geometry"), {**_id(feature), **_mapping(feature.get("properties"))}
    elif kind == "Feature":
        yield content.get("geometry"), {**_id(content), **_mapping(content.get("properties"))}
    elif "coordinates" in content or "geometries" in content:
        yield content, {}
    else:
        raise ValueError("the file is JSON, but not GeoJSON; export it as a FeatureCollection")


def _mapping(found: Any) -> Mapping[str, Any]:
    return found if isinstance(found, dict) else {}


def _id(feature: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"id": str(feature["id"])} if "id" in feature else {}


def _crs(content: Mapping[str, Any]) -> str:
    """Return the coordinate system from the member `crs`: an EPSG code, or "" for metres. Default: degrees."""
    if content.get("crs") == LOCAL:
        return ""
    named = str(_mapping(_mapping(content.get("crs")).get("properties")).get("name", ""))
    code = re.search(r"EPSG:+(\d+)$", named)
    return f"EPSG:{code[1]}" if code else DEGREES


def of_geometry(geometry: Any, properties: Mapping[str, Any]) -> Iterator[Polyline]:
    """Yield the shapes of a GeoJSON geometry; `properties` are the properties of the feature with this geometry."""
    kind, parts = _mapping(geometry).get("type"), _mapping(geometry).get("coordinates")
    name = next((str(properties[key]) for key in NAME_KEYS if properties.get(key)), "")
    role = str(properties.get("role", ""))
    if kind == "GeometryCollection":
        for each in geometry.get("geometries") or []:
            yield from of_geometry(each, properties)
    elif kind in ("Polygon", "MultiPolygon"):
        for polygon in _checked_list(parts) if kind == "MultiPolygon" else [parts]:
            for k, ring in enumerate(_checked_list(polygon)):
                yield Polyline(_points(ring), True, "hole" if k else role, name, _heights(ring), properties)
    elif kind in ("LineString", "MultiLineString"):
        for line in _checked_list(parts) if kind == "MultiLineString" else [parts]:
            points = _points(line)
            yield Polyline(points, False, role, name, _per_point(properties, len(points)), properties)
    elif kind in ("Point", "MultiPoint"):
        yield Polyline(_points(parts if kind == "MultiPoint" else [parts]), False, "point", name, properties=properties)
    elif geometry is not None:
        raise ValueError(f"the file has a geometry of type {str(kind)[:30]!r}; use Polygon or LineString")


def _checked_list(found: Any) -> list[Any]:
    if not isinstance(found, list | tuple):
        raise ValueError("the file has a geometry without coordinates; export the file again")
    return list(found)


def _points(found: Any) -> Array:
    found = _checked_list(found)
    try:
        points = np.array([(float(each[0]), float(each[1])) for each in found]).reshape(-1, 2)
    except (TypeError, ValueError, IndexError, KeyError):
        raise ValueError("the file has a position that is not a pair of numbers; export the file again") from None
    return points


def _heights(found: Any) -> dict[str, Array]:
    """Return the column `height` of positions that all have a height [m], or an empty dict."""
    heights = [each[2] for each in found if len(each) > 2 and isinstance(each[2], int | float)]
    return height_column(heights, len(found))


def _per_point(properties: Mapping[str, Any], count: int) -> dict[str, Array]:
    found = {}
    for key in NUMBERS:
        value = properties.get(key)
        if isinstance(value, list) and len(value) == count and all(isinstance(each, int | float) for each in value):
            found[key.removesuffix("_m_s")] = np.array(value, dtype=float)
    return found
