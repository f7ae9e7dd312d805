"""Report page of a sweep.

The page contains a ranking of groups of runs, error curves over one parameter, and error maps over two parameters with
the boundary of failure. The page lists the worst runs and gives the command that repeats each run. Runs of a group have
the same variant and the same non-numeric parameters. A run fails if it does not end as expected.
"""

import json
import shlex
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from agrobot_mj.metrics.success import error_of, is_success
from agrobot_mj.scenario.plugins import plugin_options
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.pages.document import COLOURS, Chart, Document, error_bars, layout
from agrobot_mj.studies.pages.drive import Signals, enlargement, magnification_text, read_signals, thumbnail
from agrobot_mj.studies.pages.ranking import (
    CENTIMETRES,
    LABEL,
    METRIC,
    Group,
    Row,
    add_ranking,
    centimetres,
    rank_groups,
)
from agrobot_mj.studies.pieces import pieces
from agrobot_mj.studies.results_io import code_of
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep, rename_files
from agrobot_mj.studies.sweep.store import read_rows

SUCCESS = 0.8  # Success rate at the drawn boundary of failure in maps [-]
APART = "The runs cover different segments of the path, so their errors are not comparable. "
APART += "Without duration_s every run ends at the end of its path."
MOST_VALUES = 40  # Maximum number of different values of a parameter that is shown on an axis of a map
CLASS = 5  # Minimum number of runs in a class of parameter values, for a reliable median. Assumed value.
MOST_MAPS, MOST_CURVES, WORST = 12, 8, 6  # Maximum number of maps, of curves and of listed worst runs
MOST_PIECES = 50
MOST_RUNS_DRAWN = 4000


def sweep_page(folder: Path) -> Document:
    """Return the report page of a sweep's results folder."""
    rows = read_rows(folder)
    again = RerunCommand(folder)
    sweep, (groups, numeric) = again.plan.sweep, group_runs(rows)
    seeds, versions = sorted({row["seed"] for row in rows}), sorted({row["version"] for row in rows})
    about = [
        f"{len(rows):,} runs",
        f"base {sweep.base.name}",
        f"agrobot_mj {', '.join(versions)}",
        code_of(rows, folder),
    ]
    about.append(f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seed {seeds[0]}")
    page = Document(sweep.file.title or f"Sweep: {folder.name}", about)
    covered = APART if _pieces(rows, again) > 1 else ""
    add_ranking(page, groups, "Ranking", covered, COLOURS)
    _add_maps(page, groups, numeric, again)
    _add_curves(page, groups, numeric, again)
    _add_worst(page, rows, again)
    page.section("The sweep")
    page.code("sweep.toml, resolved", (folder / "sweep.toml").read_text("utf-8"))
    page.code("base.toml, the base scenario", (folder / "base.toml").read_text("utf-8"))
    return page


def group_runs(rows: Sequence[Row]) -> tuple[list[Group], list[str]]:
    """Return the groups of runs, best group first, and the names of the numeric parameters."""
    names = list(rows[0])  # parameter columns are between seed and outcome
    varied = [name for name in names[names.index("seed") + 1 : names.index("outcome")] if _differs(rows, name)]
    numeric = [name for name in varied if all(type(row[name]) in (int, float) for row in rows)]
    words = [name for name in varied if name not in numeric]
    found: dict[str, list[Row]] = {}
    for row in rows:
        parts = [row["variant"]] if row.get("variant") else []
        found.setdefault(", ".join([*parts, *(str(row[word]) for word in words)]) or "all runs", []).append(row)
    return rank_groups(Group(name, members) for name, members in found.items()), numeric


def _differs(rows: Sequence[Row], name: str) -> bool:
    return len({str(row[name]) for row in rows}) > 1


class RerunCommand:
    """Callable object that returns the command for repeating the run of a row in the results table."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.plan = folder, SweepPlan(read_sweep(folder / "sweep.toml"))

    def overrides(self, row: Row) -> dict[str, Any]:
        """Return the overrides of the base scenario for the run in a table row; data files have names instead of
        paths."""
        overrides = self.plan.run(row["run"]).overrides
        return {key: rename_files(key, value, self.plan.file_names) for key, value in overrides.items()}

    def __call__(self, row: Row) -> str:
        """Return the command that repeats the run in a table row and records it."""
        sets = [f"--set {shlex.quote(f'{key}={toml_value(value)}')}" for key, value in self.overrides(row).items()]
        base, plugins = shlex.quote(str(self.folder / "base.toml")), plugin_options()
        parts = ("agrobot-mj run", base, *([plugins] if plugins else []), *sets, f"--out run-{row['run']}")
        return " ".join(parts)

    def scenario(self, row: Row) -> Scenario:
        """Return the scenario of the run in the table row `row`."""
        return self.plan.sweep.base.changed(self.plan.run(row["run"]).overrides)

    def signals(self, row: Row) -> Signals:
        """Return the signals of the run in the table row `row`. If no signals are stored, the run is repeated."""
        kept = self.folder / "runs" / f"{row['run']:08}"
        if (kept / "signals.parquet").exists():
            return read_signals(kept)
        log = run(self.scenario(row))
        return {name: log.column(name) for name in ("x", "y", "x_ref", "y_ref")}


def toml_value(value: Any) -> str:
    """Return a value as TOML text on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def _pieces(rows: Sequence[Row], again: RerunCommand) -> int:
    """Return the number of different path segments in a sweep, determined from a sample of its runs."""
    if not any(key.startswith("path") or key == "duration_s" for key in again.plan.varied):
        return 1
    return max(pieces(map(again.scenario, rows[:: max(1, len(rows) // MOST_PIECES)])))


def _add_maps(page: Document, groups: Sequence[Group], numeric: Sequence[str], again: RerunCommand) -> None:
    rows = [row for group in groups for row in group.rows]
    axes = [p for p in numeric if len({row[p] for row in rows}) <= MOST_VALUES]
    values = centimetres(rows)
    scale = (float(values.min()), float(np.percentile(values, 98))) if len(values) else (0.0, 1.0)
    charts = [
        (f"{group.name}" if len(axes) == 2 else f"{group.name}: {x}, {y}", heat_map(group, x, y, scale, again))
        for x, y in combinations(axes, 2)
        for group in groups
        if _fills(group.rows, x, y)
    ]
    if charts:
        text = f"Median {LABEL} of the successful runs; blank cells have none. Crosses mark failed runs."
        text += f" Black line: the boundary at which {100 * SUCCESS:.0f} % of runs succeed."
        page.section("Maps", text + " Click to show the command of a run.")
        page.grid(charts[:MOST_MAPS])


def _fills(rows: Sequence[Row], x: str, y: str) -> bool:
    pairs = {(row[x], row[y]) for row in rows}
    counts = [len({pair[k] for pair in pairs}) for k in (0, 1)]
    return min(counts) > 1 and len(pairs) == counts[0] * counts[1]


def heat_map(group: Group, x: str, y: str, scale: tuple[float, float], again: RerunCommand) -> Chart:
    """Return a map of the median error versus parameters `x` and `y`, with the failure boundary.

    `scale` is the error range of the colours [cm].
    """
    xs, ys = (sorted({row[p] for row in group.rows}) for p in (x, y))
    cells: dict[tuple[Any, Any], list[Row]] = {}
    for row in group.rows:
        cells.setdefault((row[x], row[y]), []).append(row)
    medians = [[float(np.median(v)) if len(v := centimetres(cells[a, b])) else None for a in xs] for b in ys]
    rates = [[sum(map(is_success, cells[a, b])) / len(cells[a, b]) for a in xs] for b in ys]
    worst = [[again(max(cells[a, b], key=_badness)) for a in xs] for b in ys]
    bar = {"title": {"text": "cm"}, "thickness": 12}
    data: list[Chart] = [
        {"type": "heatmap", "x": xs, "y": ys, "z": medians, "customdata": worst,
         "colorscale": "Viridis", "zmin": scale[0], "zmax": scale[1], "colorbar": bar,
         "hovertemplate": f"{x} %{{x}}<br>{y} %{{y}}<br>%{{z:.3g}} cm<extra></extra>"}
    ]  # fmt: skip
    failed = [(a, b) for i, b in enumerate(ys) for j, a in enumerate(xs) if rates[i][j] < 1]
    if failed:
        contour = {"start": SUCCESS, "end": SUCCESS, "size": 1, "coloring": "none"}
        boundary = {"type": "contour", "x": xs, "y": ys, "z": rates, "contours": contour, "showscale": False}
        data.append({**boundary, "line": {"color": "black", "width": 3}, "hoverinfo": "skip", "showlegend": False})
        cross = {"symbol": "x", "color": COLOURS[1], "size": 8}
        marks = {"type": "scatter", "mode": "markers", "x": [a for a, _ in failed], "y": [b for _, b in failed]}
        data.append({**marks, "marker": cross, "hoverinfo": "skip", "showlegend": False})
    return {"data": data, "layout": layout(x, y)}


def _badness(row: Row) -> tuple[bool, float]:
    value = error_of(row, METRIC)
    return not is_success(row), np.inf if value is None else value


def _add_curves(page: Document, groups: Sequence[Group], numeric: Sequence[str], again: RerunCommand) -> None:
    if not numeric:
        return
    text = "Lines: median of the successful runs, bars from 10 to 90 %. Points: runs. Crosses: failed runs."
    page.section("Effect of one parameter", text + " Click a point to show its command.")
    drawn = again.plan.file.draws
    page.grid([(p, curves(groups, p, again, p in drawn)) for p in numeric[:MOST_CURVES]])


def curves(groups: Sequence[Group], parameter: str, again: RerunCommand, drawn: bool = False) -> Chart:
    """Return a chart of the error versus one parameter, with points and a median curve for each group of runs."""
    data: list[Chart] = []
    share = max(1, sum(len(g.rows) for g in groups) // MOST_RUNS_DRAWN)
    top = max((float(g.values.max()) for g in groups if len(g.values)), default=1.0)
    for k, group in enumerate(groups):
        colour = COLOURS[k % len(COLOURS)]
        rows = [row for row in _extremes(group.rows, share) if error_of(row, METRIC) is not None or not is_success(row)]
        errors = [error_of(row, METRIC) for row in rows]
        heights = [1.1 * top if error is None else CENTIMETRES * error for error in errors]
        symbols = ["circle" if is_success(row) else "x" for row in rows]
        data.append(
            {"type": "scatter", "mode": "markers", "x": [r[parameter] for r in rows], "y": heights, "name": group.name,
             "legendgroup": group.name, "customdata": [again(r) for r in rows], "showlegend": False,
             "marker": {"color": colour, "size": 5, "opacity": 0.5, "symbol": symbols},
             "hovertemplate": f"{parameter} %{{x}}<br>%{{y:.3g}} cm<extra>%{{fullData.name}}</extra>"}
        )  # fmt: skip
        if len(group.values):
            data.append(median_curve(group, parameter, colour, drawn))
    return {"data": data, "layout": layout(parameter, LABEL)}


def _extremes(rows: Sequence[Row], share: int) -> list[Row]:
    """Return the best and the worst row of each block of 2 * `share` rows, so that one in `share` rows remains."""
    if share == 1:
        return list(rows)
    stretches = (rows[first : first + 2 * share] for first in range(0, len(rows), 2 * share))
    return [end(stretch, key=_badness) for stretch in stretches for end in (min, max)]


def median_curve(group: Group, parameter: str, colour: str, drawn: bool = False) -> Chart:
    """Return a curve of the median error versus a parameter, with bars from the 10 % to the 90 % quantile.

    Values of a random parameter (`drawn`) are combined in up to six classes of equal size.
    """
    rows = sorted((r for r in group.rows if error_of(r, METRIC) is not None), key=lambda r: r[parameter])
    values = len({row[parameter] for row in rows})
    if values <= MOST_VALUES / 2 and not (drawn and 2 * values > len(rows)):
        classes = [[r for r in rows if r[parameter] == value] for value in dict.fromkeys(r[parameter] for r in rows)]
    else:
        count = max(1, min(6, len(rows) // CLASS))
        classes = [list(part) for part in np.array_split(np.array(rows, dtype=object), count)]
    places = [float(np.mean([r[parameter] for r in part])) for part in classes]
    found = [np.percentile(centimetres(part), (10, 50, 90)).tolist() for part in classes]
    middle, bars = (
        [m for _, m, _ in found],
        error_bars([m for _, m, _ in found], [(low, high) for low, _, high in found]),
    )
    curve = {"type": "scatter", "mode": "lines+markers", "x": places, "y": middle, "error_y": bars}
    return {**curve, "name": group.name, "legendgroup": group.name, "line": {"color": colour}, "hoverinfo": "skip"}


def _add_worst(page: Document, rows: Sequence[Row], again: RerunCommand) -> None:
    cards = []
    for row in sorted((row for row in rows if row["error"] is None), key=_badness, reverse=True)[:WORST]:
        value = error_of(row, METRIC)
        title = f"run {row['run']}: {row['outcome']}" + ("" if value is None else f", {CENTIMETRES * value:.3g} cm")
        signals = again.signals(row)
        times = enlargement([signals])
        cards.append((title + magnification_text(times), thumbnail(signals, times), again(row)))
    if cards:
        page.section("The worst runs", "Thin: path; coloured: track of the tractor.")
        page.thumbnails(cards)
