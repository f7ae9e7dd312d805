"""Merging of short sides of a closed polyline, so that one bend replaces a run of small corners.

Each corner is a bend of two clothoids and an arc within its share of the adjacent sides. Between short sides, the
clothoids are so short that the steering rate limits the speed to a crawl. A run of corners is therefore replaced by the
intersection of the sides at its ends, by one of its corners, or by the middle of a side. The bend at the new corner
follows the original polyline with the maximum radius that fits. The new bends and sides must

- approach the boundary or obstacle by at most `NEARER_M`,
- deviate to the other side by at most a given distance from the polyline rounded with the turn radius, and
- not be slower than the bends that they replace.
"""

from cmath import phase, rect
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import LinearRing, LineString, Polygon
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.fillet import MAX_ANGLE, MIN_ANGLE, Rounding, corner, corner_weight
from agrobot_mj.paths.track import chain

MITRE = 5.0  # Maximum length of a mitred corner divided by the offset of the boundary [-]
NEARER_M = 0.05  # Maximum deviation towards the boundary or obstacle [m]
LONGEST = 10  # Maximum number of corners that one corner replaces at once [-]
LEAST, WIDEST = 0.1, 2.1  # Limits of the angle of an intersection [rad]. Assumed values.


def merge_corners(points: Array, how: Rounding, clearance: float, deviation: float) -> tuple[Array, Array]:
    """Return the corners of a closed polyline after merging, shape (n, 2) [m], and their cuts, shape (n,) [m].

    A cut is the distance of a corner from the original polyline. The boundary of the field is `clearance` [m] outside a
    counter-clockwise polyline; an obstacle is `clearance` inside a clockwise one. `deviation` [m] is the maximum
    deviation away from the boundary or obstacle.
    """
    sides = _Sides(points, how, _limits(points, how, clearance, deviation))
    waiting = sides.slow(set(sides.corners))
    while waiting and len(sides.corners) > 3:
        slowest = min(waiting, key=lambda k: sides.bends[k].speed)
        changed = sides.remove_at(slowest)
        waiting = sides.slow(waiting | changed) - (set() if changed else {slowest})
    order = sides.order()
    corners = np.array([sides.corners[k].at for k in order])
    return np.column_stack([corners.real, corners.imag]), np.array([sides.corners[k].cut for k in order])


class _Corner(NamedTuple):
    """Corner of a polyline as a complex number, and its distance from the original polyline [m]."""

    at: complex
    cut: float = 0.0


class _Limits(NamedTuple):
    """Limits of the deviation of a closed polyline."""

    original: LinearRing
    allowed: BaseGeometry  # Area that keeps the clearance from the boundary or obstacle
    near: BaseGeometry  # Area within the maximum deviation of straight sides away from the boundary or obstacle
    bends: BaseGeometry  # Area within the maximum deviation of bends, which is larger by the tolerance of corners


def _limits(points: Array, how: Rounding, clearance: float, deviation: float) -> _Limits:
    area, ring = Polygon(points), LinearRing(points)
    everywhere = area.buffer(2 * clearance + 2 * deviation)
    deviations = deviation, deviation + how.tolerance
    if ring.is_ccw:
        allowed = area.buffer(clearance, join_style="mitre", mitre_limit=MITRE).buffer(NEARER_M - clearance)
        turned = area.buffer(-how.radius)
        near = [everywhere.difference(turned.buffer(how.radius - each)) for each in deviations]
    else:
        obstacle = area.buffer(-clearance, join_style="mitre", mitre_limit=MITRE)
        kept = area.buffer(-NEARER_M) if obstacle.is_empty else obstacle.buffer(clearance - NEARER_M)
        turned = area.buffer(how.radius)
        allowed, near = everywhere.difference(kept), [turned.buffer(each - how.radius) for each in deviations]
    shapely.prepare([allowed, *near])
    return _Limits(ring, allowed, *near)


class _Bend(NamedTuple):
    """Maximum speed in the bend at a corner [m/s], and whether its deviation from the lap is allowed."""

    speed: float
    fits: bool


class _Sides:
    """Corners of a closed polyline as a linked list, with their bends."""

    def __init__(self, points: Array, how: Rounding, limits: _Limits) -> None:
        count = len(points)
        self.how, self.limits = how, limits
        self.corners = {k: _Corner(complex(x, y)) for k, (x, y) in enumerate(points.tolist())}
        self.before = {k: (k - 1) % count for k in range(count)}
        self.after = {k: (k + 1) % count for k in range(count)}
        self.needs = {k: corner_weight(self._angle(k), how) for k in range(count)}
        self.bends = {k: self._bend(k) for k in range(count)}

    def slow(self, which: set[int]) -> set[int]:
        """Return the corners of `which` that limit the speed."""
        return {k for k in which & self.corners.keys() if self.bends[k].speed < self.how.speed}

    def order(self) -> list[int]:
        """Return the numbers of the corners in the order of driving."""
        found = [min(self.corners)]
        while (following := self.after[found[-1]]) != found[0]:
            found.append(following)
        return found

    def remove_at(self, k: int) -> set[int]:
        """Replace a run of corners that contains corner `k` by one corner, the shortest possible run first. Return the
        corners with changed bends, or an empty set if there is no such run."""
        tries = ((run, new) for run in self._runs(k) for new in self._replacements(run, k))
        return next(filter(None, (self._replace_run(*each) for each in tries)), set())

    def _runs(self, k: int) -> Iterator[list[int]]:
        """Yield the runs of 2 to LONGEST corners that contain corner `k`, without the whole polyline."""
        for count in range(2, min(LONGEST, len(self.corners) - 2) + 1):
            run = [k]
            while len(run) < count:
                run.insert(0, self.before[run[0]])
            for _ in range(count):
                yield run
                run = [*run[1:], self.after[run[-1]]]

    def _side(self, a: int, b: int) -> complex:
        return self.corners[b].at - self.corners[a].at

    def _angle(self, k: int) -> float:
        """Return the change of direction at a corner, positive to the left [rad]."""
        before, after = self._side(self.before[k], k), self._side(k, self.after[k])
        return phase(after / before) if before and after else 0.0

    def _replacements(self, run: list[int], k: int) -> Iterator[_Corner]:
        """Yield the corners that can replace a run: the intersection of the sides at its ends and, for two corners, the
        middle of their side and the corner `k`."""
        first, last = self.before[run[0]], self.after[run[-1]]
        one, two, across = self._side(first, run[0]), self._side(run[-1], last), self._side(run[0], run[-1])
        total = sum(map(self._angle, run))
        if LEAST < abs(total) < WIDEST and one and two:
            ahead = (across.conjugate() * two).imag / (one.conjugate() * two).imag
            at = self.corners[run[0]].at + ahead * one
            outside = ahead > 0 and (one.conjugate() * across).imag * total > 0
            yield _Corner(at, self.limits.original.distance(shapely.Point(at.real, at.imag)) if outside else 0.0)
        if len(run) == 2:
            yield _Corner(self.corners[run[0]].at + across / 2)
            yield self.corners[k]

    def _replace_run(self, run: list[int], new: _Corner) -> set[int]:
        """Replace a run by the corner `new`, and return the corners with changed bends, or an empty set if the new
        bends violate the conditions."""
        (a, *gone), first, last = run, self.before[run[0]], self.after[run[-1]]
        around = {self.before[first], first, *run, last, self.after[last]}
        state: tuple[dict[int, Any], ...] = (self.corners, self.before, self.after, self.needs, self.bends)
        old = [{k: values[k] for k in around} for values in state]
        earlier: dict[int, _Bend] = old[-1]
        self.corners[a] = new
        self.after[a], self.before[last] = last, a
        for values in state:
            for k in gone:
                del values[k]
        changed = around & self.corners.keys()
        self.needs.update({k: corner_weight(self._angle(k), self.how) for k in (first, a, last)})
        slowest = min(bend.speed for bend in earlier.values())
        for k in (a, *changed - {a}):
            found = self.bends[k] = self._bend(k)
            if found.speed < slowest or not (found.fits or (k != a and not earlier[k].fits)):
                for values, kept in zip(state, old, strict=True):
                    values.update(kept)
                return set()
        return changed

    def _bend(self, k: int) -> _Bend:
        """Return the bend at a corner. The limits apply from the middle of the side before the corner to the middle of
        the side after the corner."""
        here, first, last = self.corners[k], self.before[k], self.after[k]
        before, after, angle = self._side(first, k), self._side(k, last), self._angle(k)
        ends = here.at - before / 2, here.at + after / 2
        if abs(angle) < MIN_ANGLE:
            return _Bend(self.how.speed, self._fits(ends))
        if abs(angle) > MAX_ANGLE:
            return _Bend(0.0, False)
        shares = (abs(side) / (1 + self.needs[j] / self.needs[k]) for side, j in ((before, first), (after, last)))
        how = self.how._replace(tolerance=self.how.tolerance + here.cut)
        try:
            found = corner(angle, min(shares), how.speed, how)
        except ValueError:
            return _Bend(0.0, False)
        start = here.at - rect(found.bend.tangent, phase(before))
        x, y, _ = chain(Pose(start.real, start.imag, phase(before)), found.pieces).divided().joints()
        bend = (x + 1j * y).tolist()
        return _Bend(found.speed, self._fits((ends[0], bend[0]), bend, (bend[-1], ends[1])))

    def _fits(self, *lines: Sequence[complex]) -> bool:
        """Return whether lines keep the limits of the deviation. The second line is a bend."""
        limits = self.limits.near, self.limits.bends, self.limits.near
        drawn = [LineString([(point.real, point.imag) for point in line]) for line in lines]
        return all(self.limits.allowed.covers(a) and b.covers(a) for a, b in zip(drawn, limits, strict=False))
