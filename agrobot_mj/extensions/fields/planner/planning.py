"""Planner of field work: headland laps from the boundary inwards, laps around obstacles, then the cells of the body.

A cell is a group of adjacent swaths. After each cell, the planner continues with the cell that has the cheapest
connection. The machine can follow every plan. Plans are complete, but not optimal.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from math import ceil, degrees, hypot, pi
from typing import NamedTuple

import numpy as np
import shapely

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.plan import Plan, PlannedPass
from agrobot_mj.extensions.fields.planner.area import Area, area_of
from agrobot_mj.extensions.fields.planner.joins import Shape, depth_of_turn, join
from agrobot_mj.extensions.fields.planner.laps import Ring, lap, pieces_of, start_at
from agrobot_mj.extensions.fields.planner.leaving import Leaving, leaving
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.extensions.fields.planner.swaths import Pattern, Swath, SwathFrame, best_pattern, pattern, swath_order
from agrobot_mj.extensions.fields.planner.words import end_of, length_of, shortest_arcs, straight
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.headland import half_turn_width
from agrobot_mj.paths.track import Course, Piece

LAP_STARTS = 24  # Number of evaluated points of a ring at which a lap may start
DEFAULT_HEADLANDS = 2  # Default number of headland laps, which is increased if the turns need more space
TRIES = 6  # Maximum number of further attempts with additional laps, or with the margin that laps need
FILLINGS = 16  # Maximum number of attempts with swaths in parts of the headland
WIDER = 3  # Maximum number of attempts with a margin for turns
MARGIN_STEP_M = 0.02  # Amount added to an excess distance beyond the boundary to obtain the increase of the margin [m]
CROSSED_M = 0.5  # Minimum length of a crossing of the swaths that is reported [m]
CLOSE_M = 1e-3  # Distance below which two poses count as equal [m]
GOALS_TRIED = 6  # Number of possible starts of the next pass, nearest first, to which connections are computed
OMITTED = 2.0  # Length below which an undrivable lap is omitted [turning circles]. Assumed value.
LEAST_AREA = 0.1  # Minimum area of a field body that gets swaths, divided by the square of the working width [-]


class Options(NamedTuple):
    """Options of the planner: headland laps, turns, swaths and sections."""

    headlands: int | None = None  # Number of headland laps. None means two laps, or more if the turns need more space.
    turn: Shape = "clothoid"  # Preferred turn shape between neighbouring swaths
    order: str = "boustrophedon"  # Order of the swaths of a cell: `boustrophedon` or `skip`
    frame: SwathFrame | None = None
    """Direction and curvature of the swaths, or None for straight swaths in the direction with the fewest swaths."""
    sections: int = 1  # Number of sections of the implement
    beyond: float = 0.0  # Distance by which the machine may extend beyond the field [m]


class _Work:
    """Builder of a plan, to which laps, swaths and connections are appended."""

    def __init__(self, area: Area, options: Options) -> None:
        self.area, self.rig, self.options = area, area.rig, options
        self.pieces: list[Piece] = []
        self.passes: list[PlannedPass] = []
        self.start: Pose | None = None
        self.pose = Pose(0.0, 0.0, 0.0)
        self.distance = 0.0
        self.crossings: list[tuple[Pose, float]] = []
        self.omitted: list[str] = []  # Warnings about laps that are not driven
        self.layout: Pattern | None = None

    def go(self, pieces: tuple[Piece, ...]) -> None:
        """Append path segments to the course."""
        self.pieces += pieces
        self.pose = end_of(self.pose, pieces)
        self.distance += length_of(pieces)

    def to(self, goals: Sequence[Pose]) -> int:
        """Append the cheapest connection to one of the poses `goals`. Return the index of the reached pose.

        An empty plan starts at the first pose.
        """
        if self.start is None:
            self.start = self.pose = goals[0]
            return 0
        reach = self.rig.bends.reach
        ranked = sorted(range(len(goals)), key=lambda k: shortest_arcs(self.pose, goals[k], reach))[:GOALS_TRIED]
        joins = {k: join(self.area, self.pose, goals[k], self.options.turn) for k in ranked}
        chosen = min(joins, key=lambda k: joins[k].cost)
        if joins[chosen].across > CROSSED_M:
            self.crossings.append((self.pose, joins[chosen].across))
        self.go(joins[chosen].pieces)
        return chosen

    def lap(self, ring: Ring) -> None:
        """Append a headland lap, unless it is shorter than `OMITTED` turning circles and the machine cannot follow it.
        Raise `ScenarioError` if the machine cannot follow a longer lap."""
        if (course := lap(ring, self.rig)) is None:
            x, y = ring.points[0]
            radius = self.rig.path.turn_radius_m
            narrow = (
                f"lap {ring.number + 1} near ({x:z.0f}, {y:z.0f}) m is too narrow for a turn radius of {radius:.3g} m"
            )
            if ring.line.length > OMITTED * 2 * pi * radius:
                raise ScenarioError(
                    f"--headlands {self.options.headlands}: {narrow}; use fewer laps or a smaller --radius"
                )
            self.omitted.append(f"{narrow}, so that the plan omits this lap")
            return
        courses = [start_at(course, distance) for distance in self._starts(course)]
        chosen = self.to([course.start for course in courses])
        behind, first = self.rig.behind, self.distance
        self.go((*pieces_of(courses[chosen]), *straight(behind)))
        span = first + behind, self.distance
        self.passes.append(PlannedPass("headland", *span, (span,) * self.options.sections))

    def _starts(self, course: Course) -> list[float]:
        """Return the arc lengths of a closed course at which a lap may start [m]."""
        parts, length, reach = course.divided(), float(course.lengths.sum()), self.rig.bends.reach
        if self.start is None:
            return [k * length / LAP_STARTS for k in range(1, LAP_STARTS)]
        x, y, _ = parts.joints()
        nearest = float(parts.distances()[np.argmin(np.hypot(x - self.pose.x, y - self.pose.y))])
        near = [(nearest + 0.5 * k * reach) % length for k in range(LAP_STARTS)]
        return [*near, *(k * length / LAP_STARTS for k in range(LAP_STARTS))]

    def swath(self, swath: Swath, layout: Pattern, forth: bool) -> None:
        """Append a swath, driven in the swath direction if `forth`, otherwise in the opposite direction."""
        start = _pose(layout, swath, forth)
        if self.start is None or hypot(start.x - self.pose.x, start.y - self.pose.y) > CLOSE_M:
            self.to([start])
        behind, zero = self.rig.behind, self.distance + self.rig.behind
        stretch = layout.frame.stretch(swath.across)
        curvature = layout.frame.curvature / stretch * (1.0 if forth else -1.0)
        self.go((Piece(stretch * swath.length + behind, curvature, self.rig.path.speed_m_s),))
        if forth:
            spans = [(a - swath.start, b - swath.start) for a, b in reversed(swath.sections)]
        else:
            spans = [(swath.end - b, swath.end - a) for a, b in swath.sections]
        worked = tuple((zero + stretch * a, zero + stretch * b) for a, b in spans)
        self.passes.append(PlannedPass("body", zero, zero + stretch * swath.length, worked))

    def cells(self, layout: Pattern) -> None:
        """Append the swaths of all cells to the plan. The next cell is always the cell with the cheapest connection."""
        self.layout = layout
        across = int(np.ceil(half_turn_width(*self.rig.bends[:2]) / self.rig.spacing - 1e-9))
        left = list(layout.cells)
        while left:
            variants = [(k, back, forth) for k in range(len(left)) for back in (False, True) for forth in (True, False)]
            starts = [_pose(layout, left[k][-1 if back else 0], forth) for k, back, forth in variants]
            k, back, forth = variants[self.to(starts)]
            cell = left.pop(k)[:: -1 if back else 1]
            for number, index in enumerate(swath_order(len(cell), self.options.order, across)):
                self.swath(cell[index], layout, forth == (number % 2 == 0))

    @cached_property
    def leaving(self) -> Leaving:
        """Distances of the tractor and implement beyond the boundary along the course."""
        return leaving(self.area, self.start or self.pose, self.pieces, self.passes)

    def plan(self, name: str, headlands: int, margin: float, notes: Sequence[str]) -> Plan:
        """Return the finished plan. The warnings of the plan start with `notes`."""
        crossing = [
            f"a connection from ({pose.x:z.0f}, {pose.y:z.0f}) m crosses the area of the swaths over {length:.0f} m"
            for pose, length in self.crossings
        ]
        frame = self.layout and self.layout.frame
        angle = None if frame is None or frame.curvature else round(degrees(frame.angle), 4)
        return Plan(
            name,
            self.rig.width,
            self.rig.behind,
            self.rig.cg_to_rear_axle,
            self.start or self.pose,
            tuple(self.pieces),
            tuple(self.passes),
            self.rig.path.cusp_pause_s,
            angle,
            headlands,
            margin,
            self.rig.overlap,
            ground=shapely.to_wkt(self.area.whole, rounding_precision=4),
            warnings=(*notes, *self.omitted, *self.leaving.warnings(), *crossing),
        )


def _pose(layout: Pattern, swath: Swath, forth: bool) -> Pose:
    """Return the CG pose at the start of a swath, which is driven in the swath direction if `forth`, otherwise in the
    opposite direction."""
    pose = layout.frame.pose(swath.start if forth else swath.end, swath.across)
    return pose if forth else pose._replace(yaw=pose.yaw + pi)


class _Attempt(NamedTuple):
    """Plan with a number of headland laps and a margin along the boundary [m]."""

    work: _Work
    laps: int
    margin: float

    @property
    def inside(self) -> bool:
        """Whether the machine stays inside the field."""
        return not max(self.work.leaving.laps, self.work.leaving.turns)


def make_plan(field: Field, rig: FieldMachine, options: Options) -> Plan:
    """Return the plan of a field. Raise `ScenarioError` if no plan stays inside the field.

    If the number of laps is not given, laps are added until the turns stay inside the field. Without reversing, the
    first attempt has space for the turns between adjacent swaths. If the machine extends too far beyond the boundary on
    laps, or more laps do not help, a margin moves the outermost lap inwards.
    """
    if rig.forward_only and options.turn == "k":
        raise ScenarioError(
            "--turn k: has a reverse segment, which --no-reverse and drawn implements exclude; use another turn"
        )
    first = DEFAULT_HEADLANDS if options.headlands is None else options.headlands
    deep = ceil(depth_of_turn(rig, options.turn) / rig.spacing) if rig.forward_only and options.headlands is None else 0
    tried = list(_attempts(field, rig, options, max(first, deep), first))
    last = tried[-1]
    if not last.inside or (options.headlands is not None and last.laps > first):
        worst = next((each for each in tried if each.work.leaving.turns), tried[0]).work.leaving
        remedy = (
            f"at least {last.laps} laps ({last.laps * rig.spacing:g} m)"
            if last.inside
            else "a smaller --radius or --width"
        )
        raise ScenarioError(
            f"--headlands {first}: the machine would leave the field by {worst.largest} in its turns; use {remedy}, "
            "or allow this distance with --beyond"
        )
    notes = []
    if last.laps > first:
        notes.append(f"the plan has {last.laps} headland laps instead of {first}, so that turns stay inside")
    if last.margin:
        notes.append(
            f"the plan keeps {last.margin:.2f} m from the boundary, so that tractor and implement stay inside the field"
        )
    return _with_headland_swaths(last.work).plan(field.name, last.laps, last.margin, notes)


def _with_headland_swaths(work: _Work) -> _Work:
    """Return the plan in which parts of the headland that the laps omit get swaths, or the plan `work` if there is no
    such plan inside the field.

    Where turns leave the field, the swaths are shortened.
    """
    parts = work.area.omitted
    for _ in range(FILLINGS):
        if parts.is_empty:
            break
        now = _swaths_and_laps(work.area.extended(parts), work.options)
        if not max(now.leaving.laps, now.leaving.turns):
            return now
        parts = work.area.large_parts(parts, now.leaving.surroundings(parts))
    return work


def _attempts(field: Field, rig: FieldMachine, options: Options, laps: int, least: int) -> Iterator[_Attempt]:
    """Yield plans with increasing laps and margins, up to the first plan that stays inside the field.

    The first plan has the given number of `laps` or, if these do not fit, the number `least`. If more laps do not lead
    to a plan inside the field, the plans are repeated with margins that are wider by the excess of their turns,
    smallest excess first.
    """
    tried: list[_Attempt] = []
    margin = 0.0
    while len(tried) <= TRIES:
        try:
            now = _Attempt(_work(field, rig, options, laps, margin), laps, margin)
        except ScenarioError:
            if tried:
                break
            if laps == least:
                raise
            laps = least
            continue
        yield now
        if now.inside:
            return
        tried.append(now)
        left = now.work.leaving
        if left.laps:
            margin = round(margin + left.laps + MARGIN_STEP_M, 2)
        else:
            laps += ceil(left.turns / rig.spacing)
    for each in sorted(tried, key=lambda each: (each.work.leaving.laps, each.work.leaving.turns))[:WIDER]:
        margin = round(each.margin + each.work.leaving.turns + MARGIN_STEP_M, 2)
        with suppress(ScenarioError):
            yield (wider := _Attempt(_work(field, rig, options, each.laps, margin), each.laps, margin))
            if wider.inside:
                return


def _work(field: Field, rig: FieldMachine, options: Options, headlands: int, margin: float = 0.0) -> _Work:
    """Return a plan with a `margin` [m] and `headlands` laps. Raise `ScenarioError` if the field is too narrow."""
    return _swaths_and_laps(
        area_of(field, headlands, rig, options.beyond, margin), options._replace(headlands=headlands)
    )


def _swaths_and_laps(area: Area, options: Options) -> _Work:
    """Return the plan of an area. Raise `ScenarioError` if the area is too narrow."""
    work, rig = _Work(area, options), area.rig
    for ring in area.laps:
        work.lap(ring)
    if area.body.area > LEAST_AREA * rig.width**2:
        work.cells(
            best_pattern(area.body, rig.spacing, options.sections)
            if options.frame is None
            else pattern(area.body, options.frame, rig.spacing, options.sections)
        )
    if work.start is None:
        raise ScenarioError(f"--width {rig.width:g}: the field is too narrow for one swath; use a smaller width")
    return work
