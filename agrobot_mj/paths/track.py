"""Course: geometry of a path without time, as a chain of segments travelled forward or in reverse.

A segment is a straight, an arc or a clothoid: its curvature is constant or changes linearly. Other curves are
approximated by chains of short arcs with the heading of the curve at each joint. A change of the direction of travel is
a cusp, where the tractor stops and keeps its heading. Lengths [m] are travelled distances, also positive in reverse.
Curvature [1/m] is positive to the left. Yaw [rad] is the tractor's heading, counter-clockwise from east, not wrapped.
"""

from collections.abc import Iterable
from itertools import pairwise
from math import inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Place, Pose

STEP_M = 0.5  # Maximum length of a segment after division [m]
PARTS_TO_A_STOP = 8  # Minimum number of parts into which a segment next to a cusp is divided [-]
CURVE_STEP_M = 0.1  # Spacing of the arcs that approximate a curve [m]
MAX_LENGTH_M = 200e3  # Maximum length of a course, enough for 60 ha with a working width of 3 m [m]
QUADRATURE = np.polynomial.legendre.leggauss(32)
"""Nodes and weights of a Gauss-Legendre rule, exact up to rounding for clothoids with heading changes up to 10 rad."""


Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.signedinteger]]


class Piece(NamedTuple):
    """Segment of a course: a straight, an arc or a clothoid, or a pause between two segments."""

    length: float  # Length of the segment [m], or 0 for a pause
    curvature: float = 0.0  # Curvature at the start of the segment [1/m]
    speed: float = inf  # Maximum speed on the segment [m/s]
    sharpness: float = 0.0  # Change of curvature per metre travelled on the segment [1/m2]
    direction: float = 1.0  # Direction of travel: 1 forward, -1 reverse [-]
    pause: float = 0.0  # Duration of a pause [s], for segments of length 0


class Course(NamedTuple):
    """Chain of path segments that begins at the pose `start`; the arrays have shape (segments,)."""

    start: Pose
    lengths: Array  # Length of each segment, 0 only for pauses [m]
    curvatures: Array  # Curvature at the start of each segment [1/m]
    speeds: Array  # Maximum speed on each segment [m/s], or infinity if only the limits of the path apply
    sharpnesses: Array  # Change of curvature per metre travelled on each segment [1/m2]
    directions: Array  # Direction of travel of each segment: 1 forward, -1 reverse [-]
    pauses: Array  # Duration of the pause of each segment [s]
    trends: Array
    """Change of curvature per metre of the curve that the segments approximate [1/m2]; 0 for circular arcs."""

    @property
    def ends(self) -> Array:
        """Curvature at the end of each segment [1/m]."""
        found: Array = self.curvatures + self.sharpnesses * self.lengths
        return found

    @property
    def peaks(self) -> Array:
        """Maximum absolute curvature on each segment [1/m]."""
        found: Array = np.maximum(np.abs(self.curvatures), np.abs(self.ends))
        return found

    @property
    def cusps(self) -> Mask:
        """Whether the tractor stops at each joint between two segments, shape (segments - 1,)."""
        turned: Mask = np.diff(self.directions) != 0
        pauses: Mask = self.lengths == 0
        found: Mask = turned | pauses[:-1] | pauses[1:]
        return found

    def distances(self) -> Array:
        """Return the arc lengths of all joints of segments and of both ends [m], shape (segments + 1,)."""
        return np.concatenate(([0.0], np.cumsum(self.lengths)))

    def joints(self) -> tuple[Array, Array, Array]:
        """Return x [m], y [m] and yaw [rad] of all joints of segments and of both ends, shape (segments + 1,) each."""
        along = self.directions * self.lengths
        turned = along * (self.curvatures + self.sharpnesses * self.lengths / 2)
        yaw = self.start.yaw + np.concatenate(([0.0], np.cumsum(turned)))
        chord, direction = along * np.sinc(turned / (2 * np.pi)), yaw[:-1] + turned / 2
        if (bent := np.flatnonzero(self.sharpnesses)).size:
            chord[bent], aside = self._clothoids(bent)
            direction[bent] = yaw[bent] + aside
        x = self.start.x + np.concatenate(([0.0], np.cumsum(chord * np.cos(direction))))
        y = self.start.y + np.concatenate(([0.0], np.cumsum(chord * np.sin(direction))))
        return x, y, yaw

    def _clothoids(self, which: Index) -> tuple[Array, Array]:
        """Return the chord lengths [m] of the segments with indices `which`, and the chord directions relative to the
        initial headings [rad]."""
        nodes, weights = QUADRATURE
        length, k, c, d = (
            values[which, None] for values in (self.lengths, self.curvatures, self.sharpnesses, self.directions)
        )
        s = length * (nodes + 1) / 2
        ends = (length / 2 * d * np.exp(1j * d * (k + c * s / 2) * s)) @ weights
        return np.abs(ends), np.angle(ends)

    def divided(self) -> "Course":
        """Return the same course, divided into segments of at most STEP_M, and into shorter segments next to cusps."""
        parts = np.maximum(np.ceil(self.lengths / STEP_M), 1).astype(int)
        stops = np.concatenate(([False], self.cusps, [False]))
        if stops.any():
            stops[0] = True  # the course starts at rest
            adjacent = (stops[:-1] | stops[1:]) & (self.lengths > 0)
            parts = np.where(adjacent, np.maximum(parts, PARTS_TO_A_STOP), parts)
        lengths = np.repeat(self.lengths / parts, parts)
        before = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        sharpnesses = np.repeat(self.sharpnesses, parts)
        curvatures = np.repeat(self.curvatures, parts) + sharpnesses * lengths * before
        others = (np.repeat(part, parts) for part in (self.directions, self.pauses, self.trends))
        return Course(self.start, lengths, curvatures, np.repeat(self.speeds, parts), sharpnesses, *others)

    def sharpest(self) -> Place:
        """Return the first point of maximum curvature: the middle of an arc, or the sharper end of a clothoid."""
        x, y, _ = self.joints()
        peaks = self.peaks
        k = int(np.argmax(peaks > 0.999999 * peaks.max()))
        joints = slice(k, k + 2)
        if self.sharpnesses[k]:
            joints = slice(k, k + 1) if abs(self.curvatures[k]) > abs(self.ends[k]) else slice(k + 1, k + 2)
        return Place(float(x[joints].mean()), float(y[joints].mean()), float(self.distances()[joints].mean()))


def chain(start: Pose, pieces: Iterable[Piece], pause: float = 0.0) -> Course:
    """Return the `Course` that consists of the segments `pieces` from the pose `start`, with a pause of `pause` [s] at
    each cusp.

    Segments of zero length are omitted. At a cusp the direction of travel changes.
    """
    kept = [piece for piece in pieces if piece.length > 1e-9]
    if pause > 0:
        kept = list(_with_pauses(kept, pause))
    lengths, curvatures, speeds, sharpnesses, directions, pauses = np.array(kept).T
    return Course(start, lengths, curvatures, speeds, sharpnesses, directions, pauses, sharpnesses)


def _with_pauses(pieces: list[Piece], pause: float) -> Iterable[Piece]:
    """Yield the segments, with a pause between segments of opposite directions. A pause has the curvature of the next
    segment."""
    for piece, following in pairwise(pieces):
        yield piece
        if piece.direction != following.direction:
            yield Piece(0.0, following.curvature, inf, 0.0, following.direction, pause)
    yield pieces[-1]


def checked_length(length: float) -> float:
    """Return `length` [m] unchanged. Raise ValueError if the length exceeds MAX_LENGTH_M."""
    if length > MAX_LENGTH_M:
        raise ValueError(f"the path is {length / 1000:.4g} km long, more than {MAX_LENGTH_M / 1000:g} km; shorten it")
    return length


def samples(length: float) -> int:
    """Return the number of points that approximate a curve of `length` [m]. Raise ValueError if the curve is too
    long."""
    return int(checked_length(length) / max(CURVE_STEP_M, length / 100_000)) + 2


def through(x: Array, y: Array, yaw: Array, speeds: Array | float = inf) -> Course:
    """Return the course along a curve given by points x, y [m] and headings `yaw` [rad], each of shape (n,).

    Arcs join consecutive points; `speeds` [m/s], shape (n - 1,), are the speed limits on the arcs. The deviation from
    the curve is of the order of the squared point distance times the change of curvature.
    """
    yaw = np.unwrap(yaw)
    turned = np.diff(yaw)
    lengths = np.hypot(np.diff(x), np.diff(y)) / np.sinc(turned / (2 * np.pi))
    start = Pose(float(x[0]), float(y[0]), float(yaw[0]))
    curvatures, none = turned / lengths, np.zeros(lengths.shape)
    middles = np.cumsum(lengths) - lengths / 2
    trends = np.gradient(curvatures, middles, edge_order=1) if len(lengths) > 1 else none
    allowed = np.broadcast_to(np.asarray(speeds, dtype=float), lengths.shape)
    return Course(start, lengths, curvatures, allowed, none, none + 1.0, none, trends)


def course_along(start: tuple[float, float, float], x: Array, y: Array, slope: Array) -> Course:
    """Return the course along a curve y(x), given by `x` [m], `y` [m] and `slope` (dy/dx) [-], each of shape (n,).

    `start` is the pose (x [m], y [m], yaw [rad]) of the coordinate frame of the curve.
    """
    x0, y0, yaw = start
    c, s = np.cos(yaw), np.sin(yaw)
    return through(x0 + c * x - s * y, y0 + s * x + c * y, yaw + np.arctan(slope))
