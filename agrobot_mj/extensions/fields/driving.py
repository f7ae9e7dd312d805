"""Simulation of a field plan. The results folder contains the files of a run and the coverage of the field."""

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.cli.options import Answer, results_folder
from agrobot_mj.cli.output import print_hints
from agrobot_mj.cli.runs import answer
from agrobot_mj.extensions.fields.boom import Boom
from agrobot_mj.extensions.fields.crop_rows import CropRows
from agrobot_mj.extensions.fields.drive import PLAN_FILE, driving_scenario
from agrobot_mj.extensions.fields.effort import Prices
from agrobot_mj.extensions.fields.evaluation import FieldDrive, report
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.maps import map_of, write_geojson
from agrobot_mj.extensions.fields.plan import Plan, to_json
from agrobot_mj.extensions.fields.planner.area import body_of, whole_of
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.extensions.fields.raster import write_raster
from agrobot_mj.extensions.fields.resume import Interrupted
from agrobot_mj.metrics import RunView
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.progress import Progress
from agrobot_mj.simulation.results import atomic, results, write_json
from agrobot_mj.simulation.run import Watcher, run
from agrobot_mj.simulation.storage import RECORDING, files_of_run, write_log
from agrobot_mj.studies.style import write_figure

if TYPE_CHECKING:
    from agrobot_mj.scenario.schema import Scenario

FILES = ("coverage.json", "coverage.geojson", "coverage.png", "coverage.tif")


class Hectares(Progress):
    """Progress bar of a simulation that also shows the area [ha] worked so far according to the plan."""

    def __init__(self, plan: Plan, path: Any) -> None:
        super().__init__()
        ends = [(path.motion.time_at(one.start), path.motion.time_at(one.end)) for one in plan.passes]
        hectares = np.cumsum([(one.end - one.start) * plan.width / 1e4 for one in plan.passes])
        self.times = np.array(ends).ravel()
        self.hectares = np.column_stack([np.concatenate(([0.0], hectares[:-1])), hectares]).ravel()

    def advance(self, first: int) -> None:
        """Update the progress bar and the worked area. `first` is the index of the first new row of the log."""
        super().advance(first)
        if self.bar and self.rows.filled:
            done = np.interp(float(self.rows.column("t", self.rows.filled - 1)[0]), self.times, self.hectares)
            self.bar.update(self.number, description=f"{done:.2f} of {self.hectares[-1]:.2f} ha")


def drive(
    field: Field,
    plan: Plan,
    base: "Scenario",
    rig: FieldMachine,
    boom: Boom,
    overrides: dict[str, Any],
    out: Path | None,
    recorded: bool,
    quiet: bool,
    resume: bool,
    prices: Prices,
    rows: CropRows | None,
) -> Answer:
    """Simulate the work on a field, write all results to a folder, and return the output of the command."""
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / PLAN_FILE
        write_json(file, to_json(plan))
        scenario = driving_scenario(field, plan, file, base, overrides)
        folder = results_folder(out, f"{scenario.name}-{scenario.hash8}")
        whole, body = whole_of(field), body_of(field, plan)

        drives: list[FieldDrive] = []

        def drove_of(log: Log) -> FieldDrive:
            if not drives:
                drives.append(FieldDrive(log.view or RunView(log), plan, whole, body, rig, boom, prices, rows))
            return drives[0]

        said = print_hints([scenario], quiet)
        watchers: list[Watcher] = [] if quiet else [Hectares(plan, scenario.path)]
        if recorded:
            from agrobot_mj.extensions.fields.layers import WorkRecording

            watchers.append(WorkRecording(folder / RECORDING, whole, drove_of))
        with results(folder, (*files_of_run(scenario), *FILES)), stop_on_signals() as stopped:
            interrupted = Interrupted(scenario, stopped)
            if resume:
                interrupted.load()
            log = run(scenario, tuple(watchers), ticks=interrupted.ticks)
            drove = drove_of(log)
            content = {**report(drove), "origin": field.plane and list(field.plane)}
            write_log(log, folder, recorded=recorded)
            write_coverage(folder, field, drove, content)
    if log.outcome == "aborted" and not quiet:
        print(f"{scenario.name}: to continue the drive, add --resume to the same command", file=sys.stderr)
    found = answer(log, folder, said, [content["summary"]])
    return found._replace(content={**found.content, "coverage": content})


def write_coverage(folder: Path, field: Field, drove: FieldDrive, content: dict[str, Any]) -> None:
    """Write the coverage of simulated field work as JSON, GeoJSON, raster map and figure."""
    write_json(folder / "coverage.json", content)
    write_geojson(folder / "coverage.geojson", drove.field, drove.plan, drove.coverage, field.plane)
    with atomic(folder / "coverage.tif") as path:
        write_raster(path, drove.pass_map, field.plane)
    write_figure(folder / "coverage.png", map_of, drove.field, drove.plan, drove.coverage, drove.track)
