"""A course: the way of a path without its time, as a chain of arcs and clothoids driven forward or in reverse.

The curvature is constant on a piece or changes linearly. Straights, arcs and clothoids are such pieces already; any
other curve becomes a chain of short arcs with the curve's heading at each joint, so that every course is exactly
tangent to its heading. Where the direction of driving changes there is a cusp: the course stops, its heading goes on.
Lengths [m] are driven lengths, positive in reverse too; curvature [1/m] is left positive, yaw [rad] the heading of the
tractor from east, counter-clockwise, not wrapped.
"""

from collections.abc import Iterable
from itertools import pairwise
from math import inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Place, Pose

STEP_M = 0.5
"""Largest length of a piece of a divided course [m]."""
PARTS_TO_A_STOP = 8
"""Parts, at least, of a piece that begins or ends at a cusp, so that the speed may rise and fall on it [-]."""
CURVE_STEP_M = 0.1
"""Spacing of the arcs that stand for a curve [m]."""
LONGEST_M = 50e3
"""Largest length of a course [m]."""
QUADRATURE = np.polynomial.legendre.leggauss(32)
"""Nodes and weights that integrate the direction along a clothoid that turns through up to 10 rad to rounding."""


Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.signedinteger]]


class Piece(NamedTuple):
    """A straight, an arc, a clothoid, or a pause between two of them."""

    length: float
    """Length [m]; 0 for a pause."""
    curvature: float = 0.0
    """Curvature at its beginning [1/m]."""
    speed: float = inf
    """Speed allowed on it [m/s]."""
    sharpness: float = 0.0
    """Change of curvature per metre driven [1/m2]."""
    direction: float = 1.0
    """1 forward, -1 in reverse [-]."""
    pause: float = 0.0
    """Time to stand still, on a piece without length [s]."""


class Course(NamedTuple):
    """A chain of pieces that begins at `start`; the arrays have shape (pieces,)."""

    start: Pose
    lengths: Array
    """Lengths, all positive but those of pauses, which are 0 [m]."""
    curvatures: Array
    """Curvature at the beginning of each piece [1/m]."""
    speeds: Array
    """Speed allowed on each [m/s]; infinite where only the path's own limits count."""
    sharpnesses: Array
    """Change of curvature per metre driven on each [1/m2]."""
    directions: Array
    """1 forward, -1 in reverse, of each [-]."""
    pauses: Array
    """Time to stand still of each [s]."""
    trends: Array
    """Change of curvature per metre driven of the curve that each stands for: 0 on a true arc [1/m2]."""

    @property
    def ends(self) -> Array:
        """Curvature at the end of each piece [1/m]."""
        found: Array = self.curvatures + self.sharpnesses * self.lengths
        return found

    @property
    def peaks(self) -> Array:
        """Largest absolute curvature of each piece [1/m]."""
        found: Array = np.maximum(np.abs(self.curvatures), np.abs(self.ends))
        return found

    @property
    def cusps(self) -> Mask:
        """Whether the course stops at each joint, both ends and pauses left out, shape (pieces - 1,)."""
        turned: Mask = np.diff(self.directions) != 0
        pauses: Mask = self.lengths == 0
        found: Mask = turned | pauses[:-1] | pauses[1:]
        return found

    def distances(self) -> Array:
        """Way from the start to each joint, both ends included, shape (pieces + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum(self.lengths)))

    def joints(self) -> tuple[Array, Array, Array]:
        """x [m], y [m] and yaw [rad] of each joint, both ends included, each of shape (pieces + 1,)."""
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
        """Chord [m] of each of these pieces, and its direction from the heading at their beginning [rad]."""
        nodes, weights = QUADRATURE
        length, k, c, d = (
            values[which, None] for values in (self.lengths, self.curvatures, self.sharpnesses, self.directions)
        )
        s = length * (nodes + 1) / 2
        ends = (length / 2 * d * np.exp(1j * d * (k + c * s / 2) * s)) @ weights
        return np.abs(ends), np.angle(ends)

    def divided(self) -> "Course":
        """The course divided into pieces of at most STEP_M."""
        parts = np.maximum(np.ceil(self.lengths / STEP_M), 1).astype(int)
        stops = np.concatenate(([False], self.cusps, [False]))
        if stops.any():
            stops[0] = True  # the course begins at rest
            beside = (stops[:-1] | stops[1:]) & (self.lengths > 0)
            parts = np.where(beside, np.maximum(parts, PARTS_TO_A_STOP), parts)
        lengths = np.repeat(self.lengths / parts, parts)
        before = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        sharpnesses = np.repeat(self.sharpnesses, parts)
        curvatures = np.repeat(self.curvatures, parts) + sharpnesses * lengths * before
        others = (np.repeat(part, parts) for part in (self.directions, self.pauses, self.trends))
        return Course(self.start, lengths, curvatures, np.repeat(self.speeds, parts), sharpnesses, *others)

    def sharpest(self) -> Place:
        """Place of the largest curvature: the middle of the first such arc, or the sharper end of the clothoid."""
        x, y, _ = self.joints()
        peaks = self.peaks
        k = int(np.argmax(peaks > 0.999999 * peaks.max()))
        joints = slice(k, k + 2)
        if self.sharpnesses[k]:
            joints = slice(k, k + 1) if abs(self.curvatures[k]) > abs(self.ends[k]) else slice(k + 1, k + 2)
        return Place(float(x[joints].mean()), float(y[joints].mean()), float(self.distances()[joints].mean()))


def chain(start: Pose, pieces: Iterable[Piece], pause: float = 0.0) -> Course:
    """The course of these pieces, those without a length left out; at cusps it stands still for `pause` [s]."""
    kept = [piece for piece in pieces if piece.length > 1e-9]
    if pause > 0:
        kept = list(_with_pauses(kept, pause))
    lengths, curvatures, speeds, sharpnesses, directions, pauses = np.array(kept).T
    return Course(start, lengths, curvatures, speeds, sharpnesses, directions, pauses, sharpnesses)


def _with_pauses(pieces: list[Piece], pause: float) -> Iterable[Piece]:
    """Between pieces of opposite directions a pause, with the curvature of the next: the wheels turn meanwhile."""
    for piece, following in pairwise(pieces):
        yield piece
        if piece.direction != following.direction:
            yield Piece(0.0, following.curvature, inf, 0.0, following.direction, pause)
    yield pieces[-1]


def affordable(length: float) -> float:
    """Return `length` [m] unchanged. Raises ValueError if it is more than a course may have."""
    if length > LONGEST_M:
        raise ValueError(f"is {length / 1000:.4g} km long, at most {LONGEST_M / 1000:g} km; make it shorter")
    return length


def samples(length: float) -> int:
    """How many points stand for a curve of about this length [m]. Raises ValueError if it is too long."""
    return int(affordable(length) / max(CURVE_STEP_M, length / 100_000)) + 2


def through(x: Array, y: Array, yaw: Array, speeds: Array | float = inf) -> Course:
    """The course along a curve given by close points x, y [m] and its headings `yaw` [rad], each of shape (n,).

    An arc joins each point to the next; `speeds` [m/s], shape (n - 1,), belong to the arcs. The course keeps to the
    curve to the order of the spacing squared times the change of curvature.
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


def placed(start: tuple[float, float, float], x: Array, y: Array, slope: Array) -> Course:
    """The course along y(x) of `slope` dy/dx, each of shape (n,), x along the axis from `start` (x, y, yaw)."""
    x0, y0, yaw = start
    c, s = np.cos(yaw), np.sin(yaw)
    return through(x0 + c * x - s * y, y0 + s * x + c * y, yaw + np.arctan(slope))
