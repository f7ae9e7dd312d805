"""Coverage of a field, computed with polygons: worked, overlapped and missed areas.

All areas are inside the field. `worked_m2` is the area worked at least once. An area that is worked twice counts twice
in `covered_m2` and once in `overlapped_m2`, so that the field area equals both worked + missed area and covered -
overlapped + missed area.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array

SLIVER_M2 = 1e-3  # Area below which maps and lists omit a gap or an overlap [m2]
STEP_M = 0.1  # Maximum distance between the checked points of outlines, and of the boundary inside outlines [m]
SIDES = ("east", "north", "west", "south")


@dataclass(frozen=True)
class FieldCoverage:
    """Worked, missed and overlapped ground of a field, as polygons."""

    field: BaseGeometry  # Area of the field without obstacles
    body: BaseGeometry  # Body of the field: area inside the headland laps, which the swaths cover
    passes: Sequence[BaseGeometry]  # Ground worked in each pass, one polygon per pass
    union: BaseGeometry  # Ground worked at least once, including ground outside the field
    missed: BaseGeometry  # Ground inside the field that no pass has worked
    overlapped: BaseGeometry  # Ground inside the field that more than one pass has worked

    @property
    def regions(self) -> dict[str, BaseGeometry]:
        """Polygons by name: the whole field, its headland, and the body inside the headland."""
        return {"field": self.field, "headland": self.field.difference(self.body), "body": self.body}


def coverage(field: BaseGeometry, body: BaseGeometry, passes: Sequence[BaseGeometry]) -> FieldCoverage:
    """Return the coverage of a field with the body `body`. `passes` contains the ground worked in each pass."""
    union = shapely.union_all(list(passes))
    tree = shapely.STRtree(list(passes))
    first, second = tree.query(list(passes), predicate="intersects") if passes else (np.empty(0, int),) * 2
    pairs = first < second
    each = np.array(list(passes), dtype=object)
    twice = shapely.union_all(shapely.intersection(each[first[pairs]], each[second[pairs]]))
    overlapped = twice.intersection(field)
    return FieldCoverage(field, body.intersection(field), passes, union, field.difference(union), overlapped)


def areas(found: FieldCoverage) -> dict[str, dict[str, float]]:
    """Return the worked, covered, overlapped and missed areas of the field, its headland and its body, in m2 and as
    percentages of each region."""
    return {name: _areas(found, region) for name, region in found.regions.items()}


def _areas(found: FieldCoverage, region: BaseGeometry) -> dict[str, float]:
    whole = region.area
    covered = float(shapely.area(shapely.intersection(np.array(list(found.passes), dtype=object), region)).sum())
    worked = found.union.intersection(region).area
    missed = found.missed.intersection(region).area
    numbers = {"worked": worked, "covered": covered, "overlapped": max(covered - worked, 0.0), "missed": missed}
    shares = {f"{name}_percent": 100 * value / whole if whole else 0.0 for name, value in numbers.items()}
    return {"area_m2": whole, **{f"{name}_m2": value for name, value in numbers.items()}, **shares}


def gaps(found: FieldCoverage) -> list[dict[str, Any]]:
    """Return the missed areas inside the headland and on each side of the headland [m2], in decreasing order."""
    headland = found.missed.intersection(found.field.difference(found.body))
    sums = {f"{side} headland": headland.intersection(sector).area for side, sector in _sectors(found.field)}
    sums["body"] = found.missed.intersection(found.body).area
    ranked = sorted(sums.items(), key=lambda each: -each[1])
    return [{"place": place, "area_m2": area} for place, area in ranked if area > SLIVER_M2]


def _sectors(field: BaseGeometry) -> Iterator[tuple[str, BaseGeometry]]:
    """Yield the name of each side of the field, and the triangle of all points on this side (see `side_of`)."""
    middle, (west, south, east, north) = field.centroid, field.bounds
    x, y = 2 * (east - west), 2 * (north - south)  # beyond the field
    corners = [(x, -y), (x, y), (-x, y), (-x, -y)]
    for side, ends in zip(SIDES, zip(corners, [*corners[1:], corners[0]], strict=True), strict=True):
        yield side, shapely.Polygon([(middle.x, middle.y), *((middle.x + a, middle.y + b) for a, b in ends)])


def side_of(east: float, north: float, field: BaseGeometry) -> str:
    """Return the side of the field (east, north, west or south) of a point, given relative to the centroid [m]."""
    west, south, right, top = field.bounds
    angle = np.arctan2(north / max(top - south, 1e-9), east / max(right - west, 1e-9))
    return SIDES[round(float(angle) / (np.pi / 2)) % 4]


def excursion(outlines: Mapping[str, Array], field: BaseGeometry) -> dict[str, Any]:
    """Return the maximum distance [m], area [m2] and location of excursions beyond the boundary of `field`, by name.
    Obstacles inside an outline count.

    `outlines` contains arrays of polygons (n,) by name that are not entirely inside the field, for example outlines of
    the tractor during a run.
    """
    return {name: _excursion(boxes, field) for name, boxes in outlines.items()}


def _excursion(out: Array, field: BaseGeometry) -> dict[str, Any]:
    beyond = shapely.difference(out, field)
    if not shapely.area(beyond).any():
        return {"largest_m": 0.0, "area_m2": 0.0}
    depth = depths(out, field, sides_of(field))
    worst = max(shapely.get_parts(beyond[int(np.argmax(depth))]), key=shapely.area).representative_point()
    middle = field.centroid
    side = side_of(worst.x - middle.x, worst.y - middle.y, field)
    place = {"x": float(worst.x), "y": float(worst.y), "side": side}
    return {"largest_m": float(depth.max()), "area_m2": float(shapely.union_all(beyond).area), **place}


def sides_of(area: BaseGeometry) -> shapely.STRtree:
    """Return the straight sides of the boundary and of the obstacles of an area."""
    lines = [shapely.get_coordinates(ring) for ring in shapely.get_parts(shapely.boundary(area))]
    ends = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    return shapely.STRtree(shapely.linestrings(ends))


def depths(boxes: Array, area: BaseGeometry, sides: shapely.STRtree, limit: float = np.inf) -> Array:
    """Return the maximum distance by which n outlines are beyond the boundary, or by which the boundary, for example of
    an obstacle, is inside them, shape (n,) [m].

    `sides` are the sides of `area`. A boundary inside an outline counts at most as `limit` [m].
    """
    found = np.zeros(len(boxes))
    rows, of_sides = sides.query(boxes, "intersects")
    inside = shapely.segmentize(shapely.intersection(sides.geometries[of_sides], boxes[rows]), STEP_M)
    outlines = shapely.get_exterior_ring(boxes)
    points, of = shapely.get_coordinates(inside, return_index=True)
    away = shapely.distance(shapely.points(points), outlines[rows[of]])
    np.maximum.at(found, rows[of], np.minimum(away, limit))
    points, of = shapely.get_coordinates(shapely.segmentize(outlines, STEP_M), return_index=True)
    np.maximum.at(found, of, shapely.distance(shapely.points(points), area))
    return found
