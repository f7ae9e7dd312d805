"""Page estimators_tables: estimators in closed loop (sweeps `estimators`, `estimator_settings`) and on recorded drives.

Parts: `loop`, both sweeps; `recorded`, drives of the paper's stack; `consistency`, `ekf_full` on various grounds;
`speeds`, consistency of `ekf_full` by speed and machine. `--seeds` also limits the number of sensor seeds.
"""

import json
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import groupby, starmap
from math import degrees, radians
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import consistency as ground
import numpy as np
from consistency import CASES, DRIVES, SEEDS, drive, judged
from estimates import bootstrap_interval, estimate
from recorded_drives import (
    BEGIN_S,
    BIAS,
    DURATION_S,
    FULL,
    PAPER,
    SLOPE,
    TILT,
    UKF,
    Day,
    RecordedDrive,
    alignment,
    end,
    follow,
    late,
    loss,
    nominal,
    outlier,
    record,
    rms,
    whole,
)
from sweeps import Blocks, KeptRun, Row, Study

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S

KINDS = (PAPER, UKF, BIAS, FULL)
RECORDED, SEEDS_FULL, SEEDS_OTHER = 4, 20, 4
"""Number of recorded drives, and numbers of sensor seeds for `ekf_full` and for other estimators."""
COMMON = ("case", "estimator", "position [cm]", "heading [deg]", "course [deg]")
GROUNDS: dict[str, tuple[dict[str, Any], dict[str, Any], Day]] = {
    "level": ({}, {}, nominal),
    "level, fixes 0.2 s late": ({}, {}, late(0.2)),
    "soil": ({"plant.tyre.kind": "soil"}, {}, nominal),
    "side slope 10 deg, compensated": (SLOPE, TILT, nominal),
    "rough ground of class D, compensated": ({"terrain": {"kind": "rough", "iso_class": "D"}}, TILT, nominal),
}
"""Cases of the figure eight: overrides of the run, overrides of the estimator, and conditions as a function of time."""
LOSS_STARTS_S, HEADINGS_DEG = (25.0, 75.0), (0, 45, 90, 135, 180, -90)
"""Start times of GNSS outages [s], at least 20 s before the end of an arc, and errors of the initial heading [deg]."""


def loop(study: Study) -> Blocks:
    """Return the closed-loop table: means over the seeds, one row per case and estimator."""
    lines = []
    for name in ("estimators", "estimator_settings"):
        for (case, estimator), runs in groupby(study.rows(name), lambda row: (row["variant"], row["estimator"])):
            keys = json.loads(estimator)
            if of_interest(case, keys):
                numbers = np.mean([loop_numbers(study.kept(name, run)) for run in runs], axis=0)
                told = ", ".join([keys.pop("kind"), *starmap(setting, keys.items())])
                lines.append((case, told, *map(short, numbers)))
    heads = (*COMMON, "NEES", "NIS", "coast [cm]", "speed [cm/s]", "lateral [cm]")
    return {"loop": markdown_table(heads, lines, 2) if lines else ""}


def short(value: float) -> str:
    """Return a number as text with three significant digits, or as an integer from 1000. NaN gives an empty text."""
    return "" if np.isnan(value) else f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def setting(key: str, value: float) -> str:
    return "compensated" if key == "terrain_compensation" else f"{key} {value:g}"


def loop_numbers(run: KeptRun) -> list[float]:
    """Return the errors of a run after `BEGIN_S`, in the order of the table columns. The error `coast` is NaN without
    an outage."""
    c, counts = run.column, run.column("t") > BEGIN_S
    error = np.hypot(c("rear_x_hat") - c("rear_x"), c("rear_y_hat") - c("rear_y"))
    course = np.arctan2(np.gradient(c("rear_y")), np.gradient(c("rear_x")))
    lost = np.flatnonzero(c("gnss_quality") == 0)
    return [
        100 * rms(error[counts]),
        *(degrees(rms(wrap(c("yaw_hat") - true)[counts])) for true in (c("yaw"), course)),
        float(np.mean(c("position_nees")[counts])),
        float(np.nanmean(c("position_nis")[counts])),
        100 * float(error[lost[-1]]) if lost.size else np.nan,
        *(100 * rms(values[counts]) for values in (c("speed_hat") - c("speed"), c("e_lateral"))),
    ]


def of_interest(case: str, keys: Row) -> bool:
    """Return whether the table shows the estimator settings `keys` in a case. Tilt compensation is shown only on
    slopes, and the swing filter only on rough ground."""
    if "swing_filter_s" in keys:
        return "rough" in case
    return "slope" in case or ("terrain_compensation" not in keys and (len(keys) == 1 or "rough" not in case))


def recorded(study: Study) -> Blocks:
    """Return tables of estimators on recorded drives: steady state, outages, outliers, initial heading errors."""
    if study.only_draw:
        return {}
    seeds = study.seeds or SEEDS_FULL

    @cache
    def drives(case: str) -> list[RecordedDrive]:
        return [record("figure_eight", {**GROUNDS[case][0], "seed": k + 1}) for k in range(min(RECORDED, seeds))]

    def runs(
        kind: dict[str, Any], case: str = "level", until: float = DURATION_S
    ) -> Iterator[tuple[RecordedDrive, int]]:
        """Yield recorded drives with sensor seeds. Each drive ends at the time `until` [s]."""
        for k in range(seeds if kind is FULL else min(SEEDS_OTHER, seeds)):
            one = drives(case)[k % len(drives(case))]
            yield one._replace(truths=one.truths[: round(until / TICK_S)]), 100 + k

    settled, lost, struck, aligned = (list[tuple[str, ...]]() for _ in range(4))
    for case, (_, keys, day) in GROUNDS.items():
        for kind in KINDS:
            numbers = [whole(follow(one, {**kind, **keys}, seed, day))[:7] for one, seed in runs(kind, case)]
            settled.append((case, kind["kind"], *map(short, np.mean(numbers, axis=0))))
    for seconds in (5.0, 20.0):
        for kind in KINDS:
            off = np.array([
                end(follow(one, kind, seed, loss(start, seconds)), start + seconds).position
                for start in LOSS_STARTS_S
                for one, seed in runs(kind, until=start + seconds)
            ])  # fmt: skip
            lost.append((f"{seconds:g} s", kind["kind"], short(rms(off)), short(off.max())))
    for kind in KINDS:
        moved = []
        for one, seed in runs(kind, until=40.0):
            clean, off = (follow(one, kind, seed, day) for day in (nominal, outlier(30.0, 2.0)))
            moved.append(100 * float(np.hypot(off.east - clean.east, off.north - clean.north).max()))
        struck.append((kind["kind"], f"{max(moved):.2g}"))
    for error in HEADINGS_DEG:
        runs_15 = runs(FULL, until=15.0)
        found = [alignment(follow(one, FULL, seed, yaw_error=radians(error))) for one, seed in runs_15]
        metres, off = np.transpose(found)
        aligned.append((f"{error} deg", f"{metres.max():.2f}", f"{rms(off):.2f}", f"{off.max():.2f}"))
    heads = (
        "error of the start heading",
        "distance to alignment, maximum [m]",
        "heading error after 5 m, rms [deg]",
        "worst [deg]",
    )
    return {
        "settled": markdown_table((*COMMON, "yaw rate [deg/s]", "NEES", "NIS", "time [us]"), settled, 2),
        "losses": markdown_table(("GNSS loss in an arc", "estimator", "rms [cm]", "worst [cm]"), lost, 2),
        "outliers": markdown_table(
            ("kind", "maximum shift of the estimate by one fix with an error of 2 m [cm]"), struck, 1
        ),
        "alignments": markdown_table(heads, aligned, 0),
    }


def mean(values: Sequence[float]) -> str:
    """Return the mean of the values and its bootstrap interval as text."""
    return estimate(values, bootstrap_interval).text()


def consistency(study: Study) -> Blocks:
    """Return tables about the consistency of `ekf_full` on various grounds."""
    if study.only_draw:
        return {}
    wholes, lost = list[tuple[str, ...]](), list[tuple[str, ...]]()
    with TemporaryDirectory() as folder:
        for case in CASES:
            drives = [drive(case, seed, Path(folder)) for seed in DRIVES[: study.seeds]]
            found = judged(drives, case.estimator, SEEDS[: study.seeds])
            one = {name: [getattr(w, name) for w in found.wholes] for name in found.wholes[0]._fields}
            position, heading, nis = (np.mean(one[name]) for name in ("position", "heading", "nis"))
            nees = mean(one["nees"]), mean(one["heading_nees"])
            wholes.append((case.name, f"{position:.2f}", f"{heading:.3f}", *nees, f"{nis:.2f}"))
            for seconds, seeds in found.losses.items():
                off, stated = (np.array([e[k] for some in seeds for e in some]) for k in (0, 1))
                numbers = (f"{v:.1f}" for v in (rms(off), off.max(), rms(stated)))
                nees = (mean([float(np.mean([e[k] for e in some])) for some in seeds]) for k in (2, 3))
                lost.append((case.name, f"{seconds:g} s", *numbers, *nees))
    heads = ("case", "position [cm]", "heading [deg]", "NEES", "heading NEES", "NIS")
    loss_heads = ("case", "loss", "rms [cm]", "worst [cm]", "stated [cm]", "NEES", "heading NEES")
    return {
        "consistency": markdown_table(heads, wholes, 1),
        "consistency_losses": markdown_table(loss_heads, lost, 2),
    }


SPEEDS_M_S, MACHINES, LOSS_S = (0.8, 1.2, 2.2, 3.0), {"compact": 1.0, "utility": 6.7, "row_crop": 12.5}, 11.0
"""Speeds [m/s], masses of machines divided by the mass of the compact tractor [-], and duration of outages [s]."""
CELLS = [(k, machine, speed) for k in range(len(CASES)) for machine in MACHINES for speed in SPEEDS_M_S]
"""Cells of the tables (case, machine and speed), row by row."""


def cell(job: tuple[int, str, float]) -> dict[str, str]:
    """Return one cell of each table as text: NEES of the position, NEES of the heading, and error and reported standard
    deviation after outages [cm]."""
    index, machine, speed = job
    case = CASES[index]
    with TemporaryDirectory() as folder:
        keys = {"machine": machine} if machine != "compact" else {}
        more = case.overrides(DRIVES[0], Path(folder))
        for fault in more.get("fault", ()):
            fault["pull_n"] *= MACHINES[machine]
        if case.scenario == "straight_line":
            half = max(ground.HALF_WIDTH_M, 37.0 + ground.DURATION_S * speed / 2.0)
            more = ground.contour(DRIVES[0], Path(folder), half)
        else:
            more["path.turns"] = 1 + round(speed)
        one = drive(case, DRIVES[0], Path(folder), **keys, **more, physics="fast", **{"path.speed_m_s": speed})
        found = judged([one], case.estimator, SEEDS[:4], (LOSS_S,))
    ends = [each for some in found.losses[LOSS_S] for each in some]
    off, stated = (rms(np.array([getattr(e, name) for e in ends])) for name in ("position", "stated"))
    nees, heading = (mean([getattr(w, name) for w in found.wholes]) for name in ("nees", "heading_nees"))
    return {"nees": nees, "heading": heading, "loss": f"{off:.0f} / {stated:.0f}"}


def speeds(study: Study) -> Blocks:
    """Return tables about the consistency of `ekf_full` by speed and machine."""
    cells = study.done("estimator_speeds", cell, CELLS)
    if len(cells) < len(CELLS):
        return {}
    heads = ("case", "machine", *(f"{speed:g} m/s" for speed in SPEEDS_M_S))
    rows, n = [(case.name, machine) for case in CASES for machine in MACHINES], len(SPEEDS_M_S)
    blocks = {"speeds": "nees", "speeds_heading": "heading", "speed_losses": "loss"}
    return {
        block: markdown_table(
            heads, [(*r, *(c[name] for c in cells[n * k : n * k + n])) for k, r in enumerate(rows)], 2
        )
        for block, name in blocks.items()
    }


PARTS = {part.__name__: part for part in (loop, recorded, consistency, speeds)}
