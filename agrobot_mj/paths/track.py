"""A course: the way of a path without its time, as a chain of pieces of constant curvature.

Straights and arcs are such pieces already; a curve becomes a chain of short arcs with the curve's heading at each
joint. So every course is exactly tangent to its heading, and its curvature steps where two pieces meet. Lengths in
metres, curvature in 1/m, left positive; yaw from east, counter-clockwise, not wrapped.
"""

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Place, Pose

STEP_M = 0.5
"""No piece of a divided course is longer [m]."""
CURVE_STEP_M = 0.1
"""Spacing of the arcs that stand for a curve [m]."""
LONGEST_M = 50e3
"""Longest course [m]."""


class Piece(NamedTuple):
    """A stretch of constant curvature."""

    length: float
    """[m]."""
    curvature: float = 0.0
    """[1/m]."""
    speed: float = inf
    """Speed allowed on it [m/s]."""


class Course(NamedTuple):
    """A chain of pieces that begins at `start`; the arrays have shape (pieces,)."""

    start: Pose
    lengths: Array
    """[m], all positive."""
    curvatures: Array
    """[1/m]."""
    speeds: Array
    """Speed allowed on each [m/s]; infinite where only the path's own limits count."""

    def distances(self) -> Array:
        """Way from the start to each joint, both ends included, shape (pieces + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum(self.lengths)))

    def joints(self) -> tuple[Array, Array, Array]:
        """x [m], y [m] and yaw [rad] of each joint, both ends included, each of shape (pieces + 1,)."""
        turned = self.curvatures * self.lengths
        yaw = self.start.yaw + np.concatenate(([0.0], np.cumsum(turned)))
        chord, direction = self.lengths * np.sinc(turned / (2 * np.pi)), yaw[:-1] + turned / 2
        x = self.start.x + np.concatenate(([0.0], np.cumsum(chord * np.cos(direction))))
        y = self.start.y + np.concatenate(([0.0], np.cumsum(chord * np.sin(direction))))
        return x, y, yaw

    def divided(self) -> "Course":
        """The same course in pieces of at most STEP_M."""
        parts = np.ceil(self.lengths / STEP_M).astype(int)
        lengths = np.repeat(self.lengths / parts, parts)
        return Course(self.start, lengths, np.repeat(self.curvatures, parts), np.repeat(self.speeds, parts))

    def sharpest(self) -> Place:
        """Where the curvature is largest: the middle of the first such piece."""
        x, y, _ = self.joints()
        k = int(np.argmax(np.abs(self.curvatures) > 0.999999 * np.abs(self.curvatures).max()))
        distance = float(self.distances()[k : k + 2].mean())
        return Place(float(x[k : k + 2].mean()), float(y[k : k + 2].mean()), distance)


def chain(start: Pose, pieces: Iterable[Piece]) -> Course:
    """The course of these pieces, those without a length left out."""
    lengths, curvatures, speeds = np.array([piece for piece in pieces if piece.length > 1e-9]).T
    return Course(start, lengths, curvatures, speeds)


def affordable(length: float) -> float:
    """`length` [m]. Raises ValueError if no course may be so long."""
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
    return Course(start, lengths, turned / lengths, np.broadcast_to(np.asarray(speeds, dtype=float), lengths.shape))


def placed(start: tuple[float, float, float], x: Array, y: Array, slope: Array) -> Course:
    """The course along y(x) of `slope` dy/dx, each of shape (n,), x along the axis from `start` (x, y, yaw)."""
    x0, y0, yaw = start
    c, s = np.cos(yaw), np.sin(yaw)
    return through(x0 + c * x - s * y, y0 + s * x + c * y, yaw + np.arctan(slope))
