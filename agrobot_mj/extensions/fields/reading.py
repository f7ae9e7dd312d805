"""Reading of fields and plans from files of other programs, in a local plane in metres.

Field formats: GeoJSON (also fiboa), KML, GPX, shapefiles, GML, WKT, ISO 11783 task data, AgOpenGPS folders and CSV.
Plans may also be Fields2Cover paths.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.geodesy import Origin, metres_per_latitude, metres_per_longitude, to_geodetic
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.field import Field, Leg
from agrobot_mj.extensions.fields.legs import legs_of
from agrobot_mj.extensions.fields.repair import boundary_polygon, inner_polygons, without
from agrobot_mj.extensions.fields.sources import elevation_file, field_shapes, plan_shapes
from agrobot_mj.paths.imports import LocalShapes, Polyline, ShapeFile, local_shapes
from agrobot_mj.paths.imports.plane import FAR_M
from agrobot_mj.paths.imports.shapes import DEGREES

INNER = ("hole", "obstacle", "headland")  # Roles of rings that belong to the preceding boundary
SAME, APART = 1e-9, 0.05
"""Limits of the gap between the ends of a line, divided by the extent of the line [-]. A line with a gap up to `SAME`
is a closed ring. A gap above `APART` is reported."""

SAME_AREA, OTHER_AREA = 0.03, 0.15
"""Maximum relative difference from the area in the file with swapped coordinates, and minimum difference with the given
coordinates, for which latitude and longitude are swapped [-]. Assumed values."""
M2_PER_HA = 1e4  # Number of square metres in a hectare
REPEATED = 0.9
"""Fraction of the field area above which a ring inside the field counts as a second outline [-]. Assumed value."""
CENTRED_M = 1.0
"""Distance of the boundary centre from the origin above which a file without an origin gets a new origin [m]."""


def read_field(path: Path, crs: str = "", name: str = "") -> Field:
    """Return the field `name` in a file. Default: the largest field.

    `crs`, for example EPSG:25832, is the coordinate system of a file that specifies no coordinate system. Raise a
    `ScenarioError` that names the file and the remedy if the file is unusable.
    """
    file = field_shapes(path)
    try:
        groups = _groups(file.shapes)
        chosen, notes = _choose_field(groups, name)
        if _is_open_line(file.shapes, chosen[0].points):
            notes.append("the file has no closed ring; the ends of a line are joined to form the boundary")
        if any(shape.ring for shape in file.shapes) and (count := sum(each.role == "point" for each in file.shapes)):
            notes.append(f"single points ({count}) are omitted; draw obstacles as polygons")
        inside = [group for group in groups if group is not chosen and _is_within(group[0].points, chosen[0].points)]
        shapes = [*chosen, *(replace(group[0], role="inner") for group in inside)]
        file, label = _in_order(replace(file, shapes=tuple(shapes)), chosen[0]), chosen[0].name or file.name
        local = local_shapes(file, crs)
        field = _field(local, label, notes)
        if middle := _middle(field, file):
            field = _field(local_shapes(file, crs, middle), label, notes)
        return replace(field, elevation=elevation_file(path))
    except ValueError as error:
        raise ScenarioError(f"{path.name}: {error}") from None


def _groups(shapes: Sequence[Polyline]) -> list[list[Polyline]]:
    """Return groups of the outer ring and the inner rings of a polygon. In a file without rings, lines or points are
    treated as rings."""
    rings = [shape for shape in shapes if shape.ring and len(shape.points)]
    if not rings:
        lines = [shape for shape in shapes if shape.role != "point" and len(shape.points)]
        points = np.vstack([np.empty((0, 2)), *(shape.points for shape in shapes)])
        rings = [ring for shape in lines or [Polyline(points)] for ring in _split_into_rings(shape)]
    groups = list[list[Polyline]]()
    for ring in rings:
        if ring.role in INNER and groups:
            groups[-1].append(ring)
        else:
            groups.append([ring])
    return groups


def _is_open_line(shapes: Sequence[Polyline], ring: Array) -> bool:
    """Return whether the points `ring` form an open line, whose ends are distant. Tables of points do not count."""
    if any(shape.ring or shape.role == "point" or "row" in shape.columns for shape in shapes):
        return False
    return float(np.hypot(*(ring[-1] - ring[0]))) > APART * float(np.ptp(ring, axis=0).max())


def _split_into_rings(line: Polyline) -> list[Polyline]:
    """Split a line into closed rings. A line that does not close becomes a single ring."""
    points, found, start = line.points, list[Polyline](), 0
    near = SAME * float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    while start < len(points):
        gaps = np.hypot(*(points[start + 3 :] - points[start]).T)
        closing = np.flatnonzero(gaps <= near)
        end = start + 4 + int(closing[0]) if closing.size else len(points)
        if end - start >= 3 or not found:
            found.append(replace(line, points=points[start:end], ring=True, columns={}))
        start = end
    return found


def _choose_field(groups: list[list[Polyline]], name: str) -> tuple[list[Polyline], list[str]]:
    """Return the largest field with the given name, and notes about other fields. An empty name matches all fields."""
    if not groups:
        raise ValueError("the file contains no boundary; export one")
    known = list(dict.fromkeys(group[0].name for group in groups if group[0].name))
    named = [group for group in groups if not name or group[0].name.casefold() == name.casefold()]
    if not named:
        shown = ", ".join(known[:20]) or "none"
        raise ValueError(f"the file has no field {name!r}{suggestion(name, known)} (available: {shown})")
    best = max(named, key=lambda group: _area(group[0].points))
    others = [group for group in named if group is not best and not _is_within(group[0].points, best[0].points)]
    if not others:
        return best, []
    label = f" {best[0].name!r}" if best[0].name else ""
    return best, [f"the largest{label} of {len(others) + 1} fields is used"]


def _area(points: Array) -> float:
    """Return the area of a polygon ring in squared coordinate units, for comparisons between rings."""
    x, y = (points - points[0]).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


def _is_within(inner: Array, outer: Array) -> bool:
    """Return whether the bounding box of the ring `inner` is inside the bounding box of the ring `outer`."""
    return bool((inner.min(axis=0) >= outer.min(axis=0)).all() and (inner.max(axis=0) <= outer.max(axis=0)).all())


def _field(local: LocalShapes, name: str, notes: list[str]) -> Field:
    """Return a field from a boundary, which is the first shape, and the inner rings, which are the other shapes."""
    boundary, more = boundary_polygon(local.shapes[0].points)
    notes = [*local.notes, *notes, *more]
    inner: dict[str, list[Polygon]] = {"hole": [], "obstacle": [], "headland": []}
    for shape in local.shapes[1:]:
        role = shape.role if shape.role != "inner" else "obstacle"
        try:
            parts, more = inner_polygons(shape.points, role)
        except ValueError as error:
            notes.append(f"an inner ring is omitted: {error}")
            continue
        area = shapely.union_all(parts)
        if shape.role == "inner" and not boundary.contains(area.representative_point()):
            continue  # a field next to this one
        if shape.role == "inner" and boundary.intersection(area).area > REPEATED * boundary.area:
            notes.append("a second outline of the field is omitted")
            continue
        inner[role] += parts
        notes += more
    worked, _, said = without(boundary, inner["hole"], "hole")
    worked, obstacles, more = without(worked, inner["obstacle"], "obstacle")
    headland = max(inner["headland"], key=lambda each: each.area, default=None)
    return Field(
        *(name, worked, tuple(obstacles), local.origin, (*notes, *said, *more), headland, local.crs),
        shift=local.shift,
        heights=_heights(local.shapes[0]),
    )


def _in_order(file: ShapeFile, ring: Polyline) -> ShapeFile:
    """Return a file in which latitude and longitude are swapped if the area in the properties of the boundary fits only
    the other order. The area is in hectares, or in square metres if only this unit fits."""
    stated = ring.properties.get("area")
    if file.crs != DEGREES or not isinstance(stated, int | float) or not stated > 0 or np.abs(ring.points).max() > 90:
        return file
    areas = [_hectares(points) for points in (ring.points, ring.points[:, ::-1])]
    in_metres = any(abs(M2_PER_HA * area / stated - 1) < OTHER_AREA for area in areas)
    area, text = (stated / M2_PER_HA, f"{stated:.0f} m2") if in_metres else (stated, f"{stated:.4g} ha")
    notes = [f"the area of {stated:.0f} in the file is read in m2, because it is too large in ha"] if in_metres else []
    given, other = (each / area for each in areas)
    if abs(other - 1) > SAME_AREA or abs(given - 1) < OTHER_AREA:
        return replace(file, notes=(*file.notes, *notes))
    notes.append(
        f"latitude and longitude are swapped, because the area of {text} in the file fits only the other order"
    )
    shapes = tuple(replace(shape, points=shape.points[:, ::-1]) for shape in file.shapes)
    return replace(file, shapes=shapes, notes=(*file.notes, *notes))


def _hectares(points: Array) -> float:
    """Return the area of a ring of longitudes and latitudes [deg], in hectares."""
    latitude = float(points[:, 1].mean())
    return _area(points) * metres_per_longitude(latitude) * metres_per_latitude(latitude) / M2_PER_HA


def _heights(ring: Polyline) -> Array | None:
    """Return the points of a ring with their heights, shape (n, 3) [m], or None if all heights are equal."""
    heights = ring.columns.get("height", np.zeros(1))
    return np.column_stack([ring.points, heights]) if np.ptp(heights) > 0 else None


def _middle(field: Field, file: ShapeFile) -> LocalShapes | None:
    """Return a new local plane with its origin at the middle of the boundary, or None if the current plane is suitable.
    The first plane of a file may be off-centre, because it includes points and rings that are later omitted."""
    west, south, east, north = field.boundary.bounds
    x, y = (west + east) / 2, (south + north) / 2
    if max(abs(x), abs(y)) <= CENTRED_M or file.origin is not None or not (field.plane or any(field.shift)):
        return None
    if field.plane is None:
        return LocalShapes((), shift=(field.shift[0] + round(x), field.shift[1] + round(y)))
    return LocalShapes((), Origin(*(round(angle, 7) for angle in to_geodetic(field.plane, x, y))))


def read_plan(path: Path, field: Field, crs: str = "") -> tuple[tuple[Leg, ...], tuple[str, ...]]:
    """Return two values: the legs in a plan file, in the local plane of a field, and notes about repairs.

    Raise a `ScenarioError` that names the file and the remedy if the file is unusable.
    """
    file = plan_shapes(path)
    try:
        local = local_shapes(file, crs or _grid(file, field), LocalShapes((), field.plane, field.crs, field.shift))
        legs = legs_of([shape for shape in local.shapes if not shape.ring and shape.role != "point"], field.boundary)
        if not legs:
            raise ValueError("the plan has no lines; export its passes as lines")
        away = shapely.distance(shapely.MultiPoint(legs[0].points), field.boundary)
        if away > FAR_M:
            raise ValueError(f"the plan is {away / 1000:.3g} km from the field; use the coordinate system of the field")
        return legs, tuple(note for note in local.notes if note not in field.notes)
    except ValueError as error:
        raise ScenarioError(f"{path.name}: {error}") from None


def _grid(file: ShapeFile, field: Field) -> str:
    """Return the coordinate system of `field` if the plan `file` has grid coordinates but does not name their
    coordinate system, otherwise ""."""
    if file.crs or file.origin is not None or field.plane is None or field.crs in ("", "EPSG:4326"):
        return ""
    points = np.vstack([np.empty((0, 2)), *(shape.points for shape in file.shapes)])
    return field.crs if len(points) and np.hypot(*points.T).min() > FAR_M else ""
