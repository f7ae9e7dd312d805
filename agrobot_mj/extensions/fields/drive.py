"""Scenarios for planning field work and for simulating a field plan."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.scenario.schema import Scenario, resolve

PLAN_FILE = "field_plan.json"
EDGE_M = 50.0  # Width of the simulated ground beyond the field boundary [m]
LARGEST_M = 500.0  # Distance from the origin to the edges of the default ground [m]
GUIDANCE = "lqr"
"""Default guidance law for field work. The default law of scenarios may leave the path where a plan reverses."""
WIDEST_M = 20.0  # Maximum width of the implement body in the simulation [m]
Overrides = Mapping[str, Any]


def planning_scenario(name: str, path: Overrides, overrides: Overrides) -> Scenario:
    """Return a scenario for planning, whose path has the kind `swaths`. Raise `ScenarioError` for invalid overrides.

    `path` contains the turn radius, transition and speed, as keys of the path.
    """
    data = {"name": name, "path": {"kind": "swaths", **path}}
    return resolve(data, name, overrides, files=False)


def driving_scenario(field: Field, plan: Plan, file: Path, base: Scenario, overrides: Overrides) -> Scenario:
    """Return the scenario for simulating the plan stored in `file`. Raise `ScenarioError` for invalid overrides."""
    if any(key.partition(".")[0] == "path" for key in overrides):
        overrides = {key: value for key, value in overrides.items() if key.partition(".")[0] != "path"}
    path = base.path
    limits = ("speed_m_s", "acceleration_m_s2", "lateral_acceleration_m_s2")
    data: dict[str, Any] = {
        "name": field.name,
        "title": f"Field work on {field.name}, {plan.width:g} m",
        "physics": "fast",
        "path": {"kind": "field_plan", "file": str(file), **{key: getattr(path, key) for key in limits}},
    }
    reach = max(map(abs, field.boundary.bounds)) + EDGE_M
    if reach > LARGEST_M:
        data["terrain"] = {"half_size_m": float(round(reach))}
    wide = hasattr(base.implement, "width_m") and plan.width <= WIDEST_M
    given = any(key.startswith("implement.width_m") or key == "implement" for key in overrides)
    if wide and not given:
        overrides = {**overrides, "implement.width_m": plan.width}
    if not any(key.partition(".")[0] in ("guidance", "controller") for key in overrides):
        data["guidance"] = {"kind": GUIDANCE}
    if "physics_dt_s" in overrides:
        del data["physics"]
    try:
        return resolve(data, field.name, overrides)
    except ScenarioError as error:
        raise ScenarioError(str(error).replace(str(file), PLAN_FILE)) from None
