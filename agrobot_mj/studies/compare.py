"""A comparison: its runs, their folders and rows, and the paper's figures."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj.metrics.success import without_errors
from agrobot_mj.recording import write_comparison
from agrobot_mj.simulation.log import Log, SavedRows
from agrobot_mj.simulation.ownership import remove, reserve
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import RECORDING, clear, exclusive, files_of_run, write_json
from agrobot_mj.studies.compare_plan import Case
from agrobot_mj.studies.engine import ROWS, Task, base_text, resuming
from agrobot_mj.studies.engine.resume import RowFiles
from agrobot_mj.studies.engine.tasks import LAST, POSES
from agrobot_mj.studies.pieces import pieces
from agrobot_mj.studies.report import FIGURES, ReportedRun, write_figures

MOST_DRAWN = 24
"""Laws that figures and the common recording show; more could not be told apart."""


def compare(
    todo: Sequence[Case],
    folder: Path,
    rrd: bool = True,
    jobs: int | None = None,
    done: Callable[..., object] = lambda expected, there: None,
) -> list[dict[str, Any]]:
    """Do the cases that `folder` lacks, and write everything there; returns the rows of comparison.json.

    Tracking errors of a run that failed are None there; its own metrics.json has what was measured. A run that raised
    has `error` and no metrics. Figures and the common recording are of the first seed and the first `MOST_DRAWN` laws.
    `done` hears of each case whether it ended as `expected`, and whether its row was `there` already.
    """
    folders = [case.folder for case in todo]
    with resuming(folder, (*FILES, *folders), jobs, most=len(todo)) as resumed:
        reserve(folder, folders)
        found = resumed(_tasks(todo, resumed.files, rrd), folders, partial(_keep, resumed.files, todo), done)
        numbers = {case.folder: run.numbers for case, run in zip(todo, found, strict=True)}
        covered = pieces(case.scenario for case in todo)
        rows = [_row(case, piece, numbers[case.folder]) for case, piece in zip(todo, covered, strict=True)]
        write_json(folder / "comparison.json", rows)
        _draw(drawn(todo), folder, numbers, rrd)
    return rows


def _tasks(todo: Sequence[Case], files: RowFiles, rrd: bool) -> list[Task]:
    """The runs, of which those that are to be drawn together keep their poses; rows whose files are lost go."""
    tasks, shown = [], {case.folder for case in drawn(todo)}
    for k, case in enumerate(todo):
        kept = "signals" if not rrd else "poses" if case.folder in shown else "recordings"
        tasks.append(Task(k, base_text(case.scenario), case.scenario.name, {}, kept))
        needed = [files.folder / case.folder / LAST, *([files.folder / _poses(case)] if kept == "poses" else [])]
        if not all(map(Path.is_file, needed)):
            files.forget(case.folder)
    return tasks


def _keep(files: RowFiles, todo: Sequence[Case], k: int, contents: Mapping[str, bytes]) -> None:
    """Write the files of a run into its folder, in place of those of an earlier one."""
    place = files.folder / todo[k].folder
    with exclusive(place, files_of_run(todo[k].scenario)):
        clear(place)
        remove(place, [RECORDING])
        for name, content in contents.items():
            files.write_bytes(_poses(todo[k]) if name == POSES else Path(place.name, name), content)


def _draw(shown: Sequence[Case], folder: Path, numbers: Mapping[str, dict[str, Any]], rrd: bool) -> None:
    """Draw the figures and the common recording of those runs that did not raise."""
    ended = [case for case in shown if numbers[case.folder]["error"] is None]
    logs = [(case, _log(case, folder, numbers[case.folder], rrd)) for case in ended]
    if rrd and logs:
        write_comparison([(f"{case.plant}-{case.law}", log) for case, log in logs], folder / "comparison.rrd")
    write_figures([ReportedRun(case.plant, case.law, log, not log.as_expected) for case, log in logs], folder)


FILES = ("comparison.json", "comparison.rrd", *(f"{draw.__name__}.png" for draw in FIGURES))
"""Files of a comparison beside the folders of its runs."""


def drawn(todo: Sequence[Case]) -> list[Case]:
    """The cases that figures show."""
    laws = list(dict.fromkeys(case.law for case in todo))[:MOST_DRAWN]
    return [case for case in todo if case.seed == todo[0].seed and case.law in laws]


def _poses(case: Case) -> Path:
    """File with the poses of a run, below the folder of the comparison."""
    return Path(ROWS, f"{case.folder}.npy")


def _log(case: Case, folder: Path, numbers: dict[str, Any], rrd: bool) -> Log:
    """A run from its files, with its poses if they were kept for the common recording."""
    sim = Simulation(case.scenario)
    table = pq.read_table((folder / case.folder / "signals.parquet").absolute())
    values = np.column_stack([table[name].to_numpy() for name in sim.rows.columns])
    poses = np.load(folder / _poses(case)) if rrd else np.zeros((len(values), *sim.rows.poses.shape[1:]))
    sim.rows.restore(SavedRows(len(values), (), (values, poses)))
    return Log(case.scenario, sim.rows, sim.loop.plant.scene, numbers["outcome"], numbers["wall_s"], numbers)


def _row(case: Case, piece: int, numbers: dict[str, Any]) -> dict[str, Any]:
    law = {"controller": case.controller, "guidance": case.scenario.guidance.kind, "variant": case.variant}
    about = {"plant": case.plant, **law, "seed": case.seed, "folder": case.folder, "piece": piece}
    without = {"version", *(["error"] if numbers["error"] is None else [])}
    return without_errors({**about, **{name: value for name, value in numbers.items() if name not in without}})
