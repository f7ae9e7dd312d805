"""Polygons from the rings of a file. Invalid rings are repaired, with a note about each repair."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.cleaning import CLOSEST_M, outliers, thinned

LEAST_M2 = 10.0  # Minimum area of a field [m2]. Assumed value: smaller than a machine.
MOST_POINTS, WITHIN_M = 20_000, 0.02
"""Number of points above which a ring is simplified, and tolerance of the simplification [m]."""
SLIVER_M2 = 0.01  # Area of removed parts of a polygon below which there is no note [m2]


def ring_polygon(points: Array, what: str) -> tuple[Polygon, list[str]]:
    """Return a valid polygon for a ring of points, shape (n, 2) [m], and notes about repairs.

    `what` is the name of the ring in notes and messages. Raise ValueError if the ring encloses no area.
    """
    notes = list[str]()
    points = _without_repeats(points, what, notes)
    if (far := outliers(points)).size:
        for k in far.tolist():
            away = float(np.hypot(*(points[k] - np.median(points, axis=0))))
            notes.append(f"point {k + 1} of the {what} is omitted, {away:.0f} m away from the others")
        points = np.delete(points, far, axis=0)
    if len(points) < 3:
        raise ValueError(f"the {what} has {len(points)} points; at least 3 are required")
    if len(points) > MOST_POINTS:
        points = _simplified(points, what, notes)
    return _valid(Polygon(points), what, notes), notes


def _simplified(points: Array, what: str, notes: list[str]) -> Array:
    """Return a ring with at most about `MOST_POINTS` points. Append a note to `notes` if it is simplified."""
    apart = max(WITHIN_M, 4 * float(np.hypot(*np.ptp(points, axis=0))) / MOST_POINTS)
    near = points[thinned(points, apart, closed=True)]
    found = shapely.get_coordinates(LineString(near).simplify(WITHIN_M, preserve_topology=False))
    notes.append(f"the {what} is simplified within {apart:.2g} m, from {len(points)} to {len(found)} points")
    return found if len(found) > 2 else points[:3]


def _without_repeats(points: Array, what: str, notes: list[str]) -> Array:
    """Return a ring without repeated points, including the closing point. Append a note if others are repeated."""
    if len(points) > 1 and np.hypot(*(points[0] - points[-1])) < CLOSEST_M:
        points = points[:-1]
    if len(points) < 2:
        return points
    far = np.hypot(*np.diff(points, axis=0, append=points[:1]).T) >= CLOSEST_M
    if repeated := int((~far).sum()):
        notes.append(f"{repeated} repeated {'point' if repeated == 1 else 'points'} of the {what} omitted")
    kept: Array = points[far]
    return kept


def _valid(polygon: Polygon, what: str, notes: list[str]) -> Polygon:
    """Return a polygon without self-intersections. An invalid polygon is reduced to its largest part, with a note."""
    found = polygon
    if not polygon.is_valid:
        reason = shapely.is_valid_reason(polygon)
        parts = polygons_of(shapely.make_valid(polygon))
        found = max(parts, key=lambda each: each.area, default=Polygon())
        place = reason.partition("[")[2].rstrip("]").split()
        where = f" at ({float(place[0]):.1f}, {float(place[1]):.1f}) m" if len(place) >= 2 else ""
        text = f"the {what} crosses itself{where} and is repaired"
        rest = sum(part.area for part in parts) - found.area
        notes.append(text + (f", without {rest:.2f} m2 of {rest + found.area:.0f} m2" if rest > SLIVER_M2 else ""))
    if found.area < LEAST_M2:
        raise ValueError(f"the {what} encloses {found.area:.2g} m2, less than {LEAST_M2:g}; check its coordinates")
    return found


def polygons_of(geometry: shapely.Geometry) -> list[Polygon]:
    """Return the polygons in a geometry, without its lines and points."""
    parts = shapely.get_parts(geometry)
    return [
        each
        for part in parts.tolist()
        for each in ([part] if isinstance(part, Polygon) else polygons_of(part) if hasattr(part, "geoms") else [])
    ]


def without(boundary: Polygon, inner: Sequence[Polygon], what: str) -> tuple[Polygon, list[Polygon], list[str]]:
    """Subtract inner areas from a boundary. Return the boundary, the inner areas within it, and notes."""
    notes, kept, outside, crossing = list[str](), list[Polygon](), 0, 0
    for each in inner:
        if not boundary.intersects(each) or boundary.intersection(each).area < SLIVER_M2:
            outside += 1
            continue
        crossing += not boundary.covers(each)
        kept += polygons_of(boundary.intersection(each))
    if outside:
        notes.append(f"{outside} {what}{'s' * (outside > 1)} outside the boundary omitted")
    if crossing:
        notes.append(f"{crossing} {what}{'s' * (crossing > 1)} cut at the boundary")
    parts = polygons_of(boundary.difference(shapely.union_all(kept))) if kept else [boundary]
    if not parts:
        raise ValueError(f"the {what}s cover the whole field; check the file")
    if len(parts) > 1:
        notes.append(f"{what}s divide the field into {len(parts)} parts; only the largest is kept")
    return max(parts, key=lambda part: part.area), kept, notes
