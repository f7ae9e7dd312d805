"""Figures of a sweep as files for print: success and error of its groups, and the error over each parameter."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from agrobot_mj.metrics.success import error_of
from agrobot_mj.studies.pages.document import COLOURS
from agrobot_mj.studies.pages.sweep import CONFIDENCE, LABEL, METRIC, Group, grouped, median_curve
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save
from agrobot_mj.studies.sweep.store import read_rows


def sweep_figures(folder: Path) -> list[Path]:
    """Draw `ranking.png`, and `curves.png` if a parameter is a number."""
    groups, numeric = grouped(read_rows(folder))
    with mpl.rc_context(STYLE):
        drawn = [save(ranking(groups), folder / "ranking.png")]
        return [*drawn, save(over_parameters(groups, numeric), folder / "curves.png")] if numeric else drawn


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


def over_parameters(groups: list[Group], numeric: list[str]) -> Figure:
    """Error of the successful runs and its median over each parameter that is a number."""
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
                curve = median_curve(group, parameter, colour)
                axes.plot(curve["x"], curve["y"], color=colour, linewidth=1)
        axes.set(xlabel=parameter, ylabel=LABEL)
    for axes in grid[len(numeric) :]:
        axes.remove()
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(groups), 2 * columns))
    return figure
