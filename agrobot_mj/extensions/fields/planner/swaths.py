"""Swaths: parallel strips of equal width that cover an area, in the direction with the fewest swaths, grouped in cells.

Swaths are straight lines or concentric arcs. A coordinate frame has stations along the swaths and offsets across them;
in this frame, both types of swaths are straight. Adjacent strips cover the area, starting at its minimum offset. Each
connected part of the area in a strip is one swath. A swath has the length of this part, so that the full width is
worked at oblique edges. A cell is a series of swaths in adjacent strips, each with exactly one adjacent swath in the
next strip: the decomposition of [Choset2000].
"""

from collections.abc import Iterator
from math import ceil, copysign, cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.parallel import skipping

THINNEST = 0.02  # Minimum width of an area in a strip that gets a swath, divided by the width of the strip [-]
ANGLE_STEP = pi / 18  # Step between evaluated swath directions [rad]. The directions of edges are also evaluated.
ROUNDING = 1e-6  # Rounding error that is ignored in the number of swaths that fit across an area [-]
EDGE_M = 1.0  # Maximum distance between the points of an edge that is converted to a curved frame [m]
Span = tuple[float, float]


class Swath(NamedTuple):
    """Strip worked in one pass, in the station and offset coordinates of a `SwathFrame`."""

    start: float  # Station at the first end [m]
    end: float  # Station at the second end [m]
    across: float  # Offset of the centre line to the left of the frame origin [m]
    sections: tuple[Span, ...]  # Stations between which each section works [m], for sections from right to left

    @property
    def length(self) -> float:
        """Difference between the end and start stations [m]."""
        return self.end - self.start


class SwathFrame(NamedTuple):
    """Coordinate frame of straight swaths or concentric arcs: station along the swaths, offset to the left."""

    angle: float  # Direction of the swaths at the origin of the frame [rad], counter-clockwise from east
    curvature: float = 0.0  # Curvature of the swath at offset 0, left positive, or 0 for straight swaths [1/m]
    x: float = 0.0  # East coordinate of the origin [m]
    y: float = 0.0  # North coordinate of the origin [m]

    @property
    def centre(self) -> tuple[float, float]:
        """East and north coordinates of the common centre of concentric swaths [m]."""
        return self.x - sin(self.angle) / self.curvature, self.y + cos(self.angle) / self.curvature

    def of(self, points: Array) -> Array:
        """Convert east and north coordinates to station and offset, shape (n, 2) each [m]."""
        c, s = cos(self.angle), sin(self.angle)
        if not self.curvature:
            found: Array = (points - (self.x, self.y)) @ [[c, -s], [s, c]]
            return found
        side = copysign(1.0, self.curvature)
        east, north = side * (points - self.centre).T
        turned = wrap(np.arctan2(east, -north) - self.angle)
        return np.column_stack([turned / self.curvature, 1 / self.curvature - side * np.hypot(east, north)])

    def stretch(self, across: float) -> float:
        """Return the length of a swath at the offset `across` [m], divided by the difference of its end stations."""
        return 1.0 - self.curvature * across

    def pose(self, station: float, across: float) -> Pose:
        """Return the east-north pose at a station and an offset [m], heading in the swath direction."""
        c, s = cos(self.angle), sin(self.angle)
        if not self.curvature:
            return Pose(self.x + c * station - s * across, self.y + s * station + c * across, self.angle)
        yaw, radius = self.angle + self.curvature * station, 1 / self.curvature - across
        return Pose(self.centre[0] + radius * sin(yaw), self.centre[1] - radius * cos(yaw), yaw)


class Pattern(NamedTuple):
    """Parallel swaths that cover an area, grouped in cells."""

    frame: SwathFrame  # Frame of the stations and offsets of the swaths
    cells: tuple[tuple[Swath, ...], ...]  # Cells, each with adjacent swaths from right to left

    @property
    def number(self) -> int:
        """Number of swaths."""
        return sum(map(len, self.cells))

    @property
    def length(self) -> float:
        """Total length of the swaths [m]."""
        return sum(swath.length * self.frame.stretch(swath.across) for cell in self.cells for swath in cell)


def best_pattern(area: BaseGeometry, width: float, sections: int) -> Pattern:
    """Return the pattern with the fewest swaths among the evaluated directions. If several patterns have the fewest
    swaths, the total length is minimal."""
    found = (pattern(area, SwathFrame(angle), width, 1) for angle in _angles(area, width))
    best = min(found, key=lambda each: (each.number, round(each.length, 3)))
    return pattern(area, best.frame, width, sections)


def _angles(area: BaseGeometry, width: float) -> list[float]:
    """Return the swath directions to evaluate, from 0 to pi [rad]: directions of long edges of the area, and multiples
    of `ANGLE_STEP`."""
    angles = {round(k * ANGLE_STEP, 6) for k in range(round(pi / ANGLE_STEP))}
    for part in shapely.get_parts(area):
        corners = np.array(part.simplify(0.1 * width).exterior.coords)
        for east, north in np.diff(corners, axis=0):
            if hypot(east, north) > 2 * width:
                angles.add(round(float(np.arctan2(north, east)) % pi, 6))
    return sorted(angles)


def pattern(area: BaseGeometry, frame: SwathFrame, width: float, sections: int) -> Pattern:
    """Return the swaths that cover an area, for a working `width` [m] and a number of `sections`."""
    turned = shapely.transform(area.segmentize(EDGE_M) if frame.curvature else area, frame.of)
    west, south, east, north = turned.bounds
    count = max(1, ceil((north - south) / width - ROUNDING))
    rows = [_row(turned, (west - 1, east + 1), south + k * width, width, sections) for k in range(count)]
    return Pattern(frame, tuple(tuple(cell) for cell in _cells(rows)))


def _row(area: BaseGeometry, ends: Span, low: float, width: float, sections: int) -> list[Swath]:
    """Return the swaths in the strip of width `width` that starts at the offset `low` [m]."""
    strip = shapely.box(ends[0], low, ends[1], low + width).intersection(area)
    found = []
    for part in shapely.get_parts(strip):
        west, south, east, north = part.bounds
        if part.area and north - south > THINNEST * width:
            spans = tuple(_spans(part, low, width / sections, sections, (west, east)))
            found.append(Swath(west, east, low + width / 2, spans))
    return sorted(found)


def _spans(part: BaseGeometry, low: float, width: float, count: int, whole: Span) -> Iterator[Span]:
    """Yield the stations at which each section starts and stops working in a swath [m]. Both stations are equal for a
    section without work."""
    if count == 1:
        yield whole
        return
    for k in range(count):
        inner = shapely.box(whole[0] - 1, low + k * width, whole[1] + 1, low + (k + 1) * width).intersection(part)
        yield (whole[0], whole[0]) if inner.area < 1e-9 else (inner.bounds[0], inner.bounds[2])


def _cells(rows: list[list[Swath]]) -> list[list[Swath]]:
    """Return the swaths of all strips, grouped in cells of adjacent swaths."""
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


def swath_order(count: int, order: str, across: int) -> list[int]:
    """Return the swath indices of a cell in the order of travel. The order is ascending or, if `order` is "skip", in
    steps of at least `across` swaths."""
    if order == "skip" and across > 1 and count >= 2 * across + 1:
        return list(skipping(count, across))
    return list(range(count))
