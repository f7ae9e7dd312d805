"""The figure of a limit: how many runs succeed over the key, one panel per law."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from agrobot_mj.studies.limit.search import Found, Question
from agrobot_mj.studies.style import PANEL_WIDTH_IN, SPARE_COLOURS, STYLE, save


def write_figure(question: Question, found: Sequence[Found], file: Path) -> Path:
    """Draw the figure into a PNG file."""
    with mpl.rc_context(STYLE):
        return save(figure(question, found), file)


def figure(question: Question, found: Sequence[Found]) -> Figure:
    """Success rate over the key with its interval, one panel per law; where it stops holding is shaded."""
    drawn = Figure((PANEL_WIDTH_IN, 1.5 * len(found) + 0.6), layout="constrained")
    grid = drawn.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each, k in zip(grid, found, range(len(found)), strict=True):
        colour = SPARE_COLOURS[k % len(SPARE_COLOURS)]
        values = [t.value for t in each.tried]
        rates = [100 * (1 - t.failed / t.runs) for t in each.tried]
        lower = [rate - 100 * t.low for rate, t in zip(rates, each.tried, strict=True)]
        upper = [100 * t.high - rate for rate, t in zip(rates, each.tried, strict=True)]
        if each.interval:
            axes.axvspan(*each.interval, color="#DDDDDD", linewidth=0)
        axes.axhline(100 * question.reliability, color="black", linewidth=0.6, linestyle="--")
        # Rounding may leave a bar a hair below zero length, which matplotlib refuses.
        bars = [[max(0.0, b) for b in lower], [max(0.0, b) for b in upper]]
        axes.errorbar(values, rates, bars, color=colour, marker="o", markersize=3, linewidth=0.9, capsize=2)
        axes.set(ylim=(-5, 105), title=each.law)
    drawn.supylabel(f"successful runs, {question.confidence:.0%} interval [%]", fontsize=8)
    grid[-1].set_xlabel(question.key)
    return drawn
