"""Exceptions on docs/machines.md: every scenario on every machine, with the guidance law of the machine.

Physics steps are 5 ms. `WHY` gives a reason for each outcome that differs from the expected outcome.
"""

import tomllib
from collections import defaultdict
from pathlib import Path

from blocks import block, page
from sweeps import Blocks, Row, Study

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.resources import machine_files, scenario_files
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run

Pair = tuple[str, str]  # Name of a machine, and name of a scenario
BLOCK = "exceptions"
STANDARD = ("step_steer",)  # Scenarios whose tyres are too stiff for steps of 5 ms on a light machine
WHY: dict[str, str] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
"""Physical reasons for the exceptions, by scenario."""


def drive(pair: Pair) -> Row:
    """Simulate a scenario on a machine and return the row with its outcome."""
    machine, name = pair
    physics = "standard" if name in STANDARD else "fast"
    try:
        log = run(load_scenario(name, {"machine": machine, "physics": physics}))
    except ScenarioError as error:
        return {"machine": machine, "name": name, "ends": "refused", "expected": False, "reason": str(error)}
    found = {"reason": log.metrics.get("stop_reason"), "warnings": log.metrics["physics_warnings"]}
    return {"machine": machine, "name": name, "ends": log.outcome, "expected": log.as_expected, **found}


def exceptions(study: Study) -> Blocks:
    rows = study.done("machines", drive, [(machine, name) for name in scenario_files() for machine in machine_files()])
    groups: dict[Pair, list[str]] = defaultdict(list)
    for row in rows:
        if not row["expected"]:
            groups[row["name"], row["ends"]].append(f"`{row['machine']}`")
    if missing := {name for name, _ in groups} - set(WHY):
        raise SystemExit(f"scripts/measured/machines.toml: add a reason for {', '.join(sorted(missing))}")
    lines = [(f"`{name}`", ", ".join(some), ends, WHY[name]) for (name, ends), some in groups.items()]
    return {BLOCK: markdown_table(("scenario", "machine", "outcome", "reason"), lines) if rows else ""}


def listed() -> dict[Pair, str]:
    """Return the outcomes of the exceptions that the page lists."""
    found = {}
    for line in block(page("machines").read_text(encoding="utf-8"), BLOCK).splitlines()[2:]:
        name, machines, ends, _ = (cell.strip() for cell in line.strip("|").split("|"))
        found |= {(machine.strip(" `"), name.strip("`")): ends for machine in machines.split(",")}
    return found


PARTS = {"machines": exceptions}
