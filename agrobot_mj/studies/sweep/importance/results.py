"""Importance of the draws of a finished sweep: rows in, shares of the variance by group out.

Each point of the design is averaged over its seeds. As every point has the same seeds, what is left of them is the
residual of an analysis of variance in two ways (points and seeds), whose share is told.
"""

import tomllib
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.signals import Array
from agrobot_mj.core.version import __version__
from agrobot_mj.metrics.success import has_errors, reasons
from agrobot_mj.simulation.ownership import check_output
from agrobot_mj.simulation.storage import write_json
from agrobot_mj.studies.engine.tasks import WALL
from agrobot_mj.studies.results_io import reporting_damage
from agrobot_mj.studies.style import STYLE, save
from agrobot_mj.studies.sweep.importance.screening import screened
from agrobot_mj.studies.sweep.importance.shares import Influence, ranked
from agrobot_mj.studies.sweep.importance.sobol import sobol_flaws, sobol_shares
from agrobot_mj.studies.sweep.importance.text import importance_figure
from agrobot_mj.studies.sweep.plan import points_of
from agrobot_mj.studies.sweep.store import read_rows

DESIGNS = ("screening", "saltelli")
"""Sampling methods for which importance can be computed."""
OF_EVERY_RUN = ("expected", "progress")
"""Columns that are valid for failed runs, too."""
Rows = Sequence[dict[str, Any]]


def importance(folder: Path, metric: str = "xte_rms") -> list[Influence]:
    """The shares of a sweep's folder by group; writes `importance.json` and `importance.png` there.

    Raises `ScenarioError` where the folder has no finished sweep of one of `DESIGNS`, or the metric no value in some
    runs: that of a run that failed does not count.
    """
    with reporting_damage(folder / "sweep.parquet", "read"):
        return _found(folder, metric)


def _found(folder: Path, metric: str) -> list[Influence]:
    try:
        file = tomllib.loads((folder / "sweep.toml").read_text("utf-8"))
        rows: Rows = read_rows(folder)
    except OSError:
        raise ScenarioError(f"{folder}: has no results of a sweep (sweep.toml, sweep.parquet)") from None
    check_output(folder, ("importance.json", "importance.png"))
    if file.get("method") not in DESIGNS:
        wanted = " or ".join(f'"{design}"' for design in DESIGNS)
        raise ScenarioError(f"{folder}: the design is {file.get('method')!r}; importance needs method = {wanted}")
    found = [influence(name, file, *group, metric) for name, group in _groups(folder, file, rows, metric).items()]
    about = {"metric": metric, "method": file["method"], "samples": file["samples"], "seeds": file["seeds"]}
    content = [{**each._asdict(), "shares": [share._asdict() for share in each.shares]} for each in found]
    write_json(folder / "importance.json", {**about, "version": __version__, "groups": content})
    with mpl.rc_context(STYLE):
        save(importance_figure(found, metric), folder / "importance.png")
    return found


def influence(name: str, file: dict[str, Any], draws: Array, values: Array, metric: str) -> Influence:
    """The shares of one group; draws (points, d), values (points, seeds). Raises `ScenarioError`."""
    means, keys = values.mean(axis=1), list(file["draws"])
    if np.ptp(means) == 0.0:
        raise ScenarioError(f"--metric {metric}: does not vary in {name}")
    noise = noise_share(values)
    left, flaws = None, tuple[str, ...]()
    if file["method"] == "screening":
        shares, left = screened(keys, draws, means, noise or 0.0)
    else:
        shares = sobol_shares(keys, means, noise or 0.0)
        flaws = sobol_flaws(shares, file["samples"])
    return Influence(name, float(means.mean()), float(means.std()), noise, left, flaws, ranked(shares, not flaws))


def noise_share(values: Array) -> float | None:
    """Share of the variance of the points' means that is the seeds', values (points, seeds); None with one seed."""
    points, seeds = values.shape
    if seeds < 2:
        return None
    means = values.mean(axis=1)
    rest = values - means[:, None] - values.mean(axis=0) + values.mean()
    variance = float(np.sum(rest**2)) / ((points - 1) * (seeds - 1))
    return min(1.0, variance / seeds / float(means.var(ddof=1)))


def _groups(folder: Path, file: dict[str, Any], rows: Rows, metric: str) -> dict[str, tuple[Array, Array]]:
    """Draws (points, d) and metric (points, seeds) by group, in the order of the design. Raises `ScenarioError`."""
    sizes = [max(len(file.get("variant", ())), 1), *(len(values) for values in file.get("axes", {}).values())]
    points, seeds = points_of(file["method"], file["samples"], len(file["draws"])), len(file["seeds"])
    total = prod(sizes) * points * seeds
    if len(rows) < total:
        raise ScenarioError(f"{folder}: {total - len(rows):,} of {total:,} runs are missing; run the sweep to its end")
    _check_metric(metric, rows)
    values = [row[metric] for row in rows]
    if lacking := sum(not isinstance(value, int | float) or not np.isfinite(value) for value in values):
        raise ScenarioError(f"--metric {metric}: has no number in {lacking:,} of {total:,} runs; narrow the draws")
    table = np.array(values, dtype=float).reshape(-1, points, seeds)
    firsts = [rows[k * points * seeds : (k + 1) * points * seeds : seeds] for k in range(len(table))]
    numeric = file["method"] == "screening"  # whose plan has been checked for words
    draws = [
        np.array([[row[key] if numeric else 0.0 for key in file["draws"]] for row in some], dtype=float)
        for some in firsts
    ]
    return {_name(some[0], file): (x, y) for some, x, y in zip(firsts, draws, table, strict=True)}


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
