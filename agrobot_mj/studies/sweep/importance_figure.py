"""The figure of Sobol indices: bars with their intervals, one panel per group."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLUE, ORANGE
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save
from agrobot_mj.studies.sweep.importance import Influence


def write_figure(found: Sequence[Influence], metric: str, file: Path) -> Path:
    """Draw the figure into a PNG file."""
    with mpl.rc_context(STYLE):
        return save(importance_figure(found, metric), file)


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
