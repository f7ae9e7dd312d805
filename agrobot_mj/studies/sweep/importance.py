"""Which uncertain number matters? Sobol indices [Saltelli2010] of a sweep of `method = "saltelli"`.

The first-order index of a draw is the share of a metric's variance that goes away once its value is known; the total
index is the share that stays while only it is unknown, interactions included. The sum of first-order indices is at most
1, and a total index near 0 means that the number may stay an estimate. Intervals are 95 %, by bootstrap.
"""

import json
import tomllib
from collections.abc import Callable, Sequence
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.palette import BLUE, ORANGE
from agrobot_mj.core.signals import Array
from agrobot_mj.core.version import __version__
from agrobot_mj.metrics.success import has_errors, reasons
from agrobot_mj.simulation.ownership import check_output
from agrobot_mj.simulation.storage import write_json
from agrobot_mj.studies.damage import intact
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save
from agrobot_mj.studies.sweep.store import read_rows
from agrobot_mj.studies.sweep.work import WALL

OF_EVERY_RUN = ("expected", "progress")
"""Columns that mean the same for runs that failed."""
RESAMPLES = 1000
"""Resamples of the bootstrap [-]."""
Rows = Sequence[dict[str, Any]]


class SobolIndex(NamedTuple):
    """Indices of one draw, with half the width of their 95 % intervals."""

    key: str
    first: float
    first_half: float
    total: float
    total_half: float


class Influence(NamedTuple):
    """The indices of all draws in one group: a variant and a value of each axis."""

    group: str
    mean: float
    """Mean of the metric."""
    deviation: float
    """Its standard deviation over the design."""
    indices: tuple[SobolIndex, ...]
    """Draws by falling total index."""


def importance(folder: Path, metric: str = "xte_rms") -> list[Influence]:
    """The indices of a sweep's folder; writes `importance.json` and `importance.png` there.

    A metric is averaged over the seeds first. Raises `ScenarioError` where the folder has no finished sweep of
    `method = "saltelli"`, or the metric no value in some runs: that of a run that failed does not count.
    """
    analyze = _analyzer()
    with intact(folder / "sweep.parquet", "read"):
        return _found(folder, metric, analyze)


def _found(folder: Path, metric: str, analyze: Callable[[list[str], Array], Array]) -> list[Influence]:
    try:
        file = tomllib.loads((folder / "sweep.toml").read_text("utf-8"))
        rows: Rows = read_rows(folder)
    except OSError:
        raise ScenarioError(f"{folder}: has no results of a sweep (sweep.toml, sweep.parquet)") from None
    check_output(folder, ("importance.json", "importance.png"))
    if file.get("method") != "saltelli":
        raise ScenarioError(f'{folder}: the design is {file.get("method")!r}; importance needs method = "saltelli"')
    found = []
    for group, values in _groups(folder, file, rows, metric).items():
        result = analyze(list(file["draws"]), values)
        indices = [SobolIndex(key, *numbers) for key, numbers in zip(file["draws"], result, strict=True)]
        ordered = tuple(sorted(indices, key=lambda index: -index.total))
        found.append(Influence(group, float(values.mean()), float(values.std()), ordered))
    content = [{**each._asdict(), "indices": [index._asdict() for index in each.indices]} for each in found]
    about = {"metric": metric, "samples": file["samples"], "seeds": file["seeds"], "version": __version__}
    write_json(folder / "importance.json", {**about, "groups": content})
    with mpl.rc_context(STYLE):
        save(importance_figure(found, metric), folder / "importance.png")
    return found


def _analyzer() -> Any:
    """A function (names, values) -> for each name first index, its half interval, total index, its half interval."""
    try:
        from SALib.analyze import sobol
    except ImportError:
        raise ScenarioError("importance: needs SALib; install it with: pip install 'agrobot-mj[studies]'") from None

    def analyze(names: list[str], values: Array) -> Array:
        problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
        found = sobol.analyze(problem, values, calc_second_order=False, num_resamples=RESAMPLES, seed=1)
        return np.column_stack([found[name] for name in ("S1", "S1_conf", "ST", "ST_conf")])

    return analyze


def _groups(folder: Path, file: dict[str, Any], rows: Rows, metric: str) -> dict[str, Array]:
    """The metric by group, in the order of the design, averaged over the seeds. Raises `ScenarioError`."""
    sizes = [max(len(file.get("variant", ())), 1), *(len(values) for values in file.get("axes", {}).values())]
    points, seeds = file["samples"] * (len(file["draws"]) + 2), len(file["seeds"])
    total = prod(sizes) * points * seeds
    if len(rows) < total:
        raise ScenarioError(f"{folder}: {total - len(rows):,} of {total:,} runs are missing; run the sweep to its end")
    _check_metric(metric, rows)
    values = [row[metric] for row in rows]
    if lacking := sum(not isinstance(value, int | float) or not np.isfinite(value) for value in values):
        raise ScenarioError(f"--metric {metric}: has no number in {lacking:,} of {total:,} runs; narrow the draws")
    table = np.array(values, dtype=float).reshape(-1, points, seeds).mean(axis=2)
    names = [_name(rows[k * points * seeds], file) for k in range(len(table))]
    if flat := next((name for name, each in zip(names, table, strict=True) if np.ptp(each) == 0.0), None):
        raise ScenarioError(f"--metric {metric}: does not vary in {flat}")
    return dict(zip(names, table, strict=True))


def _check_metric(metric: str, rows: Rows) -> None:
    """Raises `ScenarioError` unless the column is a result that all runs have, failed ones too if there are any."""
    names = list(rows[0])
    known = [name for name in names[names.index("outcome") + 1 :] if name not in ("error", *WALL, "version")]
    if metric not in known or metric not in names:
        what = "is no result of a run" if metric in names else "no such column"
        raise ScenarioError(f"--metric {metric}: {what}{suggestion(metric, known)}")
    without = [row for row in rows if not has_errors(row)]
    if without and metric not in OF_EVERY_RUN:
        raise ScenarioError(
            f"--metric {metric}: {len(without):,} of {len(rows):,} runs have none ({reasons(without)}), and the design "
            "can spare no point; narrow the draws, or ask for --metric expected, the share of successes"
        )


def _name(row: dict[str, Any], file: dict[str, Any]) -> str:
    """Name of the group of a row."""
    parts = [row["variant"]] if file.get("variant") else []
    return ", ".join([*parts, *(str(row[key]) for key in file.get("axes", {}))]) or "all runs"


def importance_figure(found: Sequence[Influence], metric: str) -> Figure:
    """Total and first-order indices with their intervals, a panel per group; draws in the order of the first."""
    keys = [index.key for index in found[0].indices][::-1]
    figure = Figure((2 * PANEL_WIDTH_IN, 0.22 * len(keys) + 1.0), layout="constrained")
    grid = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for axes, each in zip(grid, found, strict=True):
        for index in each.indices:
            y = keys.index(index.key)
            axes.barh(y + 0.18, index.total, 0.36, xerr=index.total_half, color=BLUE, error_kw={"elinewidth": 0.8})
            axes.barh(y - 0.18, index.first, 0.36, xerr=index.first_half, color=ORANGE, error_kw={"elinewidth": 0.8})
        axes.set_yticks(range(len(keys)), keys)
        axes.set(title=each.group if len(found) > 1 else "", xlabel=f"share of the variance of {metric} [-]")
        axes.set_xlim(min(-0.05, axes.get_xlim()[0]), max(1.05, axes.get_xlim()[1]))
        axes.axvline(0.0, color="black", linewidth=0.6)
    handles = [grid[0].barh([0], [0], color=colour) for colour in (BLUE, ORANGE)]
    figure.legend(handles, ["total, with interactions", "first order"], loc="outside upper center", ncols=2)
    return figure


def importance_table(found: Sequence[Influence]) -> str:
    """Markdown table: a row per draw, total and first-order index of each group."""
    groups = [f"{each.group}: " if len(found) > 1 else "" for each in found]
    names = [group + index for group in groups for index in ("total", "first order")]
    lines = ["| number | " + " | ".join(names) + " |", "|---|" + "---:|" * len(names)]
    for leading in found[0].indices:
        cells = []
        for each in found:
            i = next(index for index in each.indices if index.key == leading.key)
            cells += [f"{i.total:.2f} ± {i.total_half:.2f}", f"{i.first:.2f} ± {i.first_half:.2f}"]
        lines.append(f"| `{leading.key}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def read_importance(folder: Path) -> list[Influence]:
    """What `importance` has written."""
    content = json.loads((folder / "importance.json").read_text("utf-8"))
    return [
        Influence(**{**group, "indices": tuple(SobolIndex(**index) for index in group["indices"])})
        for group in content["groups"]
    ]
