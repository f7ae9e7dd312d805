"""docs/estimators.md: estimators in the loop (sweeps `estimators`, `estimator_settings`), and on recorded drives.

Parts: `loop`, both sweeps; `recorded`, estimators on drives of the paper's stack; `consistency`, `ekf_full` where the
ground changes; `speeds`, the same for speeds and machines. `--seeds` reduces the seeds
of the sensors as well.
"""

import json
from collections.abc import Iterable, Iterator
from itertools import groupby, starmap
from math import degrees, radians
from typing import Any

import numpy as np
from consistency import CELLS, DRIVES, SEEDS, cell, consistency_tables, speed_table
from recorded_drives import (
    BEGIN_S,
    BIAS,
    DURATION_S,
    FULL,
    PAPER,
    SLOPE,
    TILT,
    Day,
    RecordedDrive,
    alignment,
    coasted,
    follow,
    late,
    loss,
    nominal,
    outlier,
    record,
    rms,
    settled,
)
from sweeps import Blocks, KeptRun, Row, Study, publish

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S

KINDS = (PAPER, BIAS, FULL)
RECORDED, SEEDS_FULL, SEEDS_OTHER = 4, 20, 4
"""Recorded drives, and seeds of the sensors over them for `ekf_full` and for the others."""
COMMON = ("case", "estimator", "position [cm]", "heading [deg]", "course [deg]")
CASES: dict[str, tuple[dict[str, Any], dict[str, Any], Day]] = {
    "level": ({}, {}, nominal),
    "level, fixes 0.2 s late": ({}, {}, late(0.2)),
    "soil": ({"plant.tyre.kind": "soil"}, {}, nominal),
    "side slope 10 deg, compensated": (SLOPE, TILT, nominal),
    "rough ground of class D, compensated": ({"terrain": {"kind": "rough", "iso_class": "D"}}, TILT, nominal),
}
"""Figure eights: overrides of the run, of the estimator, and the day."""
LOSS_STARTS_S = (25.0, 75.0)
"""Beginnings of the losses, each 20 s or more before the end of an arc [s]."""
HEADINGS_DEG = (0, 45, 90, 135, 180, -90)
"""Errors of the start heading [deg]."""


def loop(study: Study) -> Blocks:
    """Whole loops: a row per case and estimator, means over the seeds."""
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
    """Three digits of a number, and none after the point from 1000 on; nothing for NaN."""
    return "" if np.isnan(value) else f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def setting(key: str, value: float) -> str:
    """A setting of an estimator as the table calls it."""
    return "compensated" if key == "terrain_compensation" else f"{key} {value:g}"


def loop_numbers(run: KeptRun) -> list[float]:
    """Errors of one run after `BEGIN_S`, in the order of the table; the coast is NaN without a loss."""
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
    """Whether a line says something: compensation where the ground tilts, the filter of the swing where it is rough."""
    if "swing_filter_s" in keys:
        return "rough" in case
    return "slope" in case or ("terrain_compensation" not in keys and (len(keys) == 1 or "rough" not in case))


class Recorded:
    """Drives of the paper's stack, each recorded once, with a number of seeds for the sensors."""

    def __init__(self, seeds: int = SEEDS_FULL, duration: float = DURATION_S) -> None:
        self.seeds, self.duration, self.drives = seeds, duration, dict[str, list[RecordedDrive]]()

    def runs(
        self, kind: dict[str, Any], until: float = DURATION_S, ground: dict[str, Any] | None = None
    ) -> Iterator[tuple[RecordedDrive, int]]:
        """Drives up to a time [s], each with a seed of its sensors."""
        drives = self.drives.get(str(ground))
        if drives is None:
            cases = ({**(ground or {}), "seed": k + 1} for k in range(min(RECORDED, self.seeds)))
            self.drives[str(ground)] = drives = [record("figure_eight", case, self.duration) for case in cases]
        for k in range(self.seeds if kind is FULL else min(SEEDS_OTHER, self.seeds)):
            drive = drives[k % len(drives)]
            yield drive._replace(truths=drive.truths[: round(until / TICK_S)]), 100 + k

    def settled_table(self) -> str:
        """Errors and consistency of each kind in each case."""
        lines = []
        for case, (ground, keys, day) in CASES.items():
            for kind in KINDS:
                runs = self.runs(kind, ground=ground or None)
                numbers = [settled(follow(drive, {**kind, **keys}, seed, day)) for drive, seed in runs]
                lines.append((case, kind["kind"], *map(short, np.mean(numbers, axis=0))))
        return markdown_table((*COMMON, "yaw rate [deg/s]", "NEES", "NIS", "time [us]"), lines, 2)

    def losses_table(self, starts: Iterable[float] = LOSS_STARTS_S) -> str:
        """Errors at the end of a loss in an arc."""
        lines = []
        for seconds in (5.0, 20.0):
            for kind in KINDS:
                off = np.array([
                    coasted(follow(drive, kind, seed, loss(start, seconds)), start + seconds)
                    for start in starts
                    for drive, seed in self.runs(kind, start + seconds)
                ])  # fmt: skip
                lines.append((f"{seconds:g} s", kind["kind"], short(rms(off)), short(off.max())))
        return markdown_table(("loss in an arc", "estimator", "rms [cm]", "worst [cm]"), lines, 2)

    def outliers_table(self) -> str:
        """What one wrong fix does to the estimate."""
        lines = []
        for kind in KINDS:
            moved = []
            for drive, seed in self.runs(kind, 40.0):
                clean, struck = (follow(drive, kind, seed, day) for day in (nominal, outlier(30.0, 2.0)))
                moved.append(100 * float(np.hypot(struck.east - clean.east, struck.north - clean.north).max()))
            lines.append((kind["kind"], f"{max(moved):.2g}"))
        return markdown_table(("one fix off by 2 m", "moves the estimate by, worst [cm]"), lines, 1)

    def alignments_table(self) -> str:
        """How soon `ekf_full` finds its heading."""
        lines = []
        for error in HEADINGS_DEG:
            runs = self.runs(FULL, 15.0)
            found = [alignment(follow(drive, FULL, seed, yaw_error=radians(error))) for drive, seed in runs]
            metres, off = np.transpose(found)
            lines.append((f"{error} deg", f"{metres.max():.2f}", f"{rms(off):.2f}", f"{off.max():.2f}"))
        heads = ("start heading off by", "found after, worst [m]", "heading after 5 m, rms [deg]", "worst [deg]")
        return markdown_table(heads, lines, 0)


def recorded(study: Study) -> Blocks:
    """The four tables of recorded drives."""
    if study.only_draw:
        return {}
    drives = Recorded(study.seeds or SEEDS_FULL)
    tables = {"settled": drives.settled_table, "losses": drives.losses_table}
    tables |= {"outliers": drives.outliers_table, "alignments": drives.alignments_table}
    return {name: table() for name, table in tables.items()}


def consistency(study: Study) -> Blocks:
    """Whether `ekf_full` states its own errors."""
    if study.only_draw:
        return {}
    tables = consistency_tables(DRIVES[: study.seeds], SEEDS[: study.seeds])
    return dict(zip(("consistency", "consistency_losses"), tables, strict=True))


def speeds(study: Study) -> Blocks:
    """Whether `ekf_full` states its own errors at other speeds and on other machines."""
    cells = study.done("estimator_speeds", cell, CELLS)
    if len(cells) < len(CELLS):
        return {}
    names = {"nees": "speeds", "heading": "speeds_heading", "loss": "speed_losses"}
    return {block: speed_table(cells, name) for name, block in names.items()}


if __name__ == "__main__":
    publish(["estimators"], {part.__name__: part for part in (loop, recorded, consistency, speeds)}, __doc__)
