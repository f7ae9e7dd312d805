"""Report `report.html` of a results folder, and printable figures.

Extensions and installed packages provide a `Reports` object at entry points of the group `agrobot_mj.reports`.
"""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from matplotlib.figure import Figure

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import entry_points_of, folder_absence
from agrobot_mj.metrics.success import error_of
from agrobot_mj.scenario.plugins import with_plugin_options
from agrobot_mj.simulation.results import check_folder
from agrobot_mj.studies.pages.document import COLOURS, Document
from agrobot_mj.studies.pages.drive import comparison_page, run_page
from agrobot_mj.studies.pages.ranking import CONFIDENCE, LABEL, METRIC, Group
from agrobot_mj.studies.pages.sweep import group_runs, median_curve, sweep_page
from agrobot_mj.studies.results_io import reporting_damage
from agrobot_mj.studies.style import PANEL_WIDTH_IN, write_figure
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import read_rows

Page = Callable[[Path], Document]  # Function that returns the report page of a results folder
Section = Callable[[Document, Path, str | None], list[Path]]
"""Type of a function that adds a section to the page of a results folder and returns the written files.

The third argument is the metric of the option `--metric`.
"""


class Reports(NamedTuple):
    """Report pages and sections of an extension. Their keys are the names of the main files of results folders."""

    pages: Mapping[str, Page | str] = MappingProxyType({})
    """Page functions, keyed by the main file of the results. A text in place of a function states why there is no
    page."""
    sections: Mapping[str, Section] = MappingProxyType({})
    """Functions that append a section to a page of another `Reports` object, keyed by the main file of the results."""


def sweep_figures(folder: Path) -> list[Path]:
    """Draw `ranking.png` and, if the sweep has numeric parameters, `curves.png`. Return the written files."""
    groups, numeric = group_runs(read_rows(folder))
    drawn = read_sweep(folder / "sweep.toml").file.draws
    saved = [write_figure(folder / "ranking.png", ranking, groups)]
    return [*saved, write_figure(folder / "curves.png", over_parameters, groups, numeric, drawn)] if numeric else saved


def ranking(groups: list[Group]) -> Figure:
    """Draw the success rates with intervals and the errors of successful runs for each group of runs, best group on
    top."""
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
    left.set_xlabel(f"successful runs, {100 * CONFIDENCE:.0f} % interval [%]")
    left.set(xlim=(-3, 103), ylim=(len(groups) - 0.5, -0.5))
    right.set_xlabel(LABEL)
    return figure


def over_parameters(groups: list[Group], numeric: list[str], drawn: Collection[str] = ()) -> Figure:
    """Draw the errors of successful runs and their median versus each numeric parameter.

    `drawn` contains the names of the random parameters.
    """
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


FILES = ("report.html", "ranking.png", "curves.png")


def known_reports() -> tuple[dict[str, Page | str], dict[str, list[Section]]]:
    """Return all pages and sections, keyed by the main file of the results.

    The page of a run is last, because a folder with other results may also contain a run.
    """
    pages: dict[str, Page | str] = {"comparison.json": comparison_page, "sweep.parquet": sweep_page}
    sections = dict[str, list[Section]]()
    for entry in entry_points_of("reports"):
        reports: Reports = entry.load()
        pages |= reports.pages
        for name, section in reports.sections.items():
            sections.setdefault(name, []).append(section)
    return {**pages, "signals.parquet": run_page}, sections


def write_report(folder: Path, metric: str | None = None) -> list[Path]:
    """Write the report of a results folder and return the written files.

    Raises `ScenarioError` if the folder contains no results.
    """
    if not folder.is_dir():
        raise ScenarioError(f"{folder}: {folder_absence(folder)}")
    pages, sections = known_reports()
    found = next((name for name in pages if (folder / name).is_file()), None)
    if found is None:
        raise ScenarioError(
            f"{folder}: the folder contains no results; specify the folder of a run, or repeat an interrupted command"
        )
    if isinstance(make := pages[found], str):
        raise ScenarioError(f"{folder}: {make}")
    if metric is not None and found not in sections:
        raise ScenarioError(f"--metric {metric}: this type of report uses no metric; omit the option")
    check_folder(folder, FILES)
    try:
        with reporting_damage(folder / found, "reported"):
            page = make(folder)
            printed = sweep_figures(folder) if found == "sweep.parquet" else []
            printed += [file for section in sections.get(found, ()) for file in section(page, folder, metric)]
    except ScenarioError as error:
        raise with_plugin_options(error, folder / "sweep.toml") from None
    return [page.write(folder / "report.html"), *printed]
