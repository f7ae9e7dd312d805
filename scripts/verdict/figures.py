"""Figures of the verdict on the paper's claims, one each. Marks are means with 95 % intervals over the seeds."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from estimates import Estimate, Value, mean, select
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter
from verdict.claims import FASTER, GAINS, ISGN, LONG_TURNS, LQR, PATHS, PD, PI, PLANTS, SIGMAS, T1, T2
from verdict.judgement import PAPER_RATIO, Rows, against_type_1, mse, over_pd, second_turn, share, turn, xte

from agrobot_mj.core.palette import BLUE, DARK_GREY, GREEN, ORANGE, PINK, SKY_BLUE, VERMILION
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save

LAW_COLOURS = {PD: VERMILION, ISGN: ORANGE, T1: GREEN, T2: BLUE, PI: PINK, LQR: SKY_BLUE, FASTER: DARK_GREY}
LAW_NAMES = {
    PD: "PD",
    ISGN: "PD + integral of sgn",
    T1: "PD + type 1",
    T2: "PD + type 2 (paper)",
    PI: "PI",
    LQR: "LQR",
    FASTER: "type 1, faster",
}
MARKS = {"bicycle": "o", "mujoco": "s"}
PLANT_NAMES = {"bicycle": "bicycle", "mujoco": "MuJoCo"}
SHIFT = 0.12
"""Distance between the marks of the two plants on an axis of names."""


def write_claim_figures(rows: Rows, folder: Path) -> list[Path]:
    """Draw all figures of the claims into `folder`; return the files."""
    with mpl.rc_context(STYLE):
        return [save(draw(rows), folder / f"verdict_{draw.__name__}.png") for draw in CLAIM_FIGURES]


def mark(axes: Axes, x: float, found: Estimate, colour: str, plant: str, label: str | None = None) -> None:
    """An estimate with its interval, upright, that a single seed does not give; a cross where seeds failed."""
    if np.isfinite(found.low):
        axes.plot([x, x], [found.low, found.high], color=colour, linewidth=1.2)
    face = colour if plant == "mujoco" else "white"
    shape = "X" if found.failed else MARKS[plant]
    axes.plot([x], [found.mean], shape, markersize=4, color=colour, markerfacecolor=face, label=label)


def better(rows: Rows) -> Figure:
    """Error over that of PD, by law and by the gain of the PD."""
    figure, (left, right) = panels(2)
    laws = (PD, ISGN, T1, T2, PI)
    for k, law in enumerate(laws):
        for plant, shift in zip(PLANTS, (-SHIFT, SHIFT), strict=True):
            mark(left, k + shift, over_pd(rows, plant, law), LAW_COLOURS[law], plant)
    left.axhline(PAPER_RATIO, color="black", linestyle="--", linewidth=0.8)
    left.text(4.4, PAPER_RATIO * 1.03, "the paper: 0.70", ha="right", va="bottom", fontsize=7)
    left.set(yscale="log", ylabel="lateral MSE over that of PD [-]", xlim=(-0.5, 4.5))
    plain_ticks(left, (0.02, 0.05, 0.1, 0.2, 0.5, 1.0))
    left.set_xticks(range(5), ["PD", "integral\nof sgn", "type 1", "type 2", "PI"])
    for law in (PD, ISGN, T2):
        for plant in PLANTS:
            line = [mean(select(rows, study="gain", plant=plant, law=law, x=gain), mse) for gain in GAINS]
            curve(right, GAINS, line, LAW_COLOURS[law], plant)
    right.set(yscale="log", ylabel="lateral MSE [m²]", xlabel="gain of the PD, k_P [-]")
    plain_ticks(right, (0.005, 0.01, 0.02, 0.05, 0.1, 0.2))
    return legends(figure, (PD, ISGN, T1, T2, PI))


def takes_over(rows: Rows) -> Figure:
    """Share of the network and of the integral in the command, turn by turn."""
    figure, (left, right) = panels(2)
    for k, law in enumerate((ISGN, T1, T2)):
        for plant, shift in zip(PLANTS, (-SHIFT, SHIFT), strict=True):
            for number in (1, 2):
                mark(left, 2 * k + 0.7 * (number - 1) + shift, share(rows, plant, law, number), LAW_COLOURS[law], plant)
    left.axhline(0.5, color="black", linestyle="--", linewidth=0.8)
    left.text(4.95, 0.503, "above: it leads", ha="right", va="bottom", fontsize=7)
    left.set(ylim=(0.45, 0.8), ylabel="share of the steering command [-]", xlim=(-0.5, 5.2))
    left.set_xticks([0, 0.7, 2, 2.7, 4, 4.7], ["1", "2"] * 3)
    left.set_xlabel("turn")
    turns = np.arange(1, LONG_TURNS + 1)
    for plant in PLANTS:
        runs = select(rows, study="settling", plant=plant)
        line = [mean(runs, turn("share_turns", int(k))) for k in turns]
        curve(right, turns, line, LAW_COLOURS[T2], plant)
    right.set(xlabel="turn", ylabel="share of the network [-]", ylim=(0.45, 0.8))
    return legends(figure, (ISGN, T1, T2))


def second(rows: Rows) -> Figure:
    """Error of the second turn over that of the first, by case."""
    figure = Figure((2 * PANEL_WIDTH_IN, 2.6), layout="constrained")
    axes = figure.subplots()
    cases: list[tuple[str, float | str]] = [("paper", 0.0), *(("paths", path) for path in PATHS)]
    for k, (study, x) in enumerate(cases):
        for law, shift in ((PD, -0.25), (ISGN, 0.0), (T2, 0.25)):
            for plant, aside in zip(PLANTS, (-0.05, 0.05), strict=True):
                mark(axes, k + shift + aside, second_turn(rows, plant, law, study, x), LAW_COLOURS[law], plant)
    axes.axhline(1.0, color="black", linestyle="--", linewidth=0.8)
    axes.set(ylabel="lateral MSE, turn 2 / turn 1 [-]", ylim=(0.7, 1.5), xlim=(-0.5, len(cases) - 0.5))
    axes.set_xticks(range(len(cases)), ["10 m, 1.2 m/s\n(the paper's)", *PATHS])
    return legends(figure, (PD, ISGN, T2))


def q_settles(rows: Rows) -> Figure:
    """How far q travels in each turn, and how long it rests at a limit."""
    figure, (left, right) = panels(2)
    turns = np.arange(1, LONG_TURNS + 1)
    for plant in PLANTS:
        runs = select(rows, study="settling", plant=plant)
        for axes, name, factor in ((left, "q_travel", 1.0), (right, "q_rests", 100.0)):
            curve(axes, turns, [scaled(runs, turn(name, int(k)), factor) for k in turns], LAW_COLOURS[T2], plant)
    left.axhline(2.0, color="black", linestyle="--", linewidth=0.8)
    left.text(8.0, 1.7, "once there and back: 2", ha="right", va="top", fontsize=7)
    left.set(xlabel="turn", ylabel="travel of q [-]", ylim=(0, 26))
    right.set(xlabel="turn", ylabel="q rests at a limit [% of the turn]", ylim=(0, 70))
    return legends(figure, (T2,))


def noise(rows: Rows) -> Figure:
    """Type 2 against type 1 over the noise of the position."""
    figure, (left, right) = panels(2)
    for plant in PLANTS:
        for law in (T1, FASTER, T2):
            line = [mean(select(rows, study="noise", plant=plant, law=law, x=s), mse) for s in SIGMAS]
            curve(left, SIGMAS, line, LAW_COLOURS[law], plant)
        for law in (T1, FASTER):
            line = [against_type_1(rows, plant, s, law) for s in SIGMAS]
            curve(right, SIGMAS, line, LAW_COLOURS[law], plant)
    right.axhline(1.0, color="black", linestyle="--", linewidth=0.8)
    left.set(xscale="log", xlabel="noise of the position [m]", ylabel="lateral MSE [m²]", ylim=(0, None))
    right.set(xscale="log", xlabel="noise of the position [m]", ylabel="MSE of type 2 over type 1 [-]")
    for axes in (left, right):
        axes.set_xticks(SIGMAS, [f"{s:g}" for s in SIGMAS])
        axes.minorticks_off()
    return legends(figure, (T1, FASTER, T2))


def soil(rows: Rows) -> Figure:
    """Cross-track error over what soil is: stiffness on the bicycle, cone index on MuJoCo."""
    figure, grid = panels(2)
    for axes, plant, label in zip(
        grid, PLANTS, ("cornering stiffness over the model's [-]", "cone index [kPa]"), strict=True
    ):
        values = sorted({row["x"] for row in select(rows, study="soil", plant=plant)})
        for law in (PD, ISGN, T2, PI, LQR):
            line = [scaled(select(rows, study="soil", plant=plant, law=law, x=x), xte, 100) for x in values]
            if any(found.n for found in line):
                curve(axes, values, line, LAW_COLOURS[law], plant)
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel="cross-track rms [cm]", title=PLANT_NAMES[plant])
        axes.set_xticks(values, [f"{x:g}" for x in values])
        axes.minorticks_off()
        plain_ticks(axes, (1, 2, 5, 10, 20, 50))
    return legends(figure, (PD, ISGN, T2, PI, LQR))


CLAIM_FIGURES = (better, takes_over, second, q_settles, noise, soil)
"""Figures in the order of the claims."""


def scaled(rows: Rows, value: Value, factor: float) -> Estimate:
    """A value over the seeds, in another unit."""
    return mean(rows, lambda row: factor * value(row))


def panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    """A figure of some panels beside each other."""
    figure = Figure((2 * PANEL_WIDTH_IN, 2.8), layout="constrained")
    return figure, figure.subplots(1, count)


def curve(axes: Axes, x: Iterable[float], found: Sequence[Estimate], colour: str, plant: str) -> None:
    """Estimates over `x`, joined; dashed for the bicycle."""
    places = list(x)
    axes.plot(places, [f.mean for f in found], color=colour, linestyle="-" if plant == "mujoco" else "--")
    for place, each in zip(places, found, strict=True):
        mark(axes, place, each, colour, plant)


def plain_ticks(axes: Axes, values: Sequence[float]) -> None:
    """Ticks of a logarithmic ordinate as plain numbers."""
    axes.set_yticks(values)
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.minorticks_off()


def legends(figure: Figure, laws: Sequence[str]) -> Figure:
    """One legend above the panels: colours of laws, marks of plants."""
    axes = figure.axes[0]
    handles = [axes.plot([], [], "s", color=LAW_COLOURS[law], label=LAW_NAMES[law])[0] for law in laws]
    for plant in PLANTS:
        face = "black" if plant == "mujoco" else "white"
        style = "-" if plant == "mujoco" else "--"
        look: dict[str, Any] = {"color": "black", "linestyle": style, "markerfacecolor": face, "markersize": 4}
        handles.append(axes.plot([], [], MARKS[plant], label=PLANT_NAMES[plant], **look)[0])
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), columnspacing=1.2)
    return figure
