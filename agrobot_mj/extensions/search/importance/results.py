"""Importance of the random parameters of a sweep as table, text and figure. The importance is a fraction of the
variance of a metric, computed for each group of runs with the same variant and axis values."""

import tomllib
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.palette import BLUE, LIGHT_GREY, ORANGE
from agrobot_mj.core.signals import Array
from agrobot_mj.core.version import __version__
from agrobot_mj.extensions.search.importance.shares import (
    Influence,
    Share,
    rank_shares,
    regression_shares,
    sobol_flaws,
    sobol_shares,
)
from agrobot_mj.metrics.success import has_errors, reasons
from agrobot_mj.simulation.results import check_folder, write_json
from agrobot_mj.studies.engine.tasks import WALL
from agrobot_mj.studies.results_io import code_of, reporting_damage
from agrobot_mj.studies.style import PANEL_WIDTH_IN, write_figure
from agrobot_mj.studies.sweep.plan import points_of
from agrobot_mj.studies.sweep.store import read_rows

NEGLIGIBLE = 0.05  # Fraction of the variance below which a parameter counts as negligible [-]


def importance_rows(found: Sequence[Influence]) -> tuple[list[str], list[list[str]]]:
    """Return the header and the rows of a table with rank, variance fraction and effect of each random parameter."""
    screening = found[0].unexplained is not None
    columns = ["rank", "fraction of the variance", *(["slope", "Spearman"] if screening else ["first order"])]
    names = [f"{each.group}: {name}" if len(found) > 1 else name for each in found for name in columns]
    rows = []
    for leading in found[0].shares:
        shares = [next(share for share in each.shares if share.key == leading.key) for each in found]
        cells = [cell for share, each in zip(shares, found, strict=True) for cell in _cells(share, not each.flaws)]
        rows.append([leading.key, *cells])
    return ["number", *names], rows


def _cells(share: Share, trusted: bool) -> list[str]:
    rank = share.rank if trusted else "?"
    cells = [rank, f"{share.share:.2f} ({share.low:.2f} to {share.high:.2f})", f"{share.effect:.2f} ± {share.half:.2f}"]
    return cells if share.correlation is None else [*cells, f"{share.correlation:.2f}"]


def importance_texts(found: Sequence[Influence], metric: str) -> list[str]:
    """Return sentences about the ranking of the parameters and its uncertainty, as one text for each group of runs."""
    return [_ranking_text(each, metric, f"{each.group}: " if len(found) > 1 else "") for each in found]


def _ranking_text(each: Influence, metric: str, group: str) -> str:
    noise = (
        "one seed does not identify the variation between seeds"
        if each.noise is None
        else f"variation between seeds causes {100 * each.noise:.0f} % of the variance"
    )
    lines = [f"{group}{metric} {each.mean:.4g}, standard deviation {each.deviation:.2g} over the points; {noise}."]
    if each.unexplained is not None:
        lines.append(
            f"Up to {100 * each.unexplained:.0f} % of the variance is neither linear nor noise. The upper end of each "
            "interval includes this part."
        )
    if each.flaws:
        return "\n".join([*lines, *(f"{flaw}." for flaw in each.flaws), "Therefore there is no ranking."])
    if not each.ordered_pairs:
        return "\n".join([*lines, "The samples are too few to distinguish any two numbers, so there is no ranking."])
    lines.append(
        f"{each.ordered_pairs} of {each.pairs} pairs differ significantly; numbers with overlapping ranks are tied."
    )
    if small := [share.key for share in each.shares if share.high < NEGLIGIBLE]:
        lines.append(f"Contributions below {100 * NEGLIGIBLE:.0f} %: {', '.join(small)}.")
    return "\n".join(lines)


def importance_figure(found: Sequence[Influence], metric: str) -> Figure:
    """Return a figure of variance fractions with intervals, one panel per group of runs. For Sobol indices, a second
    bar shows the first-order index."""
    keys, screening = [share.key for share in found[0].shares][::-1], found[0].unexplained is not None
    figure = Figure((2 * PANEL_WIDTH_IN, 0.22 * len(keys) + 1.0), layout="constrained")
    grid = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    lines = {"elinewidth": 0.8}
    for axes, each in zip(grid, found, strict=True):
        for share in each.shares:
            y, colour = keys.index(share.key), LIGHT_GREY if each.flaws else BLUE
            ends = [[max(0.0, share.share - share.low)], [max(0.0, share.high - share.share)]]
            axes.barh(y if screening else y + 0.18, share.share, 0.36, xerr=ends, color=colour, error_kw=lines)
            if not screening:
                axes.barh(y - 0.18, share.effect, 0.36, xerr=share.half, color=ORANGE, error_kw=lines)
        axes.set_yticks(range(len(keys)), [f"{key}  [{_rank(found[0], key)}]" for key in keys])
        axes.set(title=each.group if len(found) > 1 else "", xlabel=f"fraction of the variance of {metric} [-]")
        axes.set_xlim(min(-0.05, axes.get_xlim()[0]), max(1.05, axes.get_xlim()[1]))
        axes.axvline(0.0, color="black", linewidth=0.6)
    if not screening:
        handles = [grid[0].barh([0], [0], color=colour) for colour in (BLUE, ORANGE)]
        figure.legend(handles, ["total, with interactions", "first order"], loc="outside upper center", ncols=2)
    return figure


def _rank(first: Influence, key: str) -> str:
    return "?" if first.flaws else next(share.rank for share in first.shares if share.key == key)


DESIGNS = ("screening", "saltelli")  # Sampling methods that `importance` supports
OF_EVERY_RUN = ("expected", "progress")  # Columns for which failed runs also have values
Rows = Sequence[dict[str, Any]]


def importance(folder: Path, metric: str = "xte_rms") -> list[Influence]:
    """Compute the variance fractions of the sweep in `folder`, by group.

    Writes `importance.json` and `importance.png` to `folder`. Raises `ScenarioError` if the folder has no finished
    sweep of one of `DESIGNS`, or if some runs (for example failed runs) have no value of the metric.
    """
    with reporting_damage(folder / "sweep.parquet", "read"):
        return _influences(folder, metric)


def _influences(folder: Path, metric: str) -> list[Influence]:
    try:
        file = tomllib.loads((folder / "sweep.toml").read_text("utf-8"))
        rows: Rows = read_rows(folder)
    except OSError:
        missing = "the folder has no sweep.toml or sweep.parquet"
        raise ScenarioError(f"{folder}: {missing}; specify the results folder of a sweep") from None
    code = code_of(rows, folder)
    check_folder(folder, ("importance.json", "importance.png"))
    if file.get("method") not in DESIGNS:
        wanted = " or ".join(f'"{design}"' for design in DESIGNS)
        raise ScenarioError(f"{folder}: the design is {file.get('method')!r}; importance needs method = {wanted}")
    found = [influence(name, file, *group, metric) for name, group in _groups(folder, file, rows, metric).items()]
    about = {"metric": metric, "method": file["method"], "samples": file["samples"], "seeds": file["seeds"]}
    content = [{**each._asdict(), "shares": [share._asdict() for share in each.shares]} for each in found]
    write_json(folder / "importance.json", {**about, "version": __version__, "code": code, "groups": content})
    write_figure(folder / "importance.png", importance_figure, found, metric)
    return found


def influence(name: str, file: dict[str, Any], draws: Array, values: Array, metric: str) -> Influence:
    """Return the variance fractions of one group of runs for sampled parameters `draws` (points, d) and metric `values`
    (points, seeds). Raises `ScenarioError` for a constant metric."""
    means, keys = values.mean(axis=1), list(file["draws"])
    if np.ptp(means) == 0.0:
        raise ScenarioError(f"--metric {metric}: the metric does not vary in {name}")
    noise = noise_share(values)
    left, flaws = None, tuple[str, ...]()
    if file["method"] == "screening":
        shares, left = regression_shares(keys, draws, means, noise or 0.0)
    else:
        shares = sobol_shares(keys, means, noise or 0.0)
        flaws = sobol_flaws(shares, file["samples"])
    return Influence(name, float(means.mean()), float(means.std()), noise, left, flaws, rank_shares(shares, not flaws))


def noise_share(values: Array) -> float | None:
    """Return the fraction of the seed-averaged metric's variance that is due to seeds [-], or None with one seed."""
    points, seeds = values.shape
    if seeds < 2:
        return None
    means = values.mean(axis=1)
    rest = values - means[:, None] - values.mean(axis=0) + values.mean()
    variance = float(np.sum(rest**2)) / ((points - 1) * (seeds - 1))
    return min(1.0, variance / seeds / float(means.var(ddof=1)))


def _groups(folder: Path, file: dict[str, Any], rows: Rows, metric: str) -> dict[str, tuple[Array, Array]]:
    """Return the sampled parameters (points, d) and the metric (points, seeds) of each group of runs. Raises
    `ScenarioError` for missing values."""
    sizes = [max(len(file.get("variant", ())), 1), *(len(values) for values in file.get("axes", {}).values())]
    points, seeds = points_of(file["method"], file["samples"], len(file["draws"])), len(file["seeds"])
    total = prod(sizes) * points * seeds
    if len(rows) < total:
        raise ScenarioError(f"{folder}: {total - len(rows):,} of {total:,} runs are missing; complete the sweep")
    _check_metric(metric, rows)
    values = [row[metric] for row in rows]
    if lacking := sum(not isinstance(value, int | float) or not np.isfinite(value) for value in values):
        raise ScenarioError(
            f"--metric {metric}: {lacking:,} of {total:,} runs have no value; "
            "narrow the ranges of the random parameters"
        )
    table = np.array(values, dtype=float).reshape(-1, points, seeds)
    firsts = [rows[k * points * seeds : (k + 1) * points * seeds : seeds] for k in range(len(table))]
    numeric = file["method"] == "screening"  # a screening has numeric draws only
    draws = [
        np.array([[row[key] if numeric else 0.0 for key in file["draws"]] for row in some], dtype=float)
        for some in firsts
    ]
    return {_name(some[0], file): (x, y) for some, x, y in zip(firsts, draws, table, strict=True)}


def _check_metric(metric: str, rows: Rows) -> None:
    names = list(rows[0])
    known = [name for name in names[names.index("outcome") + 1 :] if name not in ("error", *WALL, "version")]
    if metric not in known or metric not in names:
        what = "is not a result of a run" if metric in names else "no such column"
        raise ScenarioError(f"--metric {metric}: {what}{suggestion(metric, known)}")
    without = [row for row in rows if not has_errors(row)]
    if without and metric not in OF_EVERY_RUN:
        raise ScenarioError(
            f"--metric {metric}: {len(without):,} of {len(rows):,} runs have no value ({reasons(without)}), and the "
            "design needs a value for every point; narrow the ranges of the random parameters, or use --metric "
            "expected, the fraction of successes"
        )


def _name(row: dict[str, Any], file: dict[str, Any]) -> str:
    parts = [row["variant"]] if file.get("variant") else []
    return ", ".join([*parts, *(str(row[key]) for key in file.get("axes", {}))]) or "all runs"
