"""Learners beside laws that do not learn.

Sweeps `learners`, where the model is wrong, and `learners_implement`, for what the tractor does not steer.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from estimates import by_law, compared_tables, field
from sweeps import Blocks, KeptRun, Row, Study, shipped, variants

from agrobot_mj.metrics.base import RunView, rms
from agrobot_mj.metrics.success import has_errors

WORN = {"kind": "valve_wear", "gain_share": 0.5, "dead_band_v": 0.6}
PULLED = (
    {"kind": "side_force", "force_n": 500.0},
    {"kind": "drawbar", "pull_n": 1200.0},
    {"kind": "steering_pot_bias", "bias_deg": 2.0},
)
SLOPE: dict[str, Any] = {"terrain.kind": "slope", "terrain.grade_deg": 10.0}
WRONG: dict[str, dict[str, Any]] = {
    "slope and worn valve": {**SLOPE, "fault": [WORN]},
    "ruts, worn valve and trailer": {"plant.tyre.kind": "ruts", "implement.kind": "drawn", "fault": [WORN]},
    "soft slope and side draught": {
        **SLOPE,
        "terrain.grade_deg": 7.0,
        "plant.tyre.kind": "soil",
        "plant.tyre.cone_index_kpa": 450.0,
        "fault": list(PULLED),
    },
}
"""Cases in which the model of the laws is wrong, by the name of the block."""
LEARNER = "ILC, valve learnt"
AGAIN = {**SLOPE, "terrain.grade_deg": 6.0, "fault": [WORN]}
SWATHS_OF_TEN = {"path.kind": "contour", "path.length_m": 40, "path.swath_m": 10, "path.count": 10}
BEHIND: dict[str, dict[str, Any]] = {
    "trailer on a slope": {"set": AGAIN},
    "trailer, wear from lap 5 on": {"set": {**SLOPE, "terrain.grade_deg": 6.0, "fault": [{**WORN, "start_s": 290.0}]}},
    "trailer on level ground": {"set": {}},
    "seeder on ten swaths": {"base": "seeder_contour", "set": SWATHS_OF_TEN},
}
"""What differs from the sweep `learners_implement`, by the name of the block."""


def learners(study: Study) -> Blocks:
    """Errors by lap, and what the learner is worse by than each of the others, where the model is wrong."""
    blocks, pairs = {}, [(LEARNER, name) for name in variants("learners") if name != LEARNER]
    for case, changes in WRONG.items():
        name = "learners_" + case.split(",")[0].replace(" ", "_")
        rows = study.rows(name, "learners", set={**shipped("learners")["set"], **changes})
        if rows:
            numbers = [compared_numbers(row, study.kept(name, row)) if has_errors(row) else row for row in rows]
            blocks[case] = compared_tables(columns(numbers), pairs, 2)
    return blocks


def behind(study: Study) -> Blocks:
    """Errors of the implement by lap or pass, and what the learnt line is worse by than the others."""
    laws = list(variants("learners_implement"))
    blocks, learnt = {}, "LQR on a learnt line, valve learnt"
    for case, changes in BEHIND.items():
        name = "learners_" + case.replace(",", "").replace(" ", "_")
        common = shipped("learners_implement")["set"]
        if "base" in changes:
            common = {key: value for key, value in common.items() if not key.startswith(("path.", "implement."))}
        rows = study.rows(name, "learners_implement", **{**changes, "set": {**common, **changes["set"]}})
        if rows:
            numbers = [implement_numbers(row, study.kept(name, row)) if has_errors(row) else row for row in rows]
            blocks[case] = compared_tables(columns(numbers), [(learnt, law) for law in laws if law != learnt], 1)
    return blocks


def implement_numbers(run_row: Row, run: KeptRun) -> Row:
    """A run's row with the errors of implement and tractor by lap, or on the passes of the first and the last two."""
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
    """A run's row with its errors per turn [cm], and the travel of the steering [deg]."""
    travel = float(np.degrees(np.abs(np.diff(run.column("steer"))).sum()))
    errors = {f"turn {turn['turn']} [cm]": 100 * turn["xte_rms"] for turn in row["per_turn"]}
    return {**row, **errors, "steering travel [deg]": travel}


def columns(rows: Sequence[Row]) -> dict[str, dict[str, dict[int, float]]]:
    """The numbers of a surface by measure, law and seed."""
    measures = dict.fromkeys(name for row in rows for name in row if name.endswith(("[cm]", "[deg]")))
    return {name: by_law(rows, field(name)) for name in measures}
