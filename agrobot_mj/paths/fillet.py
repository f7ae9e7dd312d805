"""A polyline with fillets: straight legs, and a bend in place of each corner.

A bend through the angle beta with an arc of radius r passes its corner at r (1 / cos(beta / 2) - 1) and begins
r tan(beta / 2) before it, a little more with clothoids. Each corner has half of the shorter leg beside it (all of it at
the ends of an open way). Where that is too little for its bend, the clothoids become shorter and the corner slower, so
that the steering rate keeps its limit; and where even the arc takes more than `ARC_SHARE` of it, the radius shrinks.
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

ARC_SHARE = 0.8
"""Largest share of the room beside a corner that the arc alone takes; clothoids take the rest [-]."""
STRAIGHT = 1e-9
"""A corner of less is none [rad]."""
SHARPEST = pi - 0.02
"""A corner of more turns straight back [rad]."""
BRISKEST = 1e6
"""Sharpness beyond which a clothoid counts as none [1/m2]."""


class Rounding(NamedTuple):
    """How corners are rounded."""

    radius: float
    """Radius of a sharp corner [m]."""
    tolerance: float
    """Distance from its waypoint within which a corner may be wider [m]."""
    speed: float
    """Largest speed [m/s]."""
    lateral: float
    """Largest lateral acceleration [m/s2]."""
    transitions: Transitions
    """Clothoids and their steering rate."""


class Corner(NamedTuple):
    """The bend that stands for a corner, and the speed allowed on it [m/s]."""

    bend: Bend
    left: float
    """1 to the left, -1 to the right."""
    speed: float

    @property
    def pieces(self) -> list[Piece]:
        """The bend in pieces."""
        return self.bend.pieces(self.left, self.speed)


def rounded(points: Array, closed: bool, how: Rounding) -> Course:
    """One lap along the polyline `points`, shape (n, 2) or (n, 3): x, y [m] and speed [m/s].

    The last point of a closed way is its first. Raises ValueError, naming the waypoint, where the way turns back.
    """
    legs = np.diff(points[:, :2], axis=0)
    lengths, yaws = np.hypot(*legs.T).tolist(), np.arctan2(legs[:, 1], legs[:, 0]).tolist()
    speeds = points[:, 2].tolist() if points.shape[1] == 3 else None
    count = len(lengths)
    corners: list[Corner | None] = [None]  # in front of each leg, and behind the last
    for k in range(1, count + closed):
        before, after = lengths[k - 1], lengths[k % count]
        room = before if k == 1 and not closed else before / 2
        room = min(room, after if k == count - 1 and not closed else after / 2)
        angle = wrap(yaws[k % count] - yaws[k - 1])
        if abs(angle) > SHARPEST:
            x, y = points[k, :2].tolist()
            raise ValueError(
                f"the way turns back by {degrees(abs(angle)):.0f} deg at the waypoint ({x:g}, {y:g}) m; leave it out, "
                "or put another beside it"
            )
        speed = min(how.speed, speeds[k]) if speeds else how.speed
        corners.append(_corner(angle, room, speed, how) if abs(angle) > STRAIGHT else None)
    if closed:
        corners[0] = corners[-1]
    else:
        corners.append(None)
    start = corners[0].bend.tangent if corners[0] else 0.0
    x, y = (points[0, :2] + start * legs[0] / lengths[0]).tolist()
    return chain(Pose(x, y, yaws[0]), _pieces(lengths, speeds, corners))


def _pieces(lengths: list[float], speeds: list[float] | None, corners: list[Corner | None]) -> Iterator[Piece]:
    """Each leg, cut by the bends on either side of it, and the bend behind it."""
    for k, length in enumerate(lengths):
        cut = [corner.bend.tangent if corner else 0.0 for corner in corners[k : k + 2]]
        rest = length - cut[0] - cut[1]
        if speeds is None:
            yield Piece(rest)
        else:
            parts = max(1, int(np.ceil(rest / STEP_M)))
            for part in range(parts):
                share = (cut[0] + (part + 0.5) / parts * rest) / length
                yield Piece(rest / parts, 0.0, speeds[k] + share * (speeds[k + 1] - speeds[k]))
        if corner := corners[k + 1]:
            yield from corner.pieces


def _corner(angle: float, room: float, speed: float, how: Rounding) -> Corner:
    """The bend of a corner of `angle` [rad], left positive, that begins at most `room` [m] before it."""
    turned, left = abs(angle), 1.0 if angle > 0 else -1.0
    within = how.tolerance / (1 / cos(turned / 2) - 1) if turned > 1e-6 else inf
    radius = min(max(how.radius, within), ARC_SHARE * room / tan(turned / 2))
    speed = min(speed, sqrt(how.lateral * radius))
    sharpness = how.transitions.sharpness(speed)
    found = bend(turned, radius, sharpness)
    if isinf(sharpness) or found.tangent <= room:
        return Corner(found, left, speed)
    sharpness = root(lambda c: bend(turned, radius, c).tangent - room, sharpness, BRISKEST, rtol=1e-12)
    return Corner(bend(turned, radius, sharpness), left, min(speed, how.transitions.speed_for(sharpness)))
