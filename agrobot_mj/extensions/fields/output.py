"""Files and texts of a plan."""

from pathlib import Path
from typing import Any

import matplotlib as mpl

from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.maps import geojson, map_of
from agrobot_mj.extensions.fields.plan import Plan, to_json
from agrobot_mj.extensions.fields.planner.area import whole_of
from agrobot_mj.simulation.results import write_json
from agrobot_mj.studies.style import STYLE, save


def write_plan(folder: Path, field: Field, plan: Plan) -> None:
    """Write a plan, its map and its GeoJSON."""
    whole = whole_of(field)
    write_json(folder / "plan.json", to_json(plan))
    write_json(folder / "plan.geojson", geojson(whole, plan, plane=field.plane))
    with mpl.rc_context(STYLE):
        save(map_of(whole, plan), folder / "plan.png")


def plan_text(plan: Plan, field: Field) -> tuple[str, dict[str, Any]]:
    """Return a line about a plan, and its numbers."""
    swaths = sum(one.part == "body" for one in plan.passes)
    numbers = {
        "field": plan.name,
        "area_m2": whole_of(field).area,
        "angle_deg": plan.angle_deg,
        "laps": len(plan.passes) - swaths,
        "swaths": swaths,
        "length_m": plan.length,
        "working_length_m": plan.working_length,
    }
    direction = "" if plan.angle_deg is None else f" at {plan.angle_deg:.1f} deg"
    text = (
        f"{plan.name}: {numbers['area_m2'] / 1e4:.3g} ha, {numbers['laps']} laps, {swaths} swaths{direction}, "
        f"{plan.length / 1000:.2f} km, {100 * plan.working_length / plan.length:.0f} % of it working"
    )
    return text, numbers
