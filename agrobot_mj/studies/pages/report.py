"""`report.html` for a folder of results, and figures as files for print; pages of a validation and of limits."""

import json
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.metrics.success import error_of
from agrobot_mj.scenario.plugins import with_plugin_options
from agrobot_mj.simulation.results import check_folder
from agrobot_mj.studies.pages.document import CATEGORIES, COLOURS, INK, SHADE, Chart, Document, error_bars, layout
from agrobot_mj.studies.pages.drive import comparison_page, run_page
from agrobot_mj.studies.pages.sweep import CONFIDENCE, LABEL, METRIC, Group, grouped, median_curve, sweep_page
from agrobot_mj.studies.results_io import code_of, reporting_damage
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import read_rows


def validation_page(folder: Path) -> Document:
    """The page of a validation: how far each number is within its band, and all numbers."""
    checks = json.loads((folder / "validation.json").read_text("utf-8"))
    judged = [check for check in checks if check["band"] != "reported"]
    failed = [check for check in judged if not check["passed"]]
    fact = f"{len(judged) - len(failed)} of {len(judged)} judged numbers are inside their bands"
    page = Document("Validation against theory", [fact, f"{len(checks) - len(judged)} more are reported"])
    page.section("Where numbers lie in their bands", "0 is the middle of a band with two ends, -1 and 1 are its ends.")
    page.grid([("All judged numbers", _bands(judged))])
    for manoeuvre in dict.fromkeys(check["manoeuvre"] for check in checks):
        page.section(manoeuvre.capitalize())
        head = ("quantity", "subject", "measured", "theory", "unit", "band", "")
        page.table(head, [_check(check) for check in checks if check["manoeuvre"] == manoeuvre])
    return page


def _bands(judged: list[dict[str, Any]]) -> Chart:
    """Place of each number within its band, a row per manoeuvre."""
    data = []
    for k, subject in enumerate(dict.fromkeys(check["subject"] for check in judged)):
        points = [(c, place) for c in judged if c["subject"] == subject and (place := _place(c)) is not None]
        data.append(
            {"type": "scatter", "mode": "markers", "name": subject, "x": [place for _, place in points],
             "y": [c["manoeuvre"] for c, _ in points], "text": [c["quantity"] for c, _ in points],
             "hovertemplate": "%{text}<extra>%{fullData.name}</extra>",
             "marker": {"color": COLOURS[k % len(COLOURS)], "size": 8, "opacity": 0.7}}
        )  # fmt: skip
    ends = {"type": "line", "y0": 0, "y1": 1, "yref": "paper", "line": {"dash": "dot", "color": INK}}
    shapes = [{**ends, "x0": x, "x1": x} for x in (-1, 1)]
    data = [trace for trace in data if trace["x"]]
    return {"data": data, "layout": layout("place in the band [-]", "", shapes=shapes, yaxis=CATEGORIES)}


def _place(check: dict[str, Any]) -> float | None:
    low, high, measured = check["low"], check["high"], check["measured"]
    if low is None or high is None or measured is None or high <= low:
        return None
    return float((2 * measured - low - high) / (high - low))


def _check(check: dict[str, Any]) -> tuple[object, ...]:
    verdict = "" if check["band"] == "reported" else "inside" if check["passed"] else "OUTSIDE"
    return (*(check[k] for k in ("quantity", "subject", "measured", "theory", "unit", "band")), verdict)


def limit_page(folder: Path) -> Document:
    """The page of a search for limits."""
    found = json.loads((folder / "limit.json").read_text("utf-8"))
    facts = [f"scenario {found['scenario']}", f"a run fails when {found['until']}", f"agrobot_mj {found['version']}"]
    facts.append(code_of([found], folder))
    page = Document(f"Limits along {found['key']}", facts)
    page.section("Answer")
    for law in found["laws"]:
        page.text(law["statement"])
    page.section("Success", f"Bars: {100 * found['confidence']:g} % interval. Grey: interval of the limit.")
    page.grid([(law["law"], _success(law, found)) for law in found["laws"]])
    page.section("Every value tried")
    head = ("law", found["key"], "runs", "failed", "outcomes")
    rows = [
        (law["law"], f"{t['value']:g}", t["runs"], t["failed"], _counts(t["outcomes"]))
        for law in found["laws"]
        for t in law["tried"]
    ]
    page.table(head, rows)
    return page


def _counts(outcomes: dict[str, int]) -> str:
    return ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())


def _success(law: dict[str, Any], found: dict[str, Any]) -> Chart:
    """Success rate over the key."""
    tried = law["tried"]
    rates = [100 * (1 - t["failed"] / t["runs"]) for t in tried]
    bars = error_bars(rates, [(100 * t["low"], 100 * t["high"]) for t in tried])
    curve = {"type": "scatter", "mode": "lines+markers", "x": [t["value"] for t in tried], "y": rates, "error_y": bars}
    shapes: list[dict[str, Any]] = []
    if law["interval"]:
        low, high = law["interval"]
        shapes = [{"type": "rect", "x0": low, "x1": high, "y0": 0, "y1": 1, "yref": "paper", "fillcolor": SHADE}]
        shapes[0] |= {"layer": "below", "line": {"width": 0}}
    own = layout(found["key"], "successful runs [%]", shapes=shapes, yaxis={"range": [-5, 105]})
    return {"data": [{**curve, "line": {"color": COLOURS[0]}}], "layout": own}


def sweep_figures(folder: Path) -> list[Path]:
    """Draw `ranking.png`, and `curves.png` if a parameter is a number."""
    groups, numeric = grouped(read_rows(folder))
    drawn = read_sweep(folder / "sweep.toml").file.draws
    with mpl.rc_context(STYLE):
        saved = [save(ranking(groups), folder / "ranking.png")]
        return [*saved, save(over_parameters(groups, numeric, drawn), folder / "curves.png")] if numeric else saved


def ranking(groups: list[Group]) -> Figure:
    """Success rate with its interval, and the error of successful runs, the best group on top."""
    figure = Figure((2 * PANEL_WIDTH_IN, 0.28 * len(groups) + 0.9), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    places = list(range(len(groups)))
    for k, group in enumerate(groups):
        low, high = group.interval
        ends = [[100 * max(group.rate - low, 0.0)], [100 * max(high - group.rate, 0.0)]]
        left.errorbar([100 * group.rate], [k], xerr=ends, color=COLOURS[0], marker="o", markersize=4, capsize=2)
    if shown := {k: group.values for k, group in enumerate(groups) if len(group.values)}:
        right.boxplot(list(shown.values()), positions=list(shown), orientation="horizontal", sym=".")
    left.set_yticks(places, [group.name for group in groups])
    left.set(xlabel=f"successful runs, {CONFIDENCE:.0%} interval [%]", xlim=(-3, 103), ylim=(len(groups) - 0.5, -0.5))
    right.set_xlabel(LABEL)
    return figure


def over_parameters(groups: list[Group], numeric: list[str], drawn: Collection[str] = ()) -> Figure:
    """Error of the successful runs and its median over each parameter that is a number; some are `drawn`."""
    columns = min(len(numeric), 2)
    rows = -(-len(numeric) // columns)
    figure = Figure((columns * PANEL_WIDTH_IN, 2.3 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, parameter in zip(grid, numeric, strict=False):
        for k, group in enumerate(groups):
            good = [row for row in group.rows if error_of(row, METRIC) is not None]
            x, colour = [row[parameter] for row in good], COLOURS[k % len(COLOURS)]
            axes.plot(x, group.values, ".", color=colour, markersize=3, label=group.name)
            if good:
                curve = median_curve(group, parameter, colour, parameter in drawn)
                axes.plot(curve["x"], curve["y"], color=colour, linewidth=1)
        axes.set(xlabel=parameter, ylabel=LABEL)
    for axes in grid[len(numeric) :]:
        axes.remove()
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(groups), 2 * columns))
    return figure


PAGES: dict[str, Callable[[Path], Document]] = {
    "comparison.json": comparison_page,
    "sweep.parquet": sweep_page,
    "limit.json": limit_page,
    "validation.json": validation_page,
    "signals.parquet": run_page,
}
"""Function that makes the page, by the file that identifies a folder's content."""

FILES = ("report.html", "ranking.png", "curves.png")
"""Files of a report."""
OTHERS = {name: (f"{name}.json", f"{name}.png") for name in ("risk", "falsify")} | {"tune": ("tuning.json",)}
"""Files in which studies without a report have their answer, by verb."""


def write_report(folder: Path) -> list[Path]:
    """Write the report of a folder of results into it; returns the files. Raises `ScenarioError`."""
    if not folder.is_dir():
        raise ScenarioError(f"{folder}: no such folder")
    found = next((name for name in PAGES if (folder / name).is_file()), None)
    if found is None:
        if (folder / "twin.json").is_file():
            raise ScenarioError(f"{folder}: twin has written its report already, report.html there")
        for verb, names in OTHERS.items():
            if (folder / names[0]).is_file():
                raise ScenarioError(f"{folder}: {verb} has no report; its answer is in {' and '.join(names)}")
        raise ScenarioError(f"{folder}: holds no results; name a folder of run, compare, sweep, limit or validate")
    check_folder(folder, FILES)
    try:
        with reporting_damage(folder / found, "reported"):
            page = PAGES[found](folder)
            printed = sweep_figures(folder) if found == "sweep.parquet" else []
    except ScenarioError as error:
        raise with_plugin_options(error, folder / "sweep.toml") from None
    return [page.write(folder / "report.html"), *printed]
