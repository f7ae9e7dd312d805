"""Table of exceptions on docs/machines.md: scenarios with an unexpected outcome on a machine.

Every scenario is simulated on every machine with the guidance law of the machine and `physics = "fast"`, except the
scenarios in `STANDARD`. `WHY` contains a reason for each exception.
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
"""Physical reason for an unexpected outcome, by scenario."""


def drive(pair: Pair) -> Row:
    """Simulate a scenario on a machine, and return a row with the outcome."""
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
    """Return the outcomes in the table of exceptions on the page, by machine and scenario."""
    found = {}
    for line in block(page("machines").read_text(encoding="utf-8"), BLOCK).splitlines()[2:]:
        name, machines, ends, _ = (cell.strip() for cell in line.strip("|").split("|"))
        found |= {(machine.strip(" `"), name.strip("`")): ends for machine in machines.split(",")}
    return found


PARTS = {"machines": exceptions}
