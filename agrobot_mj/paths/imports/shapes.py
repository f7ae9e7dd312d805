"""Shapes of a position file: polylines, rings and sequences of points, in file coordinates or in a local plane."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from agrobot_mj.core.geodesy import Origin
from agrobot_mj.core.geometry import in_polygon
from agrobot_mj.core.signals import Array

LARGEST = 1e8  # Maximum absolute coordinate [m or deg], larger than in any map grid
TOUCHING_M = 1e-6  # Maximum distance of a corner of a ring that touches a line [m]
DECIMALS = 12  # Number of decimals to which crossings are rounded, so that a crossing at a corner is found only once
DEGREES = "EPSG:4326"  # Coordinate system of latitudes and longitudes on WGS84


@dataclass(frozen=True, eq=False)
class Polyline:
    """Polyline, ring or sequence of points, with its role and properties."""

    points: Array  # Points, shape (n, 2): east then north [m], or longitude then latitude [deg]
    ring: bool = False  # Whether the shape is the outline of an area
    role: str = ""  # Role of the shape in its file: boundary, hole, obstacle, headland, track, tram or other
    name: str = ""
    columns: Mapping[str, Array] = field(default_factory=dict)
    """Additional arrays of shape (n,) by column name, with one value per point: speed [m/s], whether the implement
    works (0 or 1), driving direction (1 forward, -1 reverse), height [m], and row of the table."""
    properties: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ShapeFile:
    """Shapes of one file in the coordinates of the file."""

    shapes: tuple[Polyline, ...]  # Shapes in the order of the file; a hole follows the ring around it
    crs: str = ""  # Coordinate system, for example EPSG:4326 for degrees, or "" for metres of an unknown system
    origin: Origin | None = None
    """Geographic position of the origin of local coordinates in metres, or None if unknown."""
    name: str = ""
    notes: tuple[str, ...] = ()  # Sentences about omitted or repaired shapes

    def __post_init__(self) -> None:
        for shape in self.shapes:
            if len(wrong := np.flatnonzero(~(np.abs(shape.points) <= LARGEST).all(axis=1))):
                east, north = shape.points[wrong[0]].tolist()
                raise ValueError(f"position {wrong[0] + 1}, ({east:g}, {north:g}), is out of range; correct the point")


@dataclass(frozen=True, eq=False)
class LocalShapes:
    """Shapes in a local plane, x east and y north [m]."""

    shapes: tuple[Polyline, ...]
    origin: Origin | None = None  # Geographic position of x = y = 0, or None if unknown
    crs: str = ""
    shift: tuple[float, float] = (0.0, 0.0)  # East and north offsets subtracted from the coordinates of the file [m]
    name: str = ""
    notes: tuple[str, ...] = ()  # Sentences about omitted, repaired or shifted shapes


def height_column(heights: list[Any], count: int) -> dict[str, Array]:
    """Return the column `height` if each of `count` points has a finite height [m], or an empty dict."""
    column = np.array(heights, dtype=float)
    return {"height": column} if len(column) == count and np.isfinite(column).all() else {}


def parts_inside(line: Array, rings: Sequence[Array]) -> list[Array]:
    """Return the parts of a polyline, shape (n, 2), inside the first ring and outside all other rings.

    Each ring has the shape (m, 2). Parts along the edge of this area count as inside. The parts have the direction of
    the polyline.
    """
    corners = [[(x, y) for x, y in ring.tolist()] for ring in rings]
    parts = list[list[Array]]()
    for start, end in pairwise(line):
        if not (length := float(np.hypot(*(end - start)))):
            continue
        across = 2 * TOUCHING_M / length * np.array([start[1] - end[1], end[0] - start[0]])
        marks = np.unique(np.concatenate([_crossings(start, end, ring) for ring in rings]))
        ends, ahead = np.vstack([start, start + marks[:, None] * (end - start), end]), False
        for first, last in pairwise(ends):
            middle = (first + last) / 2
            inside = _in_area(corners, *(middle + across).tolist()) or _in_area(corners, *(middle - across).tolist())
            if inside and ahead:
                parts[-1][-1] = last
            elif inside and parts and (parts[-1][-1] == first).all():
                parts[-1].append(last)
            elif inside:
                parts.append([first, last])
            ahead = inside
    return [np.array(part) for part in parts]


def _in_area(rings: Sequence[Sequence[tuple[float, float]]], x: float, y: float) -> bool:
    """Return whether the point (x, y) is inside the first ring and outside all other rings."""
    outer, *inner = (in_polygon(ring, x, y) for ring in rings)
    return outer and not any(inner)


def _crossings(start: Array, end: Array, ring: Array) -> Array:
    """Return the positions between the ends of a straight line at which a ring crosses or touches the line, divided by
    the length of the line [-]."""
    along = end - start
    x, y = (ring - start).T
    left, ahead = along[0] * y - along[1] * x, (along[0] * x + along[1] * y) / (along @ along)
    left[np.abs(left) <= TOUCHING_M * np.hypot(*along)] = 0.0
    other, further = np.roll(left, -1), np.roll(ahead, -1)
    crossed = np.sign(left) != np.sign(other)
    fraction = left[crossed] / (left[crossed] - other[crossed])
    found = np.round(ahead[crossed] + fraction * (further[crossed] - ahead[crossed]), DECIMALS)
    between: Array = found[(found > 0) & (found < 1)]
    return between
