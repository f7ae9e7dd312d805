"""Figures of the paper's claims: means over the seeds with 95 % intervals. A cross marks a mean with failed seeds."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from estimates import Estimate, field
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, ScalarFormatter
from measured.claims import FASTER, ISGN, LQR, MSE, PAPER_RATIO, PATHS, PD, PI, PLANTS, SIGMAS, T1, T2, TURNS, Claims
from measured.claims import turn as of_turn
from sweeps import Row, shipped

from agrobot_mj.core.palette import BLUE, DARK_GREY, GREEN, ORANGE, PINK, SKY_BLUE, VERMILION
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, law_name, save

COLOURS = {PD: VERMILION, ISGN: ORANGE, T1: GREEN, T2: BLUE, PI: PINK, LQR: SKY_BLUE, FASTER: DARK_GREY}
MARKS, LINES = {"bicycle": "o", "mujoco": "s"}, {"bicycle": "--", "mujoco": "-"}
LOG, MSE_M2 = {"yscale": "log"}, "lateral MSE [m²]"


class Panel(NamedTuple):
    """Panel of a figure, with curves of laws and plants."""

    xlabel: str
    ylabel: str
    xs: Sequence[Any]  # Values of the x axis: names are placed side by side, numbers are connected by lines
    laws: Sequence[str]
    curve: Callable[[str, str, Any], Estimate]  # Function of plant, law and x value that returns the estimate
    look: Mapping[str, Any] = {}  # Further properties of the axes
    line: float | None = None  # y value of a dashed line
    plants: Sequence[str] = PLANTS


def panels(claims: Claims) -> dict[str, list[Panel]]:
    """Return the panels of each figure, by figure name in the order of the claims."""
    eights, gains, halves = list(PATHS), shipped("claims_gain")["axes"]["controller.kp"], ("turn 1", "turn 2")

    def settling(name: str, factor: float = 1.0) -> Callable[[str, str, Any], Estimate]:
        return lambda plant, law, k: claims.mean(of_turn(name, k, factor), plant, law, "settling")

    def soil(plant: str, label: str) -> Panel:
        xte, soils = field("xte_rms", 100), claims.soils(plant)
        return Panel(label, "cross-track rms [cm]", soils, (PD, ISGN, T2, PI, LQR),
                     lambda p, law, x: claims.mean(xte, p, law, "soil", x),
                     {**LOG, **log_x(soils), "title": plant}, plants=(plant,))  # fmt: skip

    return {
        "better": [
            Panel("", "lateral MSE over that of PD [-]", eights, (ISGN, T1, T2, PI),
                  lambda p, law, x: claims.over(PD, p, law, *PATHS[x]), LOG, PAPER_RATIO),
            Panel("gain of the PD, k_P [-]", MSE_M2, gains, (PD, ISGN, T2),
                  lambda p, law, x: claims.mean(MSE, p, law, "gain", x), LOG),
        ],
        "takes_over": [
            Panel("", "share of the steering command [-]", halves, (ISGN, T1, T2),
                  lambda p, law, x: claims.mean(of_turn("nn_share", 1 + halves.index(x)), p, law), line=0.5),
            Panel("turn", "share of the network [-]", TURNS, (T2,), settling("nn_share")),
        ],
        "second": [
            Panel("", "lateral MSE, turn 2 over turn 1 [-]", eights, (PD, ISGN, T2),
                  lambda p, law, x: claims.second_turn(p, law, *PATHS[x]), line=1.0),
        ],
        "q_settles": [
            Panel("turn", "travel of q [-]", TURNS, (T2,), settling("q_travel"), line=2.0),
            Panel("turn", "q rests at a limit [% of the turn]", TURNS, (T2,), settling("q_rests", 100)),
        ],
        "noise": [
            Panel("noise of the position [m]", MSE_M2, SIGMAS, (T1, FASTER, T2),
                  lambda p, law, x: claims.mean(MSE, p, law, "noise", x), log_x(SIGMAS)),
            Panel("noise of the position [m]", "MSE of type 2 over type 1 [-]", SIGMAS, (T1, FASTER),
                  lambda p, law, x: claims.over(law, p, T2, "noise", x), log_x(SIGMAS), 1.0),
        ],
        "soil": [soil("bicycle", "cornering stiffness over the model's [-]"), soil("mujoco", "cone index [kPa]")],
    }  # fmt: skip


def write_claim_figures(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw all figures of the claims, write the files to `folder`, and return their paths."""
    with mpl.rc_context(STYLE):
        return [save(drawn(row), folder / f"claims_{name}.png") for name, row in panels(Claims(rows)).items()]


def drawn(row: Sequence[Panel]) -> Figure:
    """Return a figure with panels side by side and a common legend: colours for laws, markers for plants."""
    figure = Figure((2 * PANEL_WIDTH_IN, 2.8), layout="constrained")
    for axes, panel in zip(figure.subplots(1, len(row), squeeze=False)[0], row, strict=True):
        draw(axes, panel)
    laws = dict.fromkeys(law for panel in row for law in panel.laws)
    names = {law: "PD + T1FNN, faster" if law == FASTER else law_name(law) for law in laws}
    handles = [axes.plot([], [], "s", color=COLOURS[law], label=name)[0] for law, name in names.items()]
    handles += [axes.plot([], [], MARKS[p] + LINES[p], color="black", mfc=face(p, "black"), label=p)[0] for p in PLANTS]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), columnspacing=1.2)
    return figure


def draw(axes: Axes, panel: Panel) -> None:
    """Draw the curves of a panel, with vertical lines for intervals."""
    named, curves = isinstance(panel.xs[0], str), list(product(panel.laws, panel.plants))
    for k, (law, plant) in enumerate(curves):
        shift = 0.6 * (k - (len(curves) - 1) / 2) / len(curves)
        places = [j + shift for j in range(len(panel.xs))] if named else panel.xs
        found = [(x, panel.curve(plant, law, at)) for x, at in zip(places, panel.xs, strict=True)]
        colour, found = COLOURS[law], [(x, each) for x, each in found if each.n]
        if not named:
            axes.plot([x for x, _ in found], [each.mean for _, each in found], LINES[plant], color=colour)
        for x, each in found:
            ends = [[each.mean - each.low], [each.high - each.mean]] if each.n > 1 else None
            mark = "X" if each.failed else MARKS[plant]
            axes.errorbar(x, each.mean, ends, fmt=mark, ms=4, color=colour, mfc=face(plant, colour), elinewidth=1.2)
    if panel.line is not None:
        axes.axhline(panel.line, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel=panel.xlabel, ylabel=panel.ylabel, **panel.look)
    if named:
        axes.set_xticks(range(len(panel.xs)), [x.replace(", ", ",\n") for x in panel.xs])
        axes.set_xlim(-0.5, len(panel.xs) - 0.5)
    if axes.get_yscale() == "log":
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.minorticks_off()


def log_x(values: Sequence[float]) -> dict[str, Any]:
    """Return axes properties for a logarithmic x axis with a tick at each value."""
    return {"xscale": "log", "xticks": values, "xticklabels": [f"{x:g}" for x in values]}


def face(plant: str, colour: str) -> str:
    """Return the fill colour of a marker. Markers of the bicycle model are hollow."""
    return colour if plant == "mujoco" else "white"
