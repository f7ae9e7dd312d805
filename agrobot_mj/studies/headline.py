"""The comparison of the stack: guidance laws by surface, by estimator and by seed, with intervals.

Each case is one turn of the figure eight (or a short field of swaths), each seed other noise. A cell is the mean over
the seeds of the cross-track rms, with its 95 % bootstrap interval; a law is called better than another only where the
interval of their paired differences, seed by seed, excludes 0. Runs that did not complete count as failures beside.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.success import error_of
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.pool import cores, spread

PRINTED, TUNED = {"gains": "paper"}, {"gains": "tuned"}
"""Gains with which the paper's figures are reproduced, and those of the search for all laws."""
NETWORK, NETWORK_TUNED = "network as printed", "network tuned"
LAWS: dict[str, dict[str, Any]] = {
    "P as printed": {**PRINTED, "controller.kind": "pd"},
    NETWORK: {**PRINTED, "controller.kind": "pd_t2fnn"},
    "integral of sgn as printed": {**PRINTED, "controller.kind": "pd_isgn"},
    "P tuned": {**TUNED, "controller.kind": "pd"},
    NETWORK_TUNED: {**TUNED, "controller.kind": "pd_t2fnn"},
    "integral of sgn tuned": {**TUNED, "controller.kind": "pd_isgn"},
    "PI": {"controller.kind": "pi"},
    "P + feed-forward": {"guidance.kind": "feedforward", "controller.kind": "pd"},
    "PI + feed-forward": {"guidance.kind": "feedforward", "controller.kind": "pi"},
    "pure pursuit": {"guidance.kind": "pure_pursuit"},
    "Stanley": {"guidance.kind": "stanley"},
    "LQR": {"guidance.kind": "lqr"},
    "nmpc": {"guidance.kind": "nmpc"},
}
"""Overrides by law; all gains are tuned but those `as printed`."""
IMU = {"sensors.imu.enabled": True, "estimator.terrain_compensation": True}
SURFACES: dict[str, dict[str, Any]] = {
    "level": {},
    "soil": {"plant.tyre.kind": "soil"},
    "rough D": {"terrain": {"kind": "rough", "iso_class": "D"}},
    "side slope 10 deg": {"terrain": {"kind": "slope", "grade_deg": 10.0}},
}
"""Overrides by surface."""
ORDER = (*SURFACES, "GNSS loss of 5 s", "level, bicycle", "swaths")
"""Surfaces in the order of tables and figures."""
LOSS = {"fault": [{"kind": "gnss_loss", "start_s": 60.0, "end_s": 65.0}]}
ESTIMATORS: dict[str, dict[str, Any]] = {
    "ekf": {"estimator.kind": "ekf"},
    "ekf_full": {"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True},
}
"""Overrides by estimator."""
TURN = {"path.turns": 1, "supervisor.enabled": False}
MODERN = (NETWORK, NETWORK_TUNED, "PI", "P + feed-forward", "PI + feed-forward", "Stanley", "LQR", "nmpc")
"""Laws that are run with `ekf_full` too."""


class Cell(NamedTuple):
    """One cell of the comparison, of which each seed is a run."""

    estimator: str
    surface: str
    law: str
    scenario: str
    overrides: dict[str, Any]


def cells() -> list[Cell]:
    """All cells."""
    found = []
    for estimator, laws in (("ekf", tuple(LAWS)), ("ekf_full", MODERN)):
        for law in laws:
            keys = {**ESTIMATORS[estimator], **TURN, **LAWS[law]}
            for surface, ground in SURFACES.items():
                tilted = IMU if surface in ("rough D", "side slope 10 deg") else {}
                found.append(Cell(estimator, surface, law, "figure_eight", {**keys, **ground, **tilted}))
            found.append(Cell(estimator, "GNSS loss of 5 s", law, "figure_eight", {**keys, **LOSS}))
            found.append(Cell(estimator, "level, bicycle", law, "figure_eight", {**keys, "plant.kind": "bicycle"}))
    for law in MODERN:
        keys = {**ESTIMATORS["ekf_full"], **LAWS[law], "supervisor.enabled": False}
        found.append(Cell("ekf_full", "swaths", law, "clothoid_swaths", keys))
    return found


def perform(job: tuple[Cell, int]) -> dict[str, Any]:
    """The row of one run, of a cell and a seed."""
    cell, seed = job
    log = run(load_scenario(cell.scenario, {**cell.overrides, "seed": seed}))
    m = log.metrics
    passes = m.get("iso_12188_2_style", {})
    return {
        "estimator": cell.estimator,
        "surface": cell.surface,
        "law": cell.law,
        "seed": seed,
        "outcome": log.outcome,
        **{name: m[name] for name in ("xte_rms", "xte_abs_p95", "lateral_mse", "position_nees")},
        "steer_rate_deg_s": float(np.degrees(np.abs(np.diff(log.column("steer"))).mean() / 0.05)),
        **{f"passes_{name}": value for name, value in passes.items() if isinstance(value, int | float)},
    }


def study(file: Path, seeds: Sequence[int], jobs: int | None, done: Callable[[], None]) -> list[dict[str, Any]]:
    """All rows, of which those in `file` (JSON lines) are taken from there and the others are run and added."""
    rows = [json.loads(line) for line in file.read_text("utf-8").splitlines()] if file.exists() else []
    there = {(row["estimator"], row["surface"], row["law"], row["seed"]) for row in rows}
    todo = [
        (cell, seed)
        for seed in seeds
        for cell in cells()
        if (cell.estimator, cell.surface, cell.law, seed) not in there
    ]
    for _ in range(len(seeds) * len(cells()) - len(todo)):
        done()
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a", encoding="utf-8") as out:
        for _, row in spread(perform, todo, jobs or cores()):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
            done()
    return rows


def interval(values: Array, draws: int = 4000) -> tuple[float, float]:
    """95 % bootstrap interval of the mean of `values` (n,); the same for the same values."""
    rng = np.random.default_rng(0)
    means = values[rng.integers(0, len(values), (draws, len(values)))].mean(axis=1)
    low, high = np.percentile(means, (2.5, 97.5))
    return float(low), float(high)


def by_cell(rows: Iterable[Mapping[str, Any]], name: str) -> dict[tuple[str, str, str], dict[int, float]]:
    """Values of the metric `name` by (estimator, surface, law) and seed; a run that failed has NaN."""
    found: dict[tuple[str, str, str], dict[int, float]] = {}
    for row in rows:
        value = error_of(row, name)
        number = float("nan") if value is None else value
        found.setdefault((row["estimator"], row["surface"], row["law"]), {})[row["seed"]] = number
    return found


def paired(one: Mapping[int, float], other: Mapping[int, float]) -> tuple[float, float, float, int]:
    """Mean and 95 % interval of `one` less `other` over the seeds of both, and of how many of these a run failed."""
    seeds = sorted(one.keys() & other.keys())
    difference = np.array([one[s] - other[s] for s in seeds])
    good = difference[np.isfinite(difference)]
    failed = len(difference) - len(good)
    if not len(good):
        return np.nan, np.nan, np.nan, failed
    return (float(good.mean()), *interval(good), failed)


def table(rows: Sequence[Mapping[str, Any]], estimator: str, name: str = "xte_rms", factor: float = 100.0) -> str:
    """Markdown table of an estimator: a row per law, a column per surface, mean and interval in cm."""
    values = by_cell(rows, name)
    surfaces = [surface for surface in ORDER if any((estimator, surface, law) in values for law in LAWS)]
    laws = [law for law in LAWS if any((estimator, surface, law) in values for surface in surfaces)]
    lines = ["| law | " + " | ".join(surfaces) + " |", "|---|" + "---|" * len(surfaces)]
    for law in laws:
        texts = [_text(values.get((estimator, surface, law), {}), factor) for surface in surfaces]
        lines.append(f"| {law} | " + " | ".join(texts) + " |")
    return "\n".join(lines)


def _text(values: Mapping[int, float], factor: float) -> str:
    """`mean (low-high)`, and how many runs failed."""
    numbers = factor * np.array(list(values.values()), dtype=float)
    good = numbers[np.isfinite(numbers)]
    failed = f", {len(numbers) - len(good)} of {len(numbers)} failed" if len(good) < len(numbers) else ""
    if not len(good):
        return "-" if not len(numbers) else f"all {len(numbers)} failed"
    low, high = interval(good)
    return f"{good.mean():.1f} ({low:.1f}-{high:.1f}){failed}"
