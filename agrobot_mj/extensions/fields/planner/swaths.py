"""Swaths: parallel strips of equal width that cover an area, in the direction with the fewest swaths, grouped in cells.

Rows of strips lie side by side, starting at the lowest edge of the area. A row has one swath for each connected part of
the area in its strip. A swath is as long as this part, so that the full width is worked at oblique edges. A cell is a
series of swaths in adjacent rows, each with exactly one neighbour in the next row: the decomposition of [Choset2000].
"""

from collections.abc import Iterator
from math import ceil, cos, degrees, hypot, pi, sin
from typing import NamedTuple

import numpy as np
import shapely
from shapely.affinity import rotate
from shapely.geometry.base import BaseGeometry

from agrobot_mj.paths.parallel import skipping

THINNEST = 0.02  # Minimum width of a part of a strip that gets a swath, divided by the width of the strip [-]
ANGLE_STEP = pi / 18  # Step between evaluated swath directions [rad]. The directions of edges are also evaluated.
ROUNDING = 1e-6  # Rounding error that is ignored in the number of swaths across an area [-]
Span = tuple[float, float]


class Swath(NamedTuple):
    """Strip worked in one pass. Stations are distances along the swath direction; offsets are to its left."""

    start: float  # Station at the first end [m]
    end: float  # Station at the second end [m]
    across: float  # Offset of the centre line [m], to the left of the swath direction
    sections: tuple[Span, ...]  # Stations between which each section works [m], for sections from right to left

    @property
    def length(self) -> float:
        """Length of the strip [m]."""
        return self.end - self.start


class Pattern(NamedTuple):
    """Parallel swaths that cover an area."""

    angle: float  # Direction of the swaths [rad], counter-clockwise from east
    cells: tuple[tuple[Swath, ...], ...]  # Cells; a cell is a tuple of adjacent swaths from right to left

    @property
    def number(self) -> int:
        """Number of swaths."""
        return sum(map(len, self.cells))

    @property
    def length(self) -> float:
        """Total length of the swaths [m]."""
        return sum(swath.length for cell in self.cells for swath in cell)

    def point(self, station: float, across: float) -> tuple[float, float]:
        """Convert a station and an offset [m] to east and north coordinates [m]."""
        c, s = cos(self.angle), sin(self.angle)
        return c * station - s * across, s * station + c * across


def best_pattern(area: BaseGeometry, width: float, sections: int) -> Pattern:
    """Return the pattern with the fewest swaths over the evaluated directions, and the least length among equals."""
    found = (pattern(area, angle, width, 1) for angle in _angles(area, width))
    best = min(found, key=lambda each: (each.number, round(each.length, 3)))
    return pattern(area, best.angle, width, sections)


def _angles(area: BaseGeometry, width: float) -> list[float]:
    """Return the directions of long edges, and directions in steps of `ANGLE_STEP`, from 0 to pi [rad]."""
    angles = {round(k * ANGLE_STEP, 6) for k in range(round(pi / ANGLE_STEP))}
    for part in shapely.get_parts(area):
        corners = np.array(part.simplify(0.1 * width).exterior.coords)
        for east, north in np.diff(corners, axis=0):
            if hypot(east, north) > 2 * width:
                angles.add(round(float(np.arctan2(north, east)) % pi, 6))
    return sorted(angles)


def pattern(area: BaseGeometry, angle: float, width: float, sections: int) -> Pattern:
    """Return the swaths of an area in the direction `angle` [rad], for a working width [m] and a number of sections."""
    turned = rotate(area, -degrees(angle), origin=(0.0, 0.0))
    west, south, east, north = turned.bounds
    count = max(1, ceil((north - south) / width - ROUNDING))
    rows = [_row(turned, (west - 1, east + 1), south + k * width, width, sections) for k in range(count)]
    return Pattern(angle, tuple(tuple(cell) for cell in _cells(rows)))


def _row(area: BaseGeometry, ends: Span, low: float, width: float, sections: int) -> list[Swath]:
    """Return the swaths of the strip whose lower edge has the offset `low` [m]."""
    strip = shapely.box(ends[0], low, ends[1], low + width).intersection(area)
    found = []
    for part in shapely.get_parts(strip):
        west, south, east, north = part.bounds
        if part.area and north - south > THINNEST * width:
            spans = tuple(_spans(part, low, width / sections, sections, (west, east)))
            found.append(Swath(west, east, low + width / 2, spans))
    return sorted(found)


def _spans(part: BaseGeometry, low: float, width: float, count: int, whole: Span) -> Iterator[Span]:
    """Yield the stations between which each section works in a part of a strip, or equal stations for no work."""
    if count == 1:
        yield whole
        return
    for k in range(count):
        inner = shapely.box(whole[0] - 1, low + k * width, whole[1] + 1, low + (k + 1) * width).intersection(part)
        yield (whole[0], whole[0]) if inner.area < 1e-9 else (inner.bounds[0], inner.bounds[2])


def _cells(rows: list[list[Swath]]) -> list[list[Swath]]:
    """Return the swaths of all rows, grouped by cell."""
    cells: list[list[Swath]] = []
    before: list[tuple[Swath, list[Swath]]] = []
    for row in rows:
        beside = [[old for old, _ in before if old.start < new.end and new.start < old.end] for new in row]
        following = []
        for swath, neighbours in zip(row, beside, strict=True):
            only = len(neighbours) == 1 and sum(neighbours[0] in others for others in beside) == 1
            cell = next((cell for old, cell in before if only and old == neighbours[0]), None)
            if cell is None:
                cells.append(cell := [])
            cell.append(swath)
            following.append((swath, cell))
        before = following
    return cells


def ordered(count: int, order: str, across: int) -> list[int]:
    """Return the order of driving of the swaths in a cell: neighbouring swaths, or every `across`-th swath."""
    if order == "skip" and across > 1 and count >= 2 * across + 1:
        return list(skipping(count, across))
    return list(range(count))
