"""Importance for readers: a table, sentences on what the samples show, and a figure."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.palette import BLUE, LIGHT_GREY, ORANGE
from agrobot_mj.studies.style import PANEL_WIDTH_IN
from agrobot_mj.studies.sweep.importance.shares import Influence, Share

NEGLIGIBLE = 0.05
"""Share of the variance below which a number may stay an estimate [-]."""


def importance_table(found: Sequence[Influence]) -> str:
    """Markdown table: a row per draw; rank, share of the variance and effect in each group.

    Ranks are ranges where the samples leave the order open.
    """
    screening = found[0].unexplained is not None
    columns = ["rank", "share of the variance", *(["slope", "Spearman"] if screening else ["first order"])]
    names = [f"{each.group}: {name}" if len(found) > 1 else name for each in found for name in columns]
    rows = []
    for leading in found[0].shares:
        shares = [next(share for share in each.shares if share.key == leading.key) for each in found]
        cells = [cell for share, each in zip(shares, found, strict=True) for cell in _cells(share, not each.flaws)]
        rows.append((f"`{leading.key}`", *cells))
    return markdown_table(("number", *names), rows, 1)


def _cells(share: Share, trusted: bool) -> list[str]:
    """Rank, share with its interval, and effect of a draw in a group."""
    rank = share.rank if trusted else "?"
    cells = [rank, f"{share.share:.2f} ({share.low:.2f} to {share.high:.2f})", f"{share.effect:.2f} ± {share.half:.2f}"]
    return cells if share.correlation is None else [*cells, f"{share.correlation:.2f}"]


def importance_text(found: Sequence[Influence], metric: str) -> str:
    """Sentences on what the samples of each group show and do not show."""
    return "\n".join(_text(each, metric, f"{each.group}: " if len(found) > 1 else "") for each in found)


def _text(each: Influence, metric: str, group: str) -> str:
    noise = (
        "one seed does not tell how much of it is noise"
        if each.noise is None
        else f"noise of the seeds is {each.noise:.0%} of that variance"
    )
    lines = [f"{group}{metric} {each.mean:.4g}, standard deviation {each.deviation:.2g} over the points; {noise}."]
    if each.unexplained is not None:
        lines.append(
            f"Up to {each.unexplained:.0%} of the variance is neither linear nor noise; it may be anyone's, and is in "
            "the upper end of each interval."
        )
    if each.flaws:
        return "\n".join([*lines, *(f"{flaw}." for flaw in each.flaws), "So there is no ranking."])
    if not each.ordered_pairs:
        return "\n".join([*lines, "These samples tell no two numbers apart: there is no ranking."])
    lines.append(f"{each.ordered_pairs} of {each.pairs} pairs are told apart; numbers whose ranks overlap are tied.")
    if small := [share.key for share in each.shares if share.high < NEGLIGIBLE]:
        lines.append(f"Less than {NEGLIGIBLE:.0%} each: {', '.join(small)}.")
    return "\n".join(lines)


def importance_figure(found: Sequence[Influence], metric: str) -> Figure:
    """Shares with their intervals, a panel per group; of Sobol indices those of first order, too."""
    keys, screening = [share.key for share in found[0].shares][::-1], found[0].unexplained is not None
    figure = Figure((2 * PANEL_WIDTH_IN, 0.22 * len(keys) + 1.0), layout="constrained")
    grid = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    lines = {"elinewidth": 0.8}
    for axes, each in zip(grid, found, strict=True):
        for share in each.shares:
            y, colour = keys.index(share.key), LIGHT_GREY if each.flaws else BLUE
            ends = [[max(0.0, share.share - share.low)], [max(0.0, share.high - share.share)]]
            axes.barh(y + 0.18, share.share, 0.36, xerr=ends, color=colour, error_kw=lines)
            if not screening:
                axes.barh(y - 0.18, share.effect, 0.36, xerr=share.half, color=ORANGE, error_kw=lines)
        axes.set_yticks(range(len(keys)), [f"{key}  [{_rank(found[0], key)}]" for key in keys])
        axes.set(title=each.group if len(found) > 1 else "", xlabel=f"share of the variance of {metric} [-]")
        axes.set_xlim(min(-0.05, axes.get_xlim()[0]), max(1.05, axes.get_xlim()[1]))
        axes.axvline(0.0, color="black", linewidth=0.6)
    if not screening:
        handles = [grid[0].barh([0], [0], color=colour) for colour in (BLUE, ORANGE)]
        figure.legend(handles, ["total, with interactions", "first order"], loc="outside upper center", ncols=2)
    return figure


def _rank(first: Influence, key: str) -> str:
    """Rank of a draw in the first group."""
    return "?" if first.flaws else next(share.rank for share in first.shares if share.key == key)
