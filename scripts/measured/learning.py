"""Comparison of learning laws with other laws: sweeps `learners` (model errors) and `learners_implement`."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from estimates import by_law, compared_tables, field
from sweeps import Blocks, KeptRun, Row, Study, shipped, variants

from agrobot_mj.metrics.base import RunView, rms
from agrobot_mj.metrics.success import has_errors

CASES: dict[str, dict[str, dict[str, Any]]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


def learners(study: Study) -> Blocks:
    """Return tables of errors per lap with a wrong model, and of paired differences from the learning law."""
    return {
        case: compared(study, "learners_" + case.split(",")[0].replace(" ", "_"), "learners", changes)
        for case, changes in CASES["learners"].items()
    }


def behind(study: Study) -> Blocks:
    """Return tables of the implement error per lap or pass, and of the tractor error on the learned line."""
    return {
        case: compared(study, "learners_" + case.replace(",", "").replace(" ", "_"), "learners_implement", changes)
        for case, changes in CASES["behind"].items()
    }


def compared(study: Study, name: str, sweep: str, changes: dict[str, Any]) -> str:
    """Return a table of means per law in a modified sweep, and of paired differences from the learning law."""
    common, whole = shipped(sweep)["set"], sweep == "learners"
    if "base" in changes:
        common = {key: value for key, value in common.items() if not key.startswith(("path.", "implement."))}
    rows = study.rows(name, sweep, **{**changes, "set": {**common, **changes["set"]}})
    numbers, learnt = (compared_numbers, "ILC") if whole else (implement_numbers, "LQR on a learnt line")
    found = [numbers(row, study.kept(name, row)) if has_errors(row) else row for row in rows]
    pairs = [(f"{learnt}, valve learnt", law) for law in variants(sweep) if law != f"{learnt}, valve learnt"]
    return compared_tables(columns(found), pairs, 2 if whole else 1) if rows else ""


def implement_numbers(run_row: Row, run: KeptRun) -> Row:
    """Return a row extended by errors of the implement and tractor, per lap or per pair of passes [cm]."""
    view = RunView(run)
    there, ours = view.beside_path("implement_x", "implement_y").offset, view.cg_on_path.offset
    if hasattr(run.scenario.path, "passes_s"):
        t = run.column("t")
        spans = [(t > start) & (t <= end) for start, end in run.scenario.path.passes_s]
        pieces = {f"passes {k + 1} and {k + 2}": spans[k] | spans[k + 1] for k in range(0, len(spans) - 1, 4)}
    else:
        pieces = {f"lap {k}": rows for k, rows in enumerate(view.turns, 1) if k in (1, 2, 4, 6)}
    errors = {f"implement, {name} [cm]": rms(there[rows]) for name, rows in pieces.items()}
    errors |= {f"tractor, {name} [cm]": rms(ours[rows]) for name, rows in list(pieces.items())[-1:]}
    return {**run_row, **{name: 100 * error for name, error in errors.items() if error is not None}}


def compared_numbers(row: Row, run: KeptRun) -> Row:
    """Return a row extended by errors per turn [cm] and the total steering travel [deg]."""
    travel = float(np.degrees(np.abs(np.diff(run.column("steer"))).sum()))
    errors = {f"turn {turn['turn']} [cm]": 100 * turn["xte_rms"] for turn in row["per_turn"]}
    return {**row, **errors, "steering travel [deg]": travel}


def columns(rows: Sequence[Row]) -> dict[str, dict[str, dict[int, float]]]:
    """Return the values of the columns in cm and deg, by column, by law and by seed."""
    measures = dict.fromkeys(name for row in rows for name in row if name.endswith(("[cm]", "[deg]")))
    return {name: by_law(rows, field(name)) for name in measures}
