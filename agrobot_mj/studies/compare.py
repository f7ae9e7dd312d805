"""One scenario under several controllers, plants and seeds: folders, rows, and the paper's figures."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import write_json, write_log
from agrobot_mj.studies.pool import cores, spread
from agrobot_mj.studies.report import write_figures

PLANTS = ("bicycle", "mujoco")
"""Plants of a comparison unless others are named."""


class Case(NamedTuple):
    """One run of a comparison."""

    plant: str
    controller: str
    seed: int
    scenario: Scenario

    @property
    def folder(self) -> str:
        """Name of the run's folder."""
        return f"{self.plant}-{self.controller}-s{self.seed}"


def cases(scenario: Scenario, controllers: Sequence[str], plants: Sequence[str], seeds: int) -> list[Case]:
    """Every combination, checked; seeds count up from the scenario's. Raises `ScenarioError`."""
    return [
        Case(
            plant,
            controller,
            seed,
            scenario.changed({"plant.kind": plant, "controller.kind": controller, "seed": seed}),
        )
        for plant in plants
        for controller in controllers
        for seed in range(scenario.seed, scenario.seed + seeds)
    ]


def runnable(scenario: Scenario, plants: Sequence[str] = PLANTS) -> tuple[list[str], list[str]]:
    """Those of `plants` that can run the scenario, and one line per other plant that says why it cannot."""
    able, left_out = [], []
    for plant in plants:
        try:
            scenario.changed({"plant.kind": plant})
            able.append(plant)
        except ScenarioError as error:
            left_out.append(f"{plant} is left out: {str(error).splitlines()[0]}")
    return able, left_out


def compare(
    todo: Sequence[Case],
    folder: Path,
    rrd: bool = True,
    jobs: int | None = None,
    done: Callable[[Case], None] = lambda case: None,
) -> list[dict[str, Any]]:
    """Run all cases, some at a time, and write everything under `folder`; returns the rows of comparison.json."""
    logs: dict[str, Log] = {}
    for case, log in spread(partial(_run_case, folder=folder, rrd=rrd), todo, min(len(todo), jobs or cores())):
        logs[case.folder] = log
        done(case)
    rows = [_row(case, logs[case.folder]) for case in todo]
    write_json(folder / "comparison.json", rows)
    first = [case for case in todo if case.seed == todo[0].seed]
    if rrd:
        named = [(f"{case.plant}-{case.controller}", logs[case.folder]) for case in first]
        write_comparison(named, folder / "comparison.rrd")
    write_figures([(case.plant, case.controller, logs[case.folder]) for case in first], folder)
    return rows


def _run_case(case: Case, folder: Path, rrd: bool) -> Log:
    place = folder / case.folder
    log = run(case.scenario, (Recording(place / "run.rrd"),) if rrd else ())
    write_log(log, place)
    return log


def _row(case: Case, log: Log) -> dict[str, Any]:
    return {"plant": case.plant, "controller": case.controller, "seed": case.seed, **log.metrics}
