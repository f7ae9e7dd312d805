"""Headland turns: from the end of a pass to the start of the next pass in the opposite direction.

- Quarters: two quarter bends joined by a straight, for passes at a sufficient distance.
- `omega`: a bulb of three bends of equal radius: away from the next pass, around towards it, and into the pass.
- `k`: three bends of equal radius: forward through the first part of the turn, in reverse with the wheels turned to the
other side, and forward into the next pass. The middle bend has a cusp at both ends. The turn is as long as a half turn
and needs a headland that is one radius wide.

Each turn is symmetric about the line halfway between the passes and is defined by one angle. An omega turns outwards
through the angle f, back through pi + 2 f, and outwards through f. A k turns forward through the angle a, in reverse
through pi - 2 a, and forward through a. With arcs of radius r and no clothoids, the distance between the passes is

  omega: 2 r (2 cos f - 1),        k: 2 r (1 - 2 cos a).

With clothoids the angle is computed numerically.
"""

from functools import lru_cache
from math import acos, isinf, pi

from agrobot_mj.core.roots import root
from agrobot_mj.paths.arc import Pose, advance
from agrobot_mj.paths.track import Piece
from agrobot_mj.paths.transition import Bend, bend

ROUNDING = 1e-9
"""Relative tolerance for rounding errors in comparisons of distances between passes [-]."""
ORIGIN = Pose(0.0, 0.0, 0.0)


def half_turn_width(radius: float, sharpness: float) -> float:
    """Return the distance [m] between two passes that a single bend through 180 degrees joins."""
    return 2 * bend(pi, radius, sharpness).centre[1]


@lru_cache(maxsize=64)
def headland_turn(left: float, shape: str, radius: float, sharpness: float, speed: float) -> tuple[Piece, ...]:
    """Return the segments of the turn to the next pass, which is `left` [m] to the left and in the opposite direction.

    `shape` (`omega` or `k`) applies to passes that are too close for two quarter bends. `radius` [m] is the radius of
    the arcs, `sharpness` [1/m2] the sharpness of the clothoids, and `speed` [m/s] the maximum speed.
    """
    away, quarter = abs(left), bend(pi / 2, radius, sharpness)
    if away >= 2 * quarter.tangent * (1 - ROUNDING):
        there = quarter.pieces(left, speed)
        return (*there, Piece(away - 2 * quarter.tangent, 0.0, speed), *there)
    if away >= half_turn_width(radius, sharpness) * (1 - ROUNDING):
        return tuple(_half_turn(away, radius, sharpness).pieces(left, speed))
    angle = _angle(away, shape, radius, sharpness)
    return tuple(_three(angle, left, shape, radius, sharpness, speed))


def _half_turn(away: float, radius: float, sharpness: float) -> Bend:
    """Return a 180 degree bend between passes at a distance of `away` [m], with a radius of at least `radius` [m]."""
    if half_turn_width(radius, sharpness) >= away:
        return bend(pi, radius, sharpness)
    wide = root(lambda r: half_turn_width(r, sharpness) - away, radius, away, xtol=1e-12)
    return bend(pi, wide, sharpness)


def _three(angle: float, left: float, shape: str, radius: float, sharpness: float, speed: float) -> list[Piece]:
    """Return the segments of the three bends of an omega or k turn, whose first bend turns through `angle` [rad]."""
    outer = bend(angle, radius, sharpness)
    if shape == "k":
        middle = bend(pi - 2 * angle, radius, sharpness).pieces(-left, speed, -1.0)
        return [*outer.pieces(left, speed), *middle, *outer.pieces(left, speed)]
    middle = bend(pi + 2 * angle, radius, sharpness).pieces(left, speed)
    return [*outer.pieces(-left, speed), *middle, *outer.pieces(-left, speed)]


def _angle(away: float, shape: str, radius: float, sharpness: float) -> float:
    """Return the angle [rad] of the first bend of an omega or k turn between passes `away` metres apart."""
    if isinf(sharpness):
        ratio = away / (2 * radius)
        return acos((1 - ratio) / 2) if shape == "k" else acos((1 + ratio) / 2)

    def too_far(angle: float) -> float:
        pose = ORIGIN
        for piece in _three(angle, 1.0, shape, radius, sharpness, 1.0):
            d = piece.direction
            pose = advance(pose, piece.curvature, d * piece.length, d * piece.sharpness)
        return pose.y - away

    return root(too_far, 1e-6, pi / 2 - 1e-6, xtol=1e-13)
