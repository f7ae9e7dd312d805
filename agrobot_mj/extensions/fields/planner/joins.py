"""Connections between passes: turns at the ends of adjacent passes, and routes along headland laps to distant passes.

Candidates are evaluated in groups: the preferred turn; other connections, some with a reverse segment; and routes along
a lap. For distant passes, the last two groups are combined. A candidate is free if it stays inside the field and does
not cross the field body. The result is the cheapest free candidate of the first group that contains one. Without
free candidates, the result is the cheapest candidate, and the plan contains a warning.
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import chain, pairwise
from math import hypot, pi
from typing import Literal, NamedTuple

import numpy as np
import shapely

from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.roots import root
from agrobot_mj.extensions.fields.planner.area import TOLERANCE_M, Area
from agrobot_mj.extensions.fields.planner.laps import Ring, drivable, from_point, pieces_of
from agrobot_mj.extensions.fields.planner.rig import FieldMachine, implement_boxes, tractor_boxes, tractor_poses
from agrobot_mj.extensions.fields.planner.words import (
    REVERSING,
    Bends,
    connections,
    end_of,
    length_of,
    shortest_arcs,
    straight,
)
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.headland import half_turn_width, headland_turn
from agrobot_mj.paths.track import Piece
from agrobot_mj.paths.track import chain as linked
from agrobot_mj.paths.transition import bend

Shape = Literal["omega", "bulb", "clothoid", "k"]
Pieces = tuple[Piece, ...]
NEAR = 6.0  # Distance below which a turn joins the ends of two passes [turn radii]. Assumed value.
OUTSIDE, ACROSS = 50.0, 5.0
"""Cost of a connection between passes as additional path length per metre outside the field, and per metre across the
area inside the headland laps [-]. Assumed values."""
CUSP_M = 5.0  # Cost of a cusp (change of driving direction) [m], as additional path length. Assumed value.
GENTLE = (2.0, 3.0)  # Radii of gentle bends, as multiples of the turn radius [-]
FORWARD_TRIED = 3  # Maximum number of evaluated forward connections between two passes
STEPS, STEP = 13, 0.5  # Number of points at which a route may enter or leave a lap, and their spacing [turn radii]
ROUTES_TRIED = 8  # Maximum number of evaluated routes along laps, shortest first


class Join(NamedTuple):
    """Connection between two passes, with its maximum distance outside the field and its length inside the headland
    laps."""

    pieces: Pieces
    outside: float = 0.0  # Distance beyond the boundary that exceeds the permitted distance [m]
    across: float = 0.0  # Path length across the body of the field [m]

    @property
    def free(self) -> bool:
        """Whether the connection stays inside the field and does not cross the area inside the headland laps."""
        return self.outside <= 0.0 and self.across <= TOLERANCE_M

    @property
    def cost(self) -> float:
        """Length of the connection plus penalties for leaving the field, for crossing the area inside the headland
        laps, and for cusps [m]."""
        cusps = sum(a.direction != b.direction for a, b in pairwise(self.pieces))
        return length_of(self.pieces) + OUTSIDE * self.outside + ACROSS * self.across + CUSP_M * cusps


def join(area: Area, start: Pose, goal: Pose, shape: Shape) -> Join:
    """Return the best connection from pose `start` to pose `goal`. `shape` is the preferred turn shape."""
    found: list[Join] = []
    for tier in _tiers(area, start, goal, shape):
        tried = [Join(pieces, *area.faults(start, pieces)) for pieces in tier]
        if free := [candidate for candidate in tried if candidate.free]:
            return min(free, key=lambda each: each.cost)
        found += tried
    return min(found, key=lambda each: each.cost)


def _tiers(area: Area, start: Pose, goal: Pose, shape: Shape) -> Iterator[Iterator[Pieces]]:
    """Yield groups of candidate connections between two poses, the preferred group first."""
    near = hypot(goal.x - start.x, goal.y - start.y) < NEAR * area.rig.bends.radius
    if opposite := abs(wrap(goal.yaw - start.yaw - pi)) < 1e-6:
        yield _turns(start, goal, shape, area.rig.bends)
    others = _others(start, goal, area.rig, opposite)
    if near:
        yield others
        yield _routes(area, start, goal)
    else:
        yield chain(_routes(area, start, goal), others)


def _others(start: Pose, goal: Pose, rig: FieldMachine, opposite: bool) -> Iterator[Pieces]:
    """Yield forward connections between two poses, also with larger radii for wide implements, and then connections
    with a reverse segment unless the machine only drives forward."""
    bends = rig.bends
    yield from connections(start, goal, bends)[:FORWARD_TRIED]
    for factor in GENTLE:
        yield from connections(start, goal, bends._replace(radius=factor * bends.radius))[:1]
    if rig.forward_only:
        return
    if opposite:
        yield from _turns(start, goal, "k", bends)
    yield from connections(start, goal, bends, REVERSING)


def _turns(start: Pose, goal: Pose, shape: Shape, bends: Bends) -> Iterator[Pieces]:
    """Yield the turn to the opposite pass that starts at `goal`. The turn starts beyond the ends of both passes."""
    ahead, left = to_heading(start.yaw, goal.x - start.x, goal.y - start.y)
    if abs(left) < 1e-6:
        return
    beyond = max(ahead, 0.0)
    if shape == "bulb" and abs(left) < half_turn_width(*bends[:2]):
        turn, further = _bulb(abs(left), bends)
        turn = turn if left > 0 else tuple(_mirror(piece) for piece in turn)
    else:
        turn, further = headland_turn(left, "k" if shape == "k" else "omega", *bends), 0.0
    yield (*straight(beyond), *turn, *straight(beyond + further - ahead))


def depth_of_turn(rig: FieldMachine, shape: Shape) -> float:
    """Return how far the machine extends beyond the ends of two adjacent passes during a turn [m].

    The ends of both passes are on a line perpendicular to the passes.
    """
    start, goal = Pose(rig.behind, 0.0, 0.0), Pose(rig.behind, rig.spacing, pi)
    turn = next(_turns(start, goal, shape, rig.bends))
    x, y, yaw = tractor_poses(linked(start, turn).divided(), rig.cg_to_rear_axle)
    bar = x - rig.behind * np.cos(yaw), y - rig.behind * np.sin(yaw), yaw
    outlines = np.concatenate([tractor_boxes(rig, x, y, yaw), implement_boxes(rig, *bar)])
    return float(shapely.bounds(outlines)[:, 2].max())


def _mirror(piece: Piece) -> Piece:
    return piece._replace(curvature=-piece.curvature, sharpness=-piece.sharpness)


@lru_cache(maxsize=256)
def _bulb(away: float, bends: Bends) -> tuple[Pieces, float]:
    """Return a turn to a pass at `away` [m] to the left, and the distance of its end ahead of its start [m].

    The turn is a bend to the right by an angle f, followed by a bend to the left by pi + f. With arcs, cos f = away /
    (2 radius).
    """

    def turn(flare: float) -> Pieces:
        out, back = bend(flare, *bends[:2]), bend(pi + flare, *bends[:2])
        return (*out.pieces(-1.0, bends.speed), *back.pieces(1.0, bends.speed))

    flare = root(lambda f: end_of(Pose(0.0, 0.0, 0.0), turn(f)).y - away, 1e-6, pi / 2)
    return turn(flare), end_of(Pose(0.0, 0.0, 0.0), turn(flare)).x


def _routes(area: Area, start: Pose, goal: Pose) -> Iterator[Pieces]:
    """Yield connections along headland laps in both directions, in order of increasing estimated length."""
    radius, ranked = area.rig.bends.reach, []
    for ring in area.laps:
        for way in (ring, ring.reversed):
            places = [_places(way, pose, sign * STEP * radius) for pose, sign in ((start, 1), (goal, -1))]
            first = min(places[0], key=lambda place: shortest_arcs(start, place[1], radius) - place[2])
            last = min(places[1], key=lambda place: shortest_arcs(place[1], goal, radius) - place[2])
            along = (last[0] - first[0]) % way.line.length
            ends = shortest_arcs(start, first[1], radius) + shortest_arcs(last[1], goal, radius)
            ranked.append((ends + along, way, first, along, last))
    for _, way, first, along, last in sorted(ranked, key=lambda each: each[0])[:ROUTES_TRIED]:
        yield from _route(area, start, goal, way, first, along, last)


Place = tuple[float, Pose, float]
"""Point on a headland lap: arc length [m], pose, and distance along the lap from the point nearest to start or goal
[m]."""


def _places(ring: Ring, pose: Pose, step: float) -> list[Place]:
    """Return points, `step` [m] apart along a headland lap, at which a route may enter or leave the lap. The first
    point is the point of the lap nearest to `pose`."""
    line = ring.line
    nearest = line.project(shapely.Point(pose.x, pose.y))
    found = []
    for k in range(STEPS):
        distance = (nearest + k * step) % line.length
        here, there = (line.interpolate((distance + d) % line.length) for d in (-0.01, 0.01))
        yaw = float(np.arctan2(there.y - here.y, there.x - here.x))
        point = line.interpolate(distance)
        found.append((distance, Pose(point.x, point.y, yaw), abs(k * step)))
    return found


def _route(
    area: Area, start: Pose, goal: Pose, ring: Ring, first: Place, along: float, last: Place
) -> Iterator[Pieces]:
    """Yield the connection along a headland lap from `first` to `last`, unless the machine cannot follow this
    connection."""
    bends = area.rig.bends
    there, back = connections(start, first[1], bends), connections(last[1], goal, bends)
    if not there or not back or along < 0.1:
        return
    points, cuts = from_point(ring, first[0])
    steps = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    kept = steps < along - 1e-3
    part = np.vstack([points[kept], [[last[1].x, last[1].y]]])
    if (course := drivable(part, False, area.rig, cuts[kept])) is not None:
        yield (*there[0], *pieces_of(course), *back[0])
