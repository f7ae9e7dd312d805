"""A comparison: its runs, their folders and rows, its table, and the paper's figures."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import error_of, failures, has_errors, without_errors
from agrobot_mj.recording import write_comparison
from agrobot_mj.simulation.log import Log, SavedRows
from agrobot_mj.simulation.results import remove, results, write_json
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import RECORDING, clear, files_of_run
from agrobot_mj.studies.compare_plan import Case
from agrobot_mj.studies.engine import ROWS, Task, base_text, resuming
from agrobot_mj.studies.engine.resume import RowFiles
from agrobot_mj.studies.engine.tasks import POSES, files_kept
from agrobot_mj.studies.error_parts import ESTIMATOR, GUIDANCE, remarks
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
    with resuming(folder, (*FILES, *(f"{name}/" for name in folders)), jobs, most=len(todo)) as resumed:
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
        if not all((files.folder / _kept_file(case, name)).is_file() for name in files_kept(kept, True)):
            files.forget(case.folder)
    return tasks


def _keep(files: RowFiles, todo: Sequence[Case], k: int, contents: Mapping[str, bytes]) -> None:
    """Write the files of a run into its folder, in place of those of an earlier one."""
    place = files.folder / todo[k].folder
    with results(place, files_of_run(todo[k].scenario)):
        clear(place)
        remove(place, [RECORDING])
        for name, content in contents.items():
            files.write_bytes(_kept_file(todo[k], name), content)


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


def _kept_file(case: Case, name: str) -> Path:
    """A file of a run below the folder of the comparison; that of its poses lies with the rows."""
    return Path(ROWS, f"{case.folder}.npy") if name == POSES else Path(case.folder, name)


def _log(case: Case, folder: Path, numbers: dict[str, Any], rrd: bool) -> Log:
    """A run from its files alone, with its poses if they were kept for the common recording."""
    sim = Simulation(folder / case.folder / "scenario.toml")
    table = pq.read_table((folder / case.folder / "signals.parquet").absolute())
    values = np.column_stack([table[name].to_numpy() for name in sim.rows.columns])
    poses = np.load(folder / _kept_file(case, POSES)) if rrd else np.zeros((len(values), *sim.rows.poses.shape[1:]))
    sim.rows.restore(SavedRows(len(values), (), (values, poses)))
    return Log(sim.scenario, sim.rows, sim.loop.plant.scene, numbers["outcome"], numbers["wall_s"], numbers)


def _row(case: Case, piece: int, numbers: dict[str, Any]) -> dict[str, Any]:
    law = {"controller": case.controller, "guidance": case.scenario.guidance.kind, "variant": case.variant}
    about = {"plant": case.plant, **law, "seed": case.seed, "folder": case.folder, "piece": piece}
    without = {"version", *(["error"] if numbers["error"] is None else [])}
    return without_errors({**about, **{name: value for name, value in numbers.items() if name not in without}})


NONE = "-"
"""Cell without a value."""
MEANINGS = {
    "lateral MSE [m2]": "mean square of the error sideways, to the place where the reference is at that time",
    "turn 1": "the same in the first turn of the path",
    "turn 2": "the same in the second turn",
    "/ pd": "lateral MSE over that of pd, same plant, seed and field",
    "xte rms [m]": "root mean square distance from the path (cross-track error)",
    "estimator [m]": "part of it: true less estimated position, root mean square",
    "guidance [m]": "part of it: estimated position relative to the path, root mean square",
    "steering [deg]": "wheel angle less its command, root mean square",
    "NEES": "squared error of the estimated position over its stated variance, 2 if consistent",
    "nn 1": "share of the network in the steering command of the first turn",
    "nn 2": "the same in the second turn",
}
"""Numbers of the table by their heads, and what they mean."""


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The comparison as a plain text table, ASCII and valid Markdown, without a final newline.

    `rows` are those of `comparison.json`. `/ pd` is the lateral mean square error over that of the first law with `pd`
    on the same plant, variant, seed and piece of path; runs that failed have no errors (`metrics.success`). Variant,
    guidance, seed and piece have a column where they tell rows apart, numbers where a row has one.
    """
    of_pd = [row for row in reversed(rows) if row["controller"] == "pd"]
    pd_mse = {_place(row): error_of(row, "lateral_mse") for row in of_pd}
    names = [name for name in ("plant", "variant", "guidance", "controller", "seed", "piece") if _tells(rows, name)]
    lines = [
        (
            *(NONE if row.get(name) is None else row[name] for name in names),
            *(row.get("outcome", NONE), *_numbers(row, pd_mse.get(_place(row)))),
        )
        for row in rows
    ]
    heads = (*names, "outcome", *MEANINGS)
    # The only turn of a path is the whole path, whose error stands before.
    left_out = [] if any(len(row.get("per_turn") or []) > 1 for row in rows) else ["turn 1"]
    left_out += [] if any(row.get("estimate_warning") for row in rows) else ["NEES"]
    filled = [
        k
        for k, (head, *column) in enumerate(zip(heads, *lines, strict=True))
        if k <= len(names) or (set(column) != {NONE} and head not in left_out)
    ]
    shown = [[line[k] for k in filled] for line in (heads, *lines)]
    return markdown_table(shown[0], shown[1:], len(names) + 1, aligned=True)


def legend(text: str) -> list[str]:
    """A line for each number in the heads of a `table`, with what it means."""
    heads = [head.strip() for head in text.partition("\n")[0].split("|")]
    shown = {head: meaning for head, meaning in MEANINGS.items() if head in heads}
    width = max(map(len, shown), default=0)
    return [f"{head:{width}}  {meaning}" for head, meaning in shown.items()]


def notes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines under the table: which runs failed and how, and whether errors can be compared at all."""
    laws: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        laws.setdefault(str(row["folder"]).removesuffix(f"-s{row['seed']}"), []).append(row)
    found = [f"{law}: failed {text}; no errors of these" for law, some in laws.items() if (text := failures(some))]
    if len({row.get("piece") for row in rows}) > 1:
        found.append("the runs cover different pieces of path (column piece): compare errors within one piece only")
    by_plant = [{law: some for law, some in laws.items() if some[0]["plant"] == plant} for plant in _plants(rows)]
    return [*found, *(remark for some in by_plant for remark in remarks(some))]


def _plants(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["plant"] for row in rows))


def _tells(rows: Sequence[Mapping[str, Any]], name: str) -> bool:
    """Whether a column is shown: the plant always, the controller where there is one, others where they differ."""
    values = {row.get(name) for row in rows}
    return name == "plant" or len(values) > 1 or (name == "controller" and values != {None})


def _place(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["plant"], row.get("variant"), row.get("seed"), row.get("piece")


def _numbers(row: Mapping[str, Any], pd_mse: float | None) -> list[str]:
    """Cells of a row of the table, from its mean square error on."""
    mse = error_of(row, "lateral_mse")
    turns = (row.get("per_turn") or []) if has_errors(row) else []
    whole = {turn["turn"]: turn for turn in turns if turn["complete"]}
    shares = {number: share for number, share in enumerate(row.get("nn_share", []), 1) if share and number in whole}
    return [
        _text(mse, "#.3g"),
        *(_text(whole[k]["lateral_mse"], "#.3g") if k in whole else NONE for k in (1, 2)),
        _text(mse / pd_mse if mse is not None and pd_mse else None, ".2f"),
        *(_text(error_of(row, name), ".3f") for name in ("xte_rms", ESTIMATOR, GUIDANCE)),
        _text(None if (angle := row.get("steer_error_rms")) is None else degrees(angle), ".1f"),
        _text(row.get("position_nees"), ".1f"),
        *(_text(shares.get(k), ".3f") for k in (1, 2)),
    ]


def _text(value: float | None, form: str) -> str:
    if value is None:
        return NONE
    return f"{value:{form}}" if abs(value) < 1e4 else f"{value:.1e}"
