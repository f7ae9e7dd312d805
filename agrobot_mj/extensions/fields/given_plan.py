"""Plans of other programs: file lines become courses that the machine can follow, joined by connections."""

from dataclasses import replace
from math import hypot
from pathlib import Path

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.resources import stamp_of
from agrobot_mj.extensions.fields.drive import PLAN_FILE
from agrobot_mj.extensions.fields.field import Field, Leg
from agrobot_mj.extensions.fields.plan import FORMAT, MAX_BYTES, SUFFIXES, Plan, PlannedPass, plan_of
from agrobot_mj.extensions.fields.planner.area import area_of
from agrobot_mj.extensions.fields.planner.laps import pieces_of, rounding
from agrobot_mj.extensions.fields.planner.leaving import LEAVES, leaving
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.extensions.fields.planner.words import FORWARD, REVERSING, connections, end_of, length_of, straight
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.fillet import round_corners
from agrobot_mj.paths.track import Piece

SAME_M = 1e-6  # Maximum difference between equal working widths [m]
APART_M, APART_RAD = 0.05, 0.02
"""Distance [m] and heading difference [rad] above which two successive legs need a connection between them."""


def stored_plan(file: Path) -> Plan | None:
    """Return the plan from a file that `field plan` has written, or None for other files. Raise `ScenarioError` for a
    damaged plan."""
    try:
        if file.suffix != ".json" or FORMAT not in file.read_text("utf-8", "replace")[:200]:
            return None
        return plan_of(stamp_of(str(file.absolute()), SUFFIXES, MAX_BYTES))
    except OSError:
        return None
    except ValueError as error:
        raise ScenarioError(f"--plan {error}") from None


def given_plan(file: Path, stored: Plan | None, field: Field, rig: FieldMachine, sections: int) -> Plan:
    """Return the plan `stored` or, if it is None, a plan along the lines in `file`, with updated warnings.

    Raise `ScenarioError` if the machine cannot follow the plan.
    """
    plan = stored or _of_lines(file, field, rig, sections)
    if stored is not None:
        _check(stored, file.name, rig, sections)
    left = leaving(area_of(field, 0, rig), plan.start, plan.pieces, plan.passes)
    known = [warning for warning in plan.warnings if not warning.startswith(LEAVES)]
    return replace(plan, warnings=(*known, *left.warnings()))


def _check(plan: Plan, name: str, rig: FieldMachine, sections: int) -> None:
    """Raise `ScenarioError` if the implement differs from the plan in width or sections, or a bend is too tight."""
    if abs(plan.width - rig.width) > SAME_M:
        raise ScenarioError(f"--width {rig.width:g}: the plan {name} is for a width of {plan.width:g} m; omit --width")
    if any(len(each.sections) != sections for each in plan.passes):
        raise ScenarioError(
            f"--sections {sections}: the plan {name} is for {plan.sections} sections; omit --sections, or make another "
            "plan"
        )
    if rig.forward_only and (plan.course.directions < 0).any():
        raise ScenarioError(
            f"--plan {name}: has reverse segments, which --no-reverse and drawn implements exclude; make another plan"
        )
    place = plan.course.sharpest()
    if (peak := float(plan.course.peaks.max())) * rig.tightest > 1.0:
        raise ScenarioError(
            f"--plan {name}: the bend of radius {1 / peak:.2f} m at ({place.x:.1f}, {place.y:.1f}) m is below the "
            f"minimum turn radius of the machine ({rig.tightest:.2f} m); use the --machine that the plan is for"
        )


def _of_lines(file: Path, field: Field, rig: FieldMachine, sections: int) -> Plan:
    """Return a plan along the lines in a file. Raise `ScenarioError` if the machine cannot follow the lines."""
    from agrobot_mj.extensions.fields.reading import read_plan

    legs, notes = read_plan(file, field)
    try:
        return replace(plan_of_legs(field.name, legs, rig, sections), warnings=notes)
    except ValueError as error:
        hint = f", or specify {PLAN_FILE} in the same folder" if file.with_name(PLAN_FILE).is_file() else ""
        raise ScenarioError(f"--plan {file.name}: {error}{hint}") from None


def plan_of_legs(name: str, legs: tuple[Leg, ...], rig: FieldMachine, sections: int) -> Plan:
    """Return a plan along `legs`, which connections join. Raise a ValueError with the number of a leg that the machine
    cannot follow."""
    pieces: list[Piece] = []
    passes: list[PlannedPass] = []
    start: Pose | None = None
    pose = Pose(0.0, 0.0, 0.0)
    for number, (leg, following) in enumerate(zip(legs, (*legs[1:], None), strict=False), start=1):
        begin, own = _leg_course(leg, number, rig)
        if start is None:
            start = pose = begin
        elif _apart(pose, begin):
            joined = _shortest_connection(pose, begin, number, rig)
            pieces += joined
            pose = end_of(pose, joined)
        first = sum(piece.length for piece in pieces)
        if leg.working and not leg.reverse:
            span = first + rig.behind, first + rig.behind + length_of(own)
            if following is None or hypot(*(following.points[0][:2] - leg.points[-1][:2])) > APART_M:
                own = (*own, *straight(rig.behind))
            passes.append(PlannedPass("body", *span, (span,) * sections))
        pieces += own
        pose = end_of(pose, own)
    if start is None:
        raise ValueError("the plan has no passes; export the passes as lines")
    pause, overlap = rig.path.cusp_pause_s, rig.overlap
    machine = rig.width, rig.behind, rig.cg_to_rear_axle
    return Plan(name, *machine, start, tuple(pieces), tuple(passes), pause, overlap=overlap)


def _apart(pose: Pose, begin: Pose) -> bool:
    """Return whether a leg ends away from the start pose `begin` of the next leg, in position or heading."""
    return hypot(begin.x - pose.x, begin.y - pose.y) > APART_M or abs(wrap(begin.yaw - pose.yaw)) > APART_RAD


def _leg_course(leg: Leg, number: int, rig: FieldMachine) -> tuple[Pose, tuple[Piece, ...]]:
    """Return the start pose of a leg and the path segments along the leg."""
    try:
        course = round_corners(np.asarray(leg.points, dtype=float), False, rounding(rig))
    except ValueError as error:
        raise ValueError(f"leg {number}: {error}") from None
    if (peak := float(course.peaks.max())) > rig.max_curvature:
        raise ValueError(
            f"leg {number}: the bend radius of {1 / peak:.2f} m is below the minimum turn radius of the machine "
            f"({1 / rig.max_curvature:.2f} m); smooth the bend or choose another machine"
        )
    speed = rig.path.speed_m_s if leg.speed_m_s is None else min(leg.speed_m_s, rig.path.speed_m_s)
    pieces = tuple(piece._replace(speed=min(piece.speed, speed)) for piece in pieces_of(course))
    if not leg.reverse:
        return course.start, pieces
    begin = course.start._replace(yaw=course.start.yaw + np.pi)
    return begin, tuple(
        piece._replace(direction=-1.0, curvature=-piece.curvature, sharpness=-piece.sharpness) for piece in pieces
    )


def _shortest_connection(pose: Pose, begin: Pose, number: int, rig: FieldMachine) -> tuple[Piece, ...]:
    """Return the shortest connection from the end of a leg to the start of the next leg."""
    words = FORWARD if rig.forward_only else (*FORWARD, *REVERSING)
    if found := connections(pose, begin, rig.bends, words):
        return found[0]
    raise ValueError(f"leg {number}: the machine cannot reach this leg from the previous leg; add a turn")
