"""Polyline with rounded corners: straight legs joined by bends (fillets).

A bend through the angle beta with an arc of radius r passes its corner at the distance r (1 / cos(beta / 2) - 1). It
starts r tan(beta / 2) before the corner, or slightly earlier with clothoids. The space of a corner is half of the
shorter adjacent leg (the whole leg at the ends of an open path). If the bend needs more space, the clothoids are
shortened and the speed is reduced to limit the steering rate. If the arc alone needs more than `ARC_FRACTION` of the
space, its radius is reduced. With `Rounding.shared`, corners share each leg in proportion to the lengths of their
bends, and a radius above `Rounding.radius` is reduced before the clothoids are shortened.
"""

from collections.abc import Iterator
from math import cos, degrees, inf, isinf, pi, sqrt, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.roots import root
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.track import STEP_M, Course, Piece, chain
from agrobot_mj.paths.transition import Bend, Transitions, bend

ARC_FRACTION = 0.8  # Maximum fraction of the space of a corner that the arc uses [-]; the clothoids use the remainder
MIN_ANGLE = 1e-9  # Minimum angle of a corner; smaller angles are ignored [rad]
MAX_ANGLE = pi - 0.02  # Maximum angle of a corner; larger angles are reversals [rad]
MAX_SHARPNESS = 1e6  # Maximum sharpness of a clothoid: the curvature is then practically a step [1/m2]


class Rounding(NamedTuple):
    """Parameters for rounding the corners of a polyline."""

    radius: float  # Radius of corners with a large angle [m]
    tolerance: float  # Distance between a waypoint and its arc up to which the arc is widened beyond `radius` [m]
    speed: float  # Maximum speed of the path [m/s]
    lateral: float  # Maximum lateral acceleration of the path [m/s2]
    transitions: Transitions  # Type and steering rate of the clothoids
    shared: bool = False  # Whether corners share legs in proportion to the lengths of their bends


class Corner(NamedTuple):
    """Bend that replaces a corner of a polyline, with the maximum speed [m/s] in the bend."""

    bend: Bend
    left: float  # Direction of the turn at the corner: 1 left, -1 right
    speed: float

    @property
    def pieces(self) -> list[Piece]:
        """Course segments of the bend."""
        return self.bend.pieces(self.left, self.speed)


def round_corners(points: Array, closed: bool, how: Rounding, cuts: Array | None = None) -> Course:
    """Return the course of one lap along the polyline `points` with rounded corners.

    `points` has shape (n, 2) or (n, 3): x, y [m] and optionally the maximum speed [m/s]. `cuts`, shape (n,), are added
    to the tolerances of the corners [m].
    """
    legs = np.diff(points[:, :2], axis=0)
    lengths, yaws = np.hypot(*legs.T).tolist(), np.arctan2(legs[:, 1], legs[:, 0]).tolist()
    speeds = points[:, 2].tolist() if points.shape[1] == 3 else None
    count = len(lengths)
    inner = [wrap(yaws[k] - yaws[k - 1]) for k in range(1, count)]
    end = wrap(yaws[0] - yaws[-1]) if closed else 0.0
    angles = [end, *inner, end]
    needs = [corner_weight(angle, how) for angle in angles]
    if not closed:
        needs[0] = needs[-1] = 0.0
    corners: list[Corner | None] = [None]  # before each leg, and after the last leg
    for k in range(1, count + closed):
        angle, before, after = angles[k], lengths[k - 1], lengths[k % count]
        space = min(before / (1 + needs[k - 1] / needs[k]), after / (1 + needs[k % count + 1] / needs[k]))
        if abs(angle) > MAX_ANGLE:
            x, y = points[k, :2].tolist()
            raise ValueError(
                f"the path turns back by {degrees(abs(angle)):.0f} deg at the waypoint ({x:g}, {y:g}) m; remove it, "
                "or add a waypoint next to it"
            )
        speed = min(how.speed, speeds[k]) if speeds else how.speed
        try:
            near = how if cuts is None else how._replace(tolerance=how.tolerance + float(cuts[k]))
            corners.append(corner(angle, space, speed, near) if abs(angle) > MIN_ANGLE else None)
        except ValueError:
            x, y = points[k, :2].tolist()
            raise ValueError(
                f"the legs of {before:.2g} and {after:.2g} m at the waypoint ({x:g}, {y:g}) m are too short for its "
                f"corner of {degrees(abs(angle)):.0f} deg; remove the waypoint"
            ) from None
    if closed:
        corners[0] = corners[-1]
    else:
        corners.append(None)
    start = corners[0].bend.tangent if corners[0] else 0.0
    x, y = (points[0, :2] + start * legs[0] / lengths[0]).tolist()
    return chain(Pose(x, y, yaws[0]), _pieces(lengths, speeds, corners))


def _pieces(lengths: list[float], speeds: list[float] | None, corners: list[Corner | None]) -> Iterator[Piece]:
    """Yield each straight leg, shortened by the bends at its ends, followed by the bend after the leg."""
    for k, length in enumerate(lengths):
        cut = [each.bend.tangent if each else 0.0 for each in corners[k : k + 2]]
        rest = length - cut[0] - cut[1]
        if speeds is None:
            yield Piece(rest)
        else:
            parts = max(1, int(np.ceil(rest / STEP_M)))
            for part in range(parts):
                fraction = (cut[0] + (part + 0.5) / parts * rest) / length
                yield Piece(rest / parts, 0.0, speeds[k] + fraction * (speeds[k + 1] - speeds[k]))
        if bent := corners[k + 1]:
            yield from bent.pieces


def corner_weight(angle: float, how: Rounding) -> float:
    """Return the weight of a corner of `angle` [rad] in the division of the adjacent legs."""
    if not how.shared:
        return 1.0
    turned = min(max(abs(angle), MIN_ANGLE), MAX_ANGLE)
    return bend(turned, how.radius, how.transitions.sharpness(how.speed)).tangent


def corner(angle: float, space: float, speed: float, how: Rounding) -> Corner:
    """Return the bend for a corner of `angle` [rad], positive to the left. The bend starts at most `space` [m] before
    the corner."""
    turned, left = abs(angle), 1.0 if angle > 0 else -1.0
    within = how.tolerance / (1 / cos(turned / 2) - 1) if turned > 1e-6 else inf
    widest = ARC_FRACTION * space / tan(turned / 2)
    radius = min(max(how.radius, within), widest)
    if radius <= 0:
        raise ValueError("there is no space for a bend")

    def limited(radius: float) -> tuple[float, float]:
        """Return the maximum speed [m/s] in an arc of `radius` [m] and the sharpness of its clothoids [1/m2]."""
        allowed = min(speed, sqrt(how.lateral * radius))
        return allowed, how.transitions.sharpness(allowed)

    def excess(radius: float) -> float:
        return bend(turned, radius, limited(radius)[1]).tangent - space

    if how.shared and how.radius < radius and excess(radius) > 0:
        radius = how.radius if excess(how.radius) > 0 else root(excess, how.radius, radius, rtol=1e-9)
    speed, sharpness = limited(radius)
    found = bend(turned, radius, sharpness)
    if isinf(sharpness) or found.tangent <= space * (1 + 1e-9):
        return Corner(found, left, speed)
    sharpness = root(lambda c: bend(turned, radius, c).tangent - space, sharpness, MAX_SHARPNESS, rtol=1e-12)
    return Corner(bend(turned, radius, sharpness), left, min(speed, how.transitions.speed_for(sharpness)))
