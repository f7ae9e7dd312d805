"""Conversion of plan lines to legs. Along a leg, the travel direction and the working state of the implement are
constant."""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.field import Leg
from agrobot_mj.paths.imports import Polyline
from agrobot_mj.paths.imports.cleaning import distinct
from agrobot_mj.paths.imports.shapes import parts_inside

BEYOND_M = 1000.0  # Length by which a line is extended at both ends before it is cut at the field boundary [m]
TURNS = ("turn", "connection", "transfer", "transport", "headland_turn")
"""Values of the line property `type` or `kind` for lines without implement work."""


def legs_of(lines: Sequence[Polyline], boundary: Polygon) -> tuple[Leg, ...]:
    """Return the legs of all lines, in the order of the lines.

    A line with the property `extends` is extended straight at both ends and clipped to the boundary.
    """
    return tuple(leg for line in lines for leg in _of_line(line, boundary) if len(leg.points) >= 2)


def _of_line(line: Polyline, boundary: Polygon) -> Iterator[Leg]:
    said, points = line.properties, line.points
    speed, working, reverse = _speed(said), _works(said), _reverses(said)
    if said.get("extends") and len(points) >= 2:
        for part in _inside(points, boundary):
            yield Leg(part, speed, working, reverse)
    elif not line.columns.keys() & {"speed", "working", "direction"}:
        yield Leg(points[distinct(points)], speed, working, reverse)
    else:
        yield from _by_state(line, working)


def _by_state(line: Polyline, working: bool) -> Iterator[Leg]:
    """Yield a leg for each section of a line with constant direction and constant working state. The properties of a
    point apply to the line segment after the point."""
    kept = distinct(line.points)
    columns = {name: values[kept] for name, values in line.columns.items()}
    points, count = line.points[kept], len(kept)
    speeds = columns.get("speed", np.full(count, np.nan))
    works = columns.get("working", np.full(count, float(working))) > 0.5
    backward = (columns.get("direction", np.ones(count)) < 0) | (speeds < 0)
    state = 2 * works[:-1] + backward[:-1]
    starts = [0, *(1 + np.flatnonzero(np.diff(state))).tolist()]
    for start, end in zip(starts, [*starts[1:], count - 1], strict=True):
        driven = np.abs(speeds[start:end])
        driven = driven[np.isfinite(driven) & (driven > 0)]
        speed = float(np.median(driven)) if driven.size else None
        yield Leg(points[start : end + 1], speed, bool(works[start]), bool(backward[start]))


def _inside(points: Array, boundary: Polygon) -> list[Array]:
    """Extend a line straight at both ends, and return the parts of this line that are inside the boundary."""
    first, last = points[0] - points[1], points[-1] - points[-2]
    ends = (first / np.hypot(*first), last / np.hypot(*last)) if np.hypot(*first) and np.hypot(*last) else (0, 0)
    line = np.array([points[0] + BEYOND_M * ends[0], *points, points[-1] + BEYOND_M * ends[1]])
    return parts_inside(line, [shapely.get_coordinates(ring) for ring in (boundary.exterior, *boundary.interiors)])


def _speed(said: Mapping[str, Any]) -> float | None:
    """Return the speed in the properties of a line [m/s], or None if the properties contain no speed."""
    for key, factor in (("speed_m_s", 1.0), ("speed", 1.0), ("speed_kmh", 1 / 3.6), ("velocity", 1.0)):
        value = said.get(key)
        if isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value) and value:
            return abs(float(value)) * factor
    return None


def _works(said: Mapping[str, Any]) -> bool:
    """Return whether the implement works on a line, according to the properties of the line. Default: True."""
    for key in ("working", "work", "implement"):
        if isinstance(said.get(key), bool | int | float):
            return bool(said[key])
    return str(said.get("type", said.get("kind", ""))).lower() not in TURNS


def _reverses(said: Mapping[str, Any]) -> bool:
    """Return whether the tractor drives along a line in reverse, according to the properties of the line."""
    direction = said.get("direction")
    if isinstance(direction, int | float):
        return direction < 0
    return bool(said.get("reverse")) or str(direction).lower() in ("backward", "backwards", "reverse")
