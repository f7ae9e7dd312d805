"""Map of a plan or of simulated field work, as a figure and as GeoJSON."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.geodesy import Origin, geodetic_points
from agrobot_mj.core.palette import BLACK, BLUE, GREEN, LIGHT_GREY, ORANGE, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.coverage import SLIVER_M2, FieldCoverage
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.paths.imports.geojson import LOCAL
from agrobot_mj.simulation.results import atomic

OUTLINE_M = 0.01  # Tolerance for simplifying the outline of worked ground in files [m]
WIDTH_IN, TALLEST_IN = 7.0, 8.0  # Width and maximum height of a map [in]


def map_of(field: BaseGeometry, plan: Plan, found: FieldCoverage | None = None, track: Array | None = None) -> Figure:
    """Draw the map of a plan or, if given, the coverage `found` and the tractor track `track` (n, 2) [m] of simulated
    field work."""
    figure, axes, keys = _map(field, _layers(found) if found is not None else ())
    if track is not None:
        axes.plot(*track.T, color=BLACK, linewidth=0.5)
        keys.append(Line2D([], [], color=BLACK, linewidth=0.8, label="track"))
    else:
        colours = {"pass": GREEN, "turn": BLUE}
        for kind, points in _lines(plan):
            axes.plot(*points.T, color=colours[kind], linewidth=0.8)
        keys += [Line2D([], [], color=colour, linewidth=1, label=kind) for kind, colour in colours.items()]
    figure.legend(handles=keys, loc="outside upper center", ncols=len(keys))
    return figure


def map_of_areas(field: BaseGeometry, layers: Iterable[tuple[BaseGeometry, str, str]]) -> Figure:
    """Draw a map of the areas `layers` in a field, given by polygon, colour and name."""
    figure, _, keys = _map(field, layers)
    figure.legend(handles=keys, loc="outside upper center", ncols=len(keys))
    return figure


def _map(field: BaseGeometry, layers: Iterable[tuple[BaseGeometry, str, str]]) -> tuple[Figure, Any, list[Any]]:
    """Return a figure with the boundary of a field and filled areas, its axes, and the legend entries."""
    west, south, east, north = field.bounds
    height = min(TALLEST_IN, WIDTH_IN * (north - south) / (east - west) + 0.9)
    figure = Figure((WIDTH_IN, height), layout="constrained")
    axes, keys = figure.subplots(), list[Any]()
    for area, colour, name in layers:
        _fill(axes, area, colour)
        keys.append(Patch(color=colour, label=name))
    for part in shapely.get_parts(field):
        for ring in (part.exterior, *part.interiors):
            axes.plot(*np.array(ring.coords)[:, :2].T, color=BLACK, linewidth=1.2)
    axes.set(aspect="equal", xlabel="east [m]", ylabel="north [m]")
    return figure, axes, keys


def _layers(found: FieldCoverage) -> Iterator[tuple[BaseGeometry, str, str]]:
    """Yield polygon, colour and name of the worked, overlapped and missed areas."""
    yield found.union, LIGHT_GREY, "worked"
    yield found.overlapped, ORANGE, "overlapped"
    yield found.missed, VERMILION, "missed"


def _fill(axes: Any, area: BaseGeometry, colour: str) -> None:
    outlines = []
    for part in shapely.get_parts(area):
        if part.geom_type == "Polygon" and part.area > SLIVER_M2:
            rings = [np.array(ring.coords)[:, :2] for ring in (part.exterior, *part.interiors)]
            codes = [[Outline.MOVETO, *[Outline.LINETO] * (len(ring) - 2), Outline.CLOSEPOLY] for ring in rings]
            outlines.append(Outline(np.vstack(rings), np.concatenate(codes)))
    # the axes contain the boundary of the field; limits of thousands of patches would take seconds
    axes.add_collection(PathCollection(outlines, facecolors=colour, linewidths=0), autolim=False)


def _lines(plan: Plan) -> Iterator[tuple[str, Array]]:
    """Yield the points (n, 2) [m] of each pass and each turn of a plan, with the type `pass` or `turn`."""
    course = plan.course.divided()
    x, y, _ = course.joints()
    points, distances = np.column_stack([x, y]), course.distances()
    at = 0.0
    for one in plan.passes:
        for kind, first, last in (("turn", at, one.start), ("pass", one.start, one.end)):
            rows = (distances >= first - 0.6) & (distances <= last + 0.6)
            if rows.sum() > 1:
                yield kind, points[rows]
        at = one.end


def write_geojson(
    path: Path, field: BaseGeometry, plan: Plan, found: FieldCoverage | None = None, plane: Origin | None = None
) -> None:
    """Write a plan and, if given, the coverage `found` as GeoJSON, one feature at a time to limit memory usage.

    Coordinates are in degrees, or in metres if the geographic position `plane` of the field is unknown.
    """
    content = {"type": "FeatureCollection", "name": plan.name, "features": [None]}
    head, tail = _json_text(content if plane else {**content, "crs": LOCAL}).split("\n    null\n")
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        separator = head
        for shape, properties in _shapes(field, plan, found):
            feature = _json_text(_feature(shape, properties, plane)).replace("\n", "\n    ")
            file.write(f"{separator}\n    {feature}")
            separator = ","
        file.write(f"\n{tail}\n")


def _json_text(content: Any) -> str:
    return json.dumps(content, indent=2, allow_nan=False)


def _shapes(
    field: BaseGeometry, plan: Plan, found: FieldCoverage | None
) -> Iterator[tuple[BaseGeometry, dict[str, Any]]]:
    """Yield the shapes of a field, its plan and its coverage, each with its GeoJSON properties."""
    yield field, {"kind": "field", "name": plan.name}
    for number, (kind, points) in enumerate(_lines(plan)):
        yield shapely.LineString(points), {"kind": kind, "number": number}
    if found is not None:
        yield found.body, {"kind": "body", "area_m2": found.body.area}
        for number, ground in enumerate(found.passes):
            yield ground, {"kind": "pass_area", "number": number, "area_m2": ground.area}
        worked = found.union.intersection(field)
        for kind, area in (("worked", worked), ("overlapped", found.overlapped), ("missed", found.missed)):
            yield area.simplify(OUTLINE_M) if kind == "worked" else area, {"kind": kind, "area_m2": area.area}


def _feature(shape: BaseGeometry, properties: dict[str, Any], plane: Origin | None) -> dict[str, Any]:
    """Return a GeoJSON feature for a shape, with coordinates rounded to 0.1 mm or 1e-9 deg."""
    if plane is not None:
        shape = shapely.transform(shape, lambda points: geodetic_points(plane, points))
    geometry = shapely.geometry.mapping(
        shapely.geometry.polygon.orient(shape) if shape.geom_type == "Polygon" else shape
    )
    return {"type": "Feature", "properties": properties, "geometry": _round_values(geometry, 4 if plane is None else 9)}


def _round_values(value: Any, digits: int) -> Any:
    if isinstance(value, float):
        return round(value, digits)
    if isinstance(value, dict):
        return {key: _round_values(each, digits) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_round_values(each, digits) for each in value]
    return value
