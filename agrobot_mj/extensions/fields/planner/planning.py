"""Planner: headland laps from the boundary inwards, laps around obstacles, then the cells of the body.

Cells are driven nearest first. The plan is drivable and complete, but not optimal.
"""

from collections.abc import Sequence
from math import degrees, hypot, pi
from typing import NamedTuple

import numpy as np
import shapely

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.plan import Plan, PlannedPass
from agrobot_mj.extensions.fields.planner.area import TOLERANCE_M, Area, area_of
from agrobot_mj.extensions.fields.planner.joins import Shape, join
from agrobot_mj.extensions.fields.planner.laps import Ring, lap, pieces_of
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.extensions.fields.planner.swaths import Pattern, Swath, best_pattern, ordered, pattern
from agrobot_mj.extensions.fields.planner.words import end_of, length_of, shortest_arcs, straight
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.headland import half_turn_width
from agrobot_mj.paths.track import Piece, chain

LAP_STARTS = 24
"""Number of places along a ring where its lap may start."""
WARNED_M = 0.1
"""Distance beyond the boundary above which a place is reported [m]."""
CLOSE_M = 1e-3
"""Distance below which a pose counts as reached [m]."""
PLACES_TOLD = 5
"""Maximum number of places in a warning."""
GOALS_TRIED = 6
"""Number of starts of the next work to which connections are planned, nearest first."""
LEAST_AREA = 0.1
"""Minimum area of a body with swaths, divided by the squared working width [-]."""


class Options(NamedTuple):
    """Options of a plan."""

    headlands: int = 2
    """Number of headland laps."""
    turn: Shape = "clothoid"
    """Preferred turn between neighbouring swaths."""
    order: str = "boustrophedon"
    """Order of the swaths of a cell."""
    angle: float | None = None
    """Direction of the swaths, counter-clockwise from east; None for the direction with the fewest swaths [rad]."""
    sections: int = 1
    """Number of sections of the implement."""


class _Work:
    """Plan under construction."""

    def __init__(self, area: Area, options: Options) -> None:
        self.area, self.rig, self.options = area, area.rig, options
        self.pieces: list[Piece] = []
        self.passes: list[PlannedPass] = []
        self.start: Pose | None = None
        self.pose = Pose(0.0, 0.0, 0.0)
        self.distance = 0.0
        self.crossings: list[tuple[Pose, float]] = []

    def go(self, pieces: tuple[Piece, ...]) -> None:
        """Append segments."""
        self.pieces += pieces
        self.pose = end_of(self.pose, pieces)
        self.distance += length_of(pieces)

    def to(self, goals: Sequence[Pose]) -> int:
        """Append the cheapest connection to one of the poses, or begin an empty plan at the first pose; return the
        number of the pose."""
        if self.start is None:
            self.start = self.pose = goals[0]
            return 0
        reach = self.rig.bends.reach
        ranked = sorted(range(len(goals)), key=lambda k: shortest_arcs(self.pose, goals[k], reach))[:GOALS_TRIED]
        joins = {k: join(self.area, self.pose, goals[k], self.options.turn) for k in ranked}
        chosen = min(joins, key=lambda k: joins[k].cost)
        if joins[chosen].across > TOLERANCE_M:
            self.crossings.append((self.pose, joins[chosen].across))
        self.go(joins[chosen].pieces)
        return chosen

    def lap(self, ring: Ring) -> None:
        """Append a headland lap. Raise `ScenarioError` if the machine cannot drive it."""
        courses = [course for distance in self._starts(ring) if (course := lap(ring, distance, self.rig)) is not None]
        if not courses:
            x, y = ring.points[0]
            raise ScenarioError(
                f"--headlands {self.options.headlands}: lap {ring.number + 1} near ({x:.0f}, {y:.0f}) m is too narrow "
                f"for a turn radius of {self.rig.path.turn_radius_m:g} m; use fewer laps or a smaller --radius"
            )
        chosen = self.to([course.start for course in courses])
        behind, first = self.rig.behind, self.distance
        self.go((*pieces_of(courses[chosen]), *straight(behind)))
        span = first + behind, self.distance
        self.passes.append(PlannedPass("headland", *span, (span,) * self.options.sections))

    def _starts(self, ring: Ring) -> list[float]:
        """Return distances along a ring at which its lap may begin [m]."""
        length, reach = ring.line.length, self.rig.bends.reach
        if self.start is None:
            return [k * length / LAP_STARTS for k in range(1, LAP_STARTS)]
        nearest = float(ring.line.project(shapely.Point(self.pose.x, self.pose.y)))
        near = [nearest + 0.5 * k * reach for k in range(LAP_STARTS)]
        return [*near, *(k * length / LAP_STARTS for k in range(LAP_STARTS))]

    def swath(self, swath: Swath, layout: Pattern, forth: bool) -> None:
        """Append a swath in the direction of the angle (`forth`) or against it."""
        start = _pose(layout, swath, forth)
        if self.start is None or hypot(start.x - self.pose.x, start.y - self.pose.y) > CLOSE_M:
            self.to([start])
        behind, first = self.rig.behind, self.distance
        self.go(straight(swath.length + behind, self.rig.path.speed_m_s))
        zero = first + behind
        if forth:
            spans = [(zero + a - swath.start, zero + b - swath.start) for a, b in reversed(swath.sections)]
        else:
            spans = [(zero + swath.end - b, zero + swath.end - a) for a, b in swath.sections]
        self.passes.append(PlannedPass("body", zero, zero + swath.length, tuple(spans)))

    def cells(self, layout: Pattern) -> None:
        """Append the swaths of all cells, the nearest cell first."""
        across = int(np.ceil(half_turn_width(*self.rig.bends[:2]) / self.rig.width - 1e-9))
        left = list(layout.cells)
        while left:
            variants = [(k, back, forth) for k in range(len(left)) for back in (False, True) for forth in (True, False)]
            starts = [_pose(layout, left[k][-1 if back else 0], forth) for k, back, forth in variants]
            k, back, forth = variants[self.to(starts)]
            cell = left.pop(k)[:: -1 if back else 1]
            for number, index in enumerate(ordered(len(cell), self.options.order, across)):
                self.swath(cell[index], layout, forth == (number % 2 == 0))


def _pose(layout: Pattern, swath: Swath, forth: bool) -> Pose:
    """Return the pose at the start of a swath."""
    x, y = layout.point(swath.start if forth else swath.end, swath.across)
    return Pose(x, y, layout.angle if forth else layout.angle + pi)


def make_plan(field: Field, rig: FieldMachine, options: Options) -> Plan:
    """Return the plan of a field. Raise `ScenarioError` if there is none."""
    area = area_of(field, options.headlands, rig)
    work = _Work(area, options)
    for ring in area.laps:
        work.lap(ring)
    layout = None
    if area.body.area > LEAST_AREA * rig.width**2:
        given = options.angle
        layout = (
            best_pattern(area.body, rig.width, options.sections)
            if given is None
            else pattern(area.body, given, rig.width, options.sections)
        )
        work.cells(layout)
    if work.start is None:
        raise ScenarioError(f"--width {rig.width:g}: the field is too narrow for one swath; use a smaller width")
    warnings = [*leaving(area, work.start, work.pieces), *_crossing(work)]
    angle = None if layout is None else round(degrees(layout.angle), 4)
    pause = rig.path.cusp_pause_s
    parts = tuple(work.pieces), tuple(work.passes), pause, angle, options.headlands, tuple(warnings)
    return Plan(field.name, rig.width, rig.behind, work.start, *parts)


def leaving(area: Area, start: Pose, pieces: Sequence[Piece]) -> list[str]:
    """Return a warning with the places where a plan leaves the field; empty if it stays inside."""
    x, y, yaw = chain(start, pieces).divided().joints()
    outside = area.outside(x, y, yaw).max(axis=0)
    if not (places := sorted(_peaks(outside, WARNED_M), key=lambda k: -outside[k])):
        return []
    told = ", ".join(f"({x[k]:.0f}, {y[k]:.0f})" for k in places[:PLACES_TOLD])
    more = f" and at {len(places) - PLACES_TOLD} other locations" if len(places) > PLACES_TOLD else ""
    return [f"the machine leaves the field by up to {outside[places[0]]:.2f} m at {told} m{more}"]


def _crossing(work: _Work) -> list[str]:
    return [
        f"a connection from ({pose.x:.0f}, {pose.y:.0f}) m crosses the area of the swaths over {length:.0f} m"
        for pose, length in work.crossings
    ]


def _peaks(values: Array, limit: float) -> list[int]:
    """Return the index of the maximum of each run of values above a limit."""
    above = np.concatenate(([False], values > limit, [False]))
    starts, ends = np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:])
    return [int(a + np.argmax(values[a:b])) for a, b in zip(starts, ends, strict=True)]
