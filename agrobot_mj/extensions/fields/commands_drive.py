"""Commands that plan and simulate field work: `field plan` and `field run`."""

import sys
from math import inf, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agrobot_mj.cli.options import Answer, NoRrd, Out, Quiet, Sets, overrides, results_folder, utf8
from agrobot_mj.cli.panels import help_entry
from agrobot_mj.extensions.fields.options import (
    DEFAULT_WIDTH_M,
    Along,
    Angle,
    Beyond,
    Crs,
    FieldFile,
    FieldName,
    Headlands,
    LookAhead,
    NoReverse,
    OffDelay,
    OnDelay,
    Order,
    Overlap,
    PlanSections,
    PlanWidth,
    Price,
    Radius,
    Resume,
    RowAngle,
    RowSpacing,
    Sections,
    Speed,
    Turn,
    Width,
)

if TYPE_CHECKING:
    from agrobot_mj.extensions.fields.effort import Prices
    from agrobot_mj.extensions.fields.field import Field
    from agrobot_mj.extensions.fields.plan import Plan
    from agrobot_mj.extensions.fields.planner.rig import FieldMachine
    from agrobot_mj.extensions.fields.planner.swaths import SwathFrame
    from agrobot_mj.scenario.schema import Scenario

MOST_OVERLAP = 0.5  # Maximum planned overlap of passes divided by the working width [-]
PLAN_FILES = ("field_plan.json", "plan.geojson", "plan.png", "scenario.toml")


def field_plan(
    file: FieldFile,
    width: Width = DEFAULT_WIDTH_M,
    headlands: Headlands = None,
    beyond: Beyond = 0.0,
    turn: Turn = "clothoid",
    no_reverse: NoReverse = False,
    order: Order = "boustrophedon",
    angle: Angle = None,
    along: Along = None,
    radius: Radius = None,
    speed: Speed = 2.0,
    overlap: Overlap = 0.0,
    sections: Sections = 1,
    crs: Crs = "",
    name: FieldName = "",
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Plan headland laps, swaths and turns on a field.

    Writes field_plan.json, plan.geojson, plan.png and scenario.toml. The plan is drivable, not optimal.
    """
    from agrobot_mj.extensions.fields.output import plan_text, write_plan, write_scenario
    from agrobot_mj.extensions.fields.planner.joins import depth_of_turn
    from agrobot_mj.simulation.results import results

    field = _field(file, crs, name, quiet)
    given = _with_terrain(field, overrides(sets), quiet)
    base, rig = _rig(field, width, overlap, turn, speed, radius, given, no_reverse)
    plan = _plan(field, rig, headlands, turn, order, _frame(field, base, angle, along), sections, beyond)
    folder = results_folder(out, f"plan-{field.name}")
    with results(folder, PLAN_FILES):
        write_plan(folder, field, plan)
        write_scenario(folder, field, plan, base, given)
    _warn(plan, quiet)
    text = plan_text(plan, field, depth_of_turn(rig, turn))
    content = {"folder": str(folder), "machine": base.machine, "warnings": list(plan.warnings), **text[1]}
    return Answer(content, f"{text[0]}, {folder}")


def field_run(
    file: FieldFile,
    width: PlanWidth = None,
    headlands: Headlands = None,
    beyond: Beyond = 0.0,
    turn: Turn = "clothoid",
    no_reverse: NoReverse = False,
    order: Order = "boustrophedon",
    angle: Angle = None,
    along: Along = None,
    radius: Radius = None,
    speed: Speed = 2.0,
    overlap: Overlap = 0.0,
    sections: PlanSections = None,
    on_delay: OnDelay = 0.0,
    off_delay: OffDelay = 0.0,
    look_ahead: LookAhead = 0.0,
    guidance: Annotated[str | None, typer.Option(metavar="KIND", help="Guidance law.")] = None,
    plan_file: Annotated[
        Path | None, typer.Option("--plan", metavar="FILE", help="Plan file to use instead of a generated plan.")
    ] = None,
    price: Price = None,
    row_spacing: RowSpacing = None,
    row_angle: RowAngle = None,
    resume: Resume = False,
    crs: Crs = "",
    name: FieldName = "",
    sets: Sets = None,
    out: Out = None,
    no_rrd: NoRrd = False,
    quiet: Quiet = False,
) -> Answer:
    """Simulate the work on a field and evaluate its coverage.

    Writes the files of a run and coverage.json, coverage.geojson and coverage.png.
    """
    from agrobot_mj.core.errors import ScenarioError
    from agrobot_mj.extensions.fields.boom import Boom
    from agrobot_mj.extensions.fields.crop_rows import crop_rows
    from agrobot_mj.extensions.fields.driving import FILES, drive
    from agrobot_mj.extensions.fields.given_plan import given_plan, stored_plan
    from agrobot_mj.simulation.results import check_folder
    from agrobot_mj.simulation.storage import files_of_run

    given = overrides([*(sets or []), *([f"guidance.kind={guidance}"] if guidance is not None else [])])
    prices = _prices(price)
    if (stored_file := file / PLAN_FILES[0]).is_file():
        raise ScenarioError(f"{file}: is the folder of a plan; specify the boundary file, and --plan {stored_file}")
    field = _field(file, crs, name, quiet)
    given = _with_terrain(field, given, quiet)
    stored = stored_plan(plan_file) if plan_file else None
    worked = width or (stored.width if stored else DEFAULT_WIDTH_M)
    number = sections or (stored.sections if stored else 1)
    base, rig = _rig(field, worked, stored.overlap if stored else overlap, turn, speed, radius, given, no_reverse)
    if out is not None:
        check_folder(out, (*files_of_run(base), *FILES))
    if plan_file is None:
        plan = _plan(field, rig, headlands, turn, order, _frame(field, base, angle, along), number, beyond)
    else:
        plan = given_plan(plan_file, stored, field, rig, number)
    rows = crop_rows(plan, row_spacing, row_angle)
    _warn(plan, quiet)
    boom = Boom(worked, number, on_delay, off_delay, look_ahead, look_ahead)
    return drive(field, plan, base, rig, boom, given, out, not no_rrd, quiet, resume, prices, rows)


def _field(file: Path, crs: str, name: str, quiet: bool) -> "Field":
    """Return the field in a file. Notes about repairs of its geometry are printed unless `quiet`."""
    from agrobot_mj.core.errors import import_extra

    import_extra("shapely", "fields", "field work")
    from agrobot_mj.extensions.fields.reading import read_field

    field = read_field(Path(utf8(str(file), "FILE")), utf8(crs, "--crs"), utf8(name, "--field"))
    for note in () if quiet else field.notes:
        print(f"{field.name}: {note}", file=sys.stderr)
    return field


def _with_terrain(field: "Field", given: dict[str, Any], quiet: bool) -> dict[str, Any]:
    """Return the overrides with the elevation model of the field and its map position. A note is printed unless
    `quiet`."""
    from agrobot_mj.extensions.fields.map_position import with_terrain

    found, note = with_terrain(field, given)
    if note and not quiet:
        print(f"{field.name}: {note}", file=sys.stderr)
    return found


def _rig(
    field: "Field",
    width: float,
    overlap: float,
    turn: str,
    speed: float,
    radius: float | None,
    given: dict[str, Any],
    forward_only: bool,
) -> "tuple[Scenario, FieldMachine]":
    """Return the scenario for planning, and the machine data for the planner. The path of this scenario contains the
    turn radius, the transition type and the speed of the plan."""
    from agrobot_mj.core.errors import ScenarioError
    from agrobot_mj.extensions.fields.drive import planning_scenario
    from agrobot_mj.extensions.fields.planner.rig import rig_of

    if overlap > MOST_OVERLAP * width:
        raise ScenarioError(
            f"--overlap {overlap:g}: must be at most half of the width ({width:g} m); reduce the overlap"
        )
    path: dict[str, Any] = {"transition": "none" if turn == "omega" else "clothoid", "speed_m_s": speed}
    if radius is not None:
        path["turn_radius_m"] = radius
    base = planning_scenario(field.name, path, given)
    return base, rig_of(base, width, overlap, forward_only)


def _frame(field: "Field", base: "Scenario", angle: float | None, along: str | None) -> "SwathFrame | None":
    """Return the coordinate frame of the swaths for the options `--angle` and `--along`, or None if the planner selects
    the direction with the fewest swaths."""
    from agrobot_mj.core.errors import ScenarioError
    from agrobot_mj.extensions.fields.planner.contours import contour_frame
    from agrobot_mj.extensions.fields.planner.swaths import SwathFrame

    if along is None:
        return None if angle is None else SwathFrame(radians(angle))
    if angle is not None:
        raise ScenarioError(f"--along {along}: cannot be combined with --angle; omit one of them")
    return contour_frame(field.boundary, base.terrain.ground())


def _plan(
    field: "Field",
    rig: "FieldMachine",
    headlands: int | None,
    turn: Any,
    order: str,
    frame: "SwathFrame | None",
    sections: int,
    beyond: float,
) -> "Plan":
    from agrobot_mj.extensions.fields.planner.planning import Options, make_plan

    return make_plan(field, rig, Options(headlands, turn, order, frame, sections, beyond))


def _prices(given: list[str] | None) -> "Prices":
    """Return prices from options of the form NAME=VALUE. Raise `ScenarioError` for an unknown name or invalid value."""
    from agrobot_mj.core.errors import ScenarioError
    from agrobot_mj.extensions.fields.effort import Prices

    found: dict[str, float] = {}
    for text in given or []:
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise ScenarioError(f"--price {text}: the number is missing; specify --price input_ha=180") from None
        if name.strip() not in Prices._fields or not 0 <= found[name.strip()] < inf:
            known = ", ".join(Prices._fields)
            raise ScenarioError(f"--price {text}: the name must be one of {known}; the value must be at least 0")
    return Prices(**found)


def _warn(plan: "Plan", quiet: bool) -> None:
    if not quiet:
        for warning in plan.warnings:
            print(f"{plan.name}: {warning}", file=sys.stderr)


COMMANDS = {
    field_plan: help_entry(
        "Field work",
        "field plan boundary.geojson --machine row_crop --width 6",
        "field plan boundary.geojson --width 3 --headlands 3 --turn k --angle 90",
        "field plan boundary.geojson --along contours --set terrain.kind=slope --set terrain.grade_deg=6",
        advanced=True,
    ),
    field_run: help_entry(
        "Field work",
        "field run boundary.geojson --machine row_crop --width 6 --no-rrd",
        "field run boundary.geojson --plan field_plan.json --guidance lqr",
        advanced=True,
    ),
}
"""Commands `field plan` and `field run` with their help entries."""
