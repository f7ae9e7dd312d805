"""Output files and text summary of a field work plan."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import shapely

from agrobot_mj.extensions.fields.coverage import FieldCoverage, areas
from agrobot_mj.extensions.fields.drive import PLAN_FILE, driving_scenario
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.maps import map_of, write_geojson
from agrobot_mj.extensions.fields.plan import Plan, to_json
from agrobot_mj.extensions.fields.planned import planned_coverage
from agrobot_mj.extensions.fields.planner.area import body_of, whole_of
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import atomic, write_json
from agrobot_mj.studies.style import write_figure

NARROW = 0.2  # Maximum width of a narrow strip, divided by the working width [-]. Assumed value.
MISSED_PERCENT = 10.0  # Missed area of a plan above which its summary states a remedy [%]. Assumed value.


def write_plan(folder: Path, field: Field, plan: Plan) -> None:
    """Write a plan to `folder` as JSON, GeoJSON and map figure."""
    whole = whole_of(field)
    write_json(folder / PLAN_FILE, to_json(plan))
    write_geojson(folder / "plan.geojson", whole, plan, plane=field.plane)
    write_figure(folder / "plan.png", map_of, whole, plan)


def write_scenario(folder: Path, field: Field, plan: Plan, base: Scenario, overrides: Mapping[str, Any]) -> None:
    """Write a scenario for simulating the plan file in `folder`, for example in comparisons and sweeps, and copies of
    the other files that the scenario reads."""
    scenario = driving_scenario(field, plan, (folder / PLAN_FILE).absolute(), base, overrides)
    text, files = scenario.portable()
    for name, source in files.items():
        if name != PLAN_FILE:
            with atomic(folder / name) as path:
                shutil.copyfile(source, path)
    with atomic(folder / "scenario.toml") as path:
        path.write_text(text, encoding="utf-8")


def plan_text(plan: Plan, field: Field, depth: float) -> tuple[str, dict[str, Any]]:
    """Return a summary text and the numbers of a plan. `depth` is the headland width required for the turns [m]."""
    found = planned_coverage(plan, whole_of(field), body_of(field, plan))
    ideal = areas(found)["field"]
    swaths = sum(one.part == "body" for one in plan.passes)
    numbers = {
        "field": plan.name,
        "area_m2": whole_of(field).area,
        "angle_deg": plan.angle_deg,
        "laps": len(plan.passes) - swaths,
        "swaths": swaths,
        "turn_depth_m": depth,
        "length_m": plan.length,
        "working_length_m": plan.working_length,
        "overlapped_percent": ideal["overlapped_percent"],
        "missed_percent": ideal["missed_percent"],
    }
    direction = "" if plan.angle_deg is None else f" at {plan.angle_deg:.1f} deg"
    text = (
        f"{plan.name}: {numbers['area_m2'] / 1e4:.3g} ha, {numbers['laps']} laps, {swaths} swaths{direction}, "
        f"{plan.length / 1000:.2f} km, {100 * plan.working_length / plan.length:.0f} % of it working, "
        f"{ideal['overlapped_percent']:.1f} % overlapped and {ideal['missed_percent']:.1f} % missed by the plan; "
        f"turns need a headland of {depth:.1f} m{_largest_gap(found, plan.width)}"
    )
    if ideal["missed_percent"] > MISSED_PERCENT:
        text += "; to work more of the field, let turns leave it (--headlands 0 --beyond) or use a smaller --width"
    return text, numbers


def _largest_gap(found: FieldCoverage, width: float) -> str:
    """Return a text about the largest gap, or an empty text if it is smaller than a square of `width` [m].

    Narrow strips along the boundary do not count.
    """
    narrow = NARROW * width / 2
    wide = found.missed.buffer(-narrow).buffer(narrow, join_style="mitre").intersection(found.missed)
    gap = max(shapely.get_parts(wide), key=shapely.area, default=None)
    if gap is None or gap.area < width**2:
        return ""
    at = gap.representative_point()
    return f"; the largest gap is {gap.area:.0f} m2 near ({at.x:z.0f}, {at.y:z.0f}) m"
