"""Connections between two poses: three segments with limited curvature, built from arcs or clothoids.

The types of connections (words) are bend-straight-bend and three bends of [Dubins1957], and three bends with a reverse
middle bend of [ReedsShepp1990]. With arcs, the three parameters have a closed form. With clothoids, the parameters are
computed numerically. The initial guess is the closed form for arcs with the same lateral distance of the bend centre.
"""

from collections.abc import Iterator
from functools import lru_cache
from math import acos, atan2, cos, hypot, inf, isinf, pi, sin, sqrt
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, to_heading, wrap
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Pose, advance
from agrobot_mj.paths.track import Piece
from agrobot_mj.paths.transition import bend

TURN = 2 * pi
LEAST_ANGLE = 1e-7  # Angle below which a bend is omitted [rad]
CLOSE = 1e-6  # Maximum error at the end of a connection [m, rad]
GRID = 1e-6  # Resolution to which relative poses are rounded, so that equal connections are computed once [m, rad]


class Bends(NamedTuple):
    """Radius, sharpness and speed of the bends of a connection between two poses."""

    radius: float  # Radius of arcs [m]
    sharpness: float = inf
    """Maximum change of curvature per metre [1/m2], or infinity for circular arcs without clothoids."""
    speed: float = inf  # Maximum speed [m/s]

    @property
    def reach(self) -> float:
        """Lateral distance from the start of a bend to its centre [m], which is the radius without clothoids."""
        return bend(pi, self.radius, self.sharpness).centre[1]


class Word(NamedTuple):
    """Type of a connection between two poses: two outer bends and the segment between them."""

    first: int  # Side of the first bend: 1 left, -1 right
    middle: int  # Side of the middle bend, or 0 for a straight segment
    last: int  # Side of the last bend
    reverse: bool = False  # Whether the middle bend is driven in reverse

    @property
    def mirrored(self) -> "Word":
        """Connection type with left and right exchanged."""
        return Word(-self.first, -self.middle, -self.last, self.reverse)


FORWARD = (*(Word(a, 0, b) for a in (1, -1) for b in (1, -1)), Word(1, -1, 1), Word(-1, 1, -1))
"""Connection types without reverse segments."""
REVERSING = (Word(1, -1, 1, True), Word(-1, 1, -1, True))  # Connection types whose middle bend is driven in reverse


def length_of(pieces: tuple[Piece, ...]) -> float:
    """Return the total length of path segments [m]."""
    return sum(piece.length for piece in pieces)


def end_of(start: Pose, pieces: tuple[Piece, ...] | list[Piece]) -> Pose:
    """Return the end pose of a sequence of path segments that starts at the pose `start`."""
    for piece in pieces:
        start = advance(start, piece.curvature, piece.direction * piece.length, piece.direction * piece.sharpness)
    return start


def straight(length: float, speed: float = inf) -> tuple[Piece, ...]:
    """Return a straight segment of `length` [m], or an empty tuple for zero length."""
    return (Piece(length, 0.0, speed),) if length > 1e-9 else ()


def connections(start: Pose, goal: Pose, bends: Bends, words: tuple[Word, ...] = FORWARD) -> list[tuple[Piece, ...]]:
    """Return all connections of the types `words` from the pose `start` to the pose `goal`, shortest first."""
    ahead, left = to_heading(start.yaw, goal.x - start.x, goal.y - start.y)
    key = tuple(round(value / GRID) * GRID for value in (ahead, left, wrap(goal.yaw - start.yaw)))
    return list(_connections(*key, bends, words))


@lru_cache(maxsize=4096)
def _connections(
    ahead: float, left: float, yaw: float, bends: Bends, words: tuple[Word, ...]
) -> tuple[tuple[Piece, ...], ...]:
    goal = Pose(ahead, left, yaw)
    found = [pieces for word in words for pieces in _solutions(word, goal, bends)]
    return tuple(sorted(found, key=length_of))


def shortest_arcs(start: Pose, goal: Pose, radius: float) -> float:
    """Return the length of the shortest forward connection between two poses by arcs and straight segments [m]."""
    ahead, left = to_heading(start.yaw, goal.x - start.x, goal.y - start.y)
    relative = Pose(ahead, left, wrap(goal.yaw - start.yaw))
    lengths = [
        radius * (a + c) + (b if word.middle == 0 else radius * b)
        for word in FORWARD
        for a, b, c in _arcs(word, relative, radius)
    ]
    return min(lengths, default=inf)


def _solutions(word: Word, goal: Pose, bends: Bends) -> Iterator[tuple[Piece, ...]]:
    """Yield the paths with the sequence of bends `word` from the origin to the pose `goal`, as tuples of segments."""
    for guess in _arcs(word, goal, bends.reach):
        found = guess if isinf(bends.sharpness) else _refine_clothoids(word, guess, goal, bends)
        if found is None or (word.middle == 0 and found[1] < 0):
            continue
        pieces = tuple(_pieces(word, found, bends))
        end = end_of(Pose(0.0, 0.0, 0.0), pieces)
        if hypot(end.x - goal.x, end.y - goal.y) < CLOSE and abs(wrap(end.yaw - goal.yaw)) < CLOSE:
            yield pieces


def _pieces(word: Word, values: tuple[float, float, float], bends: Bends) -> Iterator[Piece]:
    """Yield the path segments of a connection between two poses. `values` are bend angles [rad] and the length of a
    straight segment [m]. A negative angle exchanges left and right of the bend."""
    sides = (word.first, word.middle, word.last)
    for k, (side, value) in enumerate(zip(sides, values, strict=True)):
        if side == 0:
            yield from straight(abs(value), bends.speed)
        elif abs(value) > LEAST_ANGLE:
            direction = -1.0 if k == 1 and word.reverse else 1.0
            turn = bend(abs(value), bends.radius, bends.sharpness)
            yield from turn.pieces(side * value, bends.speed, direction)


def _refine_clothoids(
    word: Word, guess: tuple[float, float, float], goal: Pose, bends: Bends
) -> tuple[float, float, float] | None:
    """Return the bend angles [rad] and straight length [m] of a connection with clothoids, found numerically from the
    initial values `guess`, or None without a solution."""
    from scipy.optimize import fsolve  # slow import, needed only with clothoids

    def error(values: Array) -> tuple[float, float, float]:
        x, y, yaw = 0.0, 0.0, 0.0
        for k, (side, value) in enumerate(zip(word[:3], values.tolist(), strict=True)):
            backwards = k == 1 and word.reverse
            dx, dy, turned = (value, 0.0, 0.0) if side == 0 else _displacement(side, value, backwards, bends)
            east, north = from_heading(yaw, dx, dy)
            x, y, yaw = x + east, y + north, yaw + turned
        return x - goal.x, y - goal.y, wrap(yaw - goal.yaw)

    found, _, status, _ = fsolve(error, guess, full_output=True, xtol=1e-12)
    a, b, c = (float(value) for value in found)
    sane = status == 1 and max(abs(a), abs(c)) < TURN and (word.middle == 0 or abs(b) < TURN)
    return (a, b, c) if sane else None


def _displacement(side: int, angle: float, backwards: bool, bends: Bends) -> tuple[float, float, float]:
    """Return the end of a bend relative to its start pose: ahead [m], left [m] and heading change [rad]. The bend is
    symmetric about a line through its centre."""
    turned = abs(angle)
    if turned < LEAST_ANGLE:
        return 0.0, 0.0, 0.0
    x, y = _centre(bends) if turned >= 1 / (bends.radius**2 * bends.sharpness) else bend(turned, *bends[:2]).centre
    ahead = x + x * cos(turned) + y * sin(turned)
    left = y + x * sin(turned) - y * cos(turned)
    side = side if angle > 0 else -side
    return (-ahead, side * left, -side * turned) if backwards else (ahead, side * left, side * turned)


@lru_cache(maxsize=64)
def _centre(bends: Bends) -> tuple[float, float]:
    """Return the centre of a bend that reaches its minimum radius, relative to the start pose of the bend: ahead [m]
    and to the side [m]."""
    return bend(TURN, *bends[:2]).centre


def _arcs(word: Word, goal: Pose, radius: float) -> Iterator[tuple[float, float, float]]:
    """Yield the bend angles [rad] and straight length [m] of connections with arcs of `radius` [m] from the origin to
    `goal`."""
    if word.first < 0:
        word, goal = word.mirrored, Pose(goal.x, -goal.y, -goal.yaw)
    side = word.last
    x = goal.x - side * radius * sin(goal.yaw)
    y = goal.y + side * radius * cos(goal.yaw) - radius  # from the first circle's centre to the last
    apart, towards = hypot(x, y), atan2(y, x)
    if word.middle == 0:
        across = 0.0 if side > 0 else 2 * radius
        if apart >= across:
            along = sqrt(apart**2 - across**2)
            heading = towards + atan2(across, along)
            yield _turn(heading), along, _turn(side * (goal.yaw - heading))
    elif 0.0 < apart <= 4 * radius:
        for sign in (1, -1):
            before = towards + sign * acos(apart / (4 * radius)) + pi / 2
            centre = 2 * radius * sin(before), -2 * radius * cos(before)
            after = atan2(centre[1] - y, centre[0] - x) + pi / 2
            middle = _turn(after - before if word.reverse else before - after)
            yield _turn(before), middle, _turn(goal.yaw - after)


def _turn(angle: float) -> float:
    """Return an angle in the range [0, 2 pi) [rad]. Angles that differ from 2 pi only by rounding errors become 0."""
    turned = angle % TURN
    return 0.0 if TURN - turned < LEAST_ANGLE else turned
