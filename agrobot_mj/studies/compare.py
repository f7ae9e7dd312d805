"""Execution of a comparison: runs, results table, and the figures of the paper."""

import json
import sys
from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj.core.errors import is_installed
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import error_of, failures, has_errors, without_errors
from agrobot_mj.simulation.log import Log, SavedRows
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import results, write_json
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import can_record
from agrobot_mj.studies.compare_plan import Case, Comparison
from agrobot_mj.studies.engine.tasks import LAST, POSES, Row
from agrobot_mj.studies.error_parts import ESTIMATOR, GUIDANCE, remarks
from agrobot_mj.studies.pieces import pieces
from agrobot_mj.studies.sweep.runner import SweepOptions, drive
from agrobot_mj.studies.sweep.store import Store

FIGURES = ("trajectory", "longitudinal_error", "lateral_error", "control_signals", "yaw_rate_error", "q")
FILES = ("comparison.json", "comparison.rrd", *(f"{name}.png" for name in FIGURES))
"""Result files of a comparison, in addition to the files of a sweep and one folder per run."""


def compare(comparison: Comparison, folder: Path, jobs: int | None = None, quiet: bool = True) -> list[dict[str, Any]]:
    """Simulate the missing runs of a comparison and write all results to `folder`. Return the rows of comparison.json.

    The row of a failed run contains no tracking errors; metrics.json of the run contains the measured values. If a run
    raised an exception, its row contains `error` and no metrics. The figures and the common recording contain the first
    `MOST_DRAWN` laws with the first seed.
    """
    store = Store(folder, comparison)
    with results(folder, (*FILES, *store.names)):
        drive(store, SweepOptions(jobs, quiet=quiet))
        done = dict(store.rows())
        covered = pieces(case.scenario for case in comparison.cases)
        files = {k: folder / comparison.folder(k) / LAST for k, row in done.items() if row["error"] is None}
        ended = {k: json.loads(file.read_text("utf-8")) for k, file in files.items()}
        rows = [_row(case, covered[k], done[k], ended.get(k, {})) for k, case in enumerate(comparison.cases)]
        write_json(folder / "comparison.json", rows)
        logs = [(comparison.cases[k], _log(store, k, ended[k])) for k in comparison.drawn if k in ended]
        with tally(f"{folder.name}: recording and figures", 2, quiet=quiet) as advance:
            if comparison.recorded and logs and can_record():
                from agrobot_mj.recording import write_comparison

                write_comparison([(f"{case.plant}-{case.law}", log) for case, log in logs], folder / "comparison.rrd")
            advance()
            _draw(logs, folder)
            advance()
    return rows


def _draw(logs: Sequence[tuple[Case, Log]], folder: Path) -> None:
    if not is_installed("matplotlib"):
        print('no figures: matplotlib is not installed; pip install "agrobot-mj[report]"', file=sys.stderr)
        return
    from agrobot_mj.studies.report import ReportedRun, write_figures

    write_figures([ReportedRun(case.plant, case.law, log, not log.as_expected) for case, log in logs], folder)


def _log(store: Store, number: int, metrics: dict[str, Any]) -> Log:
    task = store.task(number)
    sim = Simulation(store.file(task, "scenario.toml"))
    table = pq.read_table(store.file(task, "signals.parquet").absolute())
    values = np.column_stack([table[name].to_numpy() for name in sim.rows.columns])
    kept = task.keep == "poses"
    poses = np.load(store.file(task, POSES)) if kept else np.zeros((len(values), *sim.rows.poses.shape[1:]))
    sim.rows.restore(SavedRows(len(values), (), (values, poses)))
    return Log(sim.scenario, sim.rows, sim.loop.plant.scene, metrics["outcome"], metrics["wall_s"], metrics)


def _row(case: Case, piece: int, row: Row, metrics: dict[str, Any]) -> Row:
    law = {"controller": case.controller, "guidance": case.scenario.guidance.kind, "variant": case.variant}
    about = {"plant": case.plant, **law, "seed": case.seed, "folder": case.folder, "piece": piece}
    end = ("outcome", "expected") if metrics else ("outcome", "expected", "error", "wall_s", "identity")
    return without_errors({**about, **{name: row[name] for name in end}, **metrics})


NONE = "-"  # Text of a table cell without a value
MEANINGS = {
    "lateral MSE [m2]": "mean square of the lateral error relative to the time-based reference",
    "turn 1": "lateral MSE in the first turn of the path",
    "turn 2": "lateral MSE in the second turn of the path",
    "/ pd": "lateral MSE divided by the lateral MSE of pd with the same plant, seed and field",
    "xte rms [m]": "root mean square distance from the path (cross-track error)",
    "estimator [m]": "estimator part of the cross-track error (true minus estimated position), root mean square",
    "guidance [m]": "guidance part of the cross-track error (estimated position minus path), root mean square",
    "steering [deg]": "wheel angle minus command, root mean square",
    "NEES": "normalised squared error of the estimated position, 2 if consistent",
    "nn 1": "fraction of the network in the steering command of the first turn",
    "nn 2": "fraction of the network in the steering command of the second turn",
}
"""Explanations of the numeric columns of the comparison table, by column title."""


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the comparison table in plain text (ASCII, valid Markdown) without a final newline.

    `rows` are the rows of comparison.json. Column `/ pd` is the lateral mean square error divided by the error of a
    reference law: the first law with the controller `pd` and the same plant, variant, seed and path segment. Failed
    runs have no error values. The columns variant, guidance, seed and segment are included if their values differ.
    Numeric columns without values are omitted.
    """
    of_pd = [row for row in reversed(rows) if row["controller"] == "pd"]
    pd_mse = {_place(row): error_of(row, "lateral_mse") for row in of_pd}
    names = [name for name in ("plant", "variant", "guidance", "controller", "seed", "piece") if _is_shown(rows, name)]
    lines = [
        (
            *(NONE if row.get(name) is None else row[name] for name in names),
            *(row.get("outcome", NONE), *_numbers(row, pd_mse.get(_place(row)))),
        )
        for row in rows
    ]
    heads = (*names, "outcome", *MEANINGS)
    # If the path has a single turn, the error of the turn is that of the path.
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
    """Return one line of explanation for each numeric column of the comparison table `text`."""
    heads = [head.strip() for head in text.partition("\n")[0].split("|")]
    shown = {head: meaning for head, meaning in MEANINGS.items() if head in heads}
    width = max(map(len, shown), default=0)
    return [f"{head:{width}}  {meaning}" for head, meaning in shown.items()]


def notes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return remarks on a comparison table: failed runs with their outcomes, and errors that are not comparable."""
    laws: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        laws.setdefault(str(row["folder"]).removesuffix(f"-s{row['seed']}"), []).append(row)
    found = [
        f"{law}: failed {text}; errors exclude these runs" for law, each in laws.items() if (text := failures(each))
    ]
    if len({row.get("piece") for row in rows}) > 1:
        found.append("the runs cover different segments of the path (column piece); compare errors within one only")
    by_plant = [{law: some for law, some in laws.items() if some[0]["plant"] == plant} for plant in _plants(rows)]
    return [*found, *(remark for some in by_plant for remark in remarks(some))]


def conclusion(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one sentence per plant that names the law with the minimum lateral mean square error.

    Plants for which no law is best with every seed are omitted. Without comparable errors, the list is empty.
    """
    if any(error_of(row, "lateral_mse") is None for row in rows) or len({row.get("piece") for row in rows}) > 1:
        return []
    found, first = list[str](), dict[str, float]()
    for plant in _plants(rows):
        errors: dict[str, dict[int, float]] = {}
        for row in (row for row in rows if row["plant"] == plant):
            law = str(row["folder"]).removeprefix(f"{plant}-").removesuffix(f"-s{row['seed']}")
            errors.setdefault(law, {})[row["seed"]] = row["lateral_mse"]
        means = {law: fmean(by_seed.values()) for law, by_seed in errors.items()}
        best, *others = sorted(means, key=lambda law: means[law])
        if not others or not all(errors[best][s] < errors[law][s] for law in others for s in errors[best]):
            continue
        seeds = f"all {n} seeds" if (n := len(errors[best])) > 1 else f"seed {next(iter(errors[best]))}"
        text = f"{plant}: {best} has the smallest lateral mean square error in {seeds}"
        text += f", {means[best] / means[others[0]]:.2f} times the error of {others[0]}"
        if best in first:
            text += f" and {means[best] / first[best]:.2f} times its error on {_plants(rows)[0]}"
        found.append(text)
        first = first or means
    return found


def _plants(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["plant"] for row in rows))


def _is_shown(rows: Sequence[Mapping[str, Any]], name: str) -> bool:
    """Return whether the table includes the column `name`: the plant always, the controller if a law has one, and other
    columns if their values differ."""
    values = {row.get(name) for row in rows}
    return name == "plant" or len(values) > 1 or (name == "controller" and values != {None})


def _place(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["plant"], row.get("variant"), row.get("seed"), row.get("piece")


def _numbers(row: Mapping[str, Any], pd_mse: float | None) -> list[str]:
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
