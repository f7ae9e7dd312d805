"""Figures of the validation: step steer, crab angle on a slope, offset on a slope, and understeer. Markers show
measurements, and lines show theory."""

from collections.abc import Callable, Mapping
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLACK, BLUE, GREEN, GREY, PINK, VERMILION
from agrobot_mj.extensions.bench.manoeuvres.antenna_lean import ESTIMATORS, loop, offset, steady_state
from agrobot_mj.extensions.bench.manoeuvres.base import BICYCLE, Trial, tyre_of
from agrobot_mj.extensions.bench.manoeuvres.cornering import RADIUS_M, paper_gradient
from agrobot_mj.extensions.bench.manoeuvres.side_slope import linear_slip
from agrobot_mj.extensions.bench.manoeuvres.step_steer import Step
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies.style import PANEL_WIDTH_IN, write_figure
from agrobot_mj.tyres import Linear

COLOURS = {BICYCLE: BLACK, "linear": BLUE, "magic_formula": VERMILION, "soil": GREEN, "contact": GREY}
SPARE_COLOUR = PINK
MARKS = {BICYCLE: "x", "linear": "o", "magic_formula": "s", "soil": "^", "contact": "+"}
STYLES = dict(zip(ESTIMATORS, ("-", "--", ":"), strict=True))


def write_figures(found: Mapping[str, Trial], folder: Path) -> list[Path]:
    """Write the figures of all manoeuvres in `found` (trials by name) to `folder`, and return the file paths."""
    drawn = {draw: found[name].curves for name, (draw, _) in FIGURES.items() if name in found}
    return [write_figure(folder / f"{draw.__name__}.png", draw, curves) for draw, curves in drawn.items()]


def step_steer(steps: Mapping[str, Step]) -> Figure:
    """Plot steering angle and yaw rate versus the time since the step."""
    figure = Figure((2 * PANEL_WIDTH_IN, 2.7), layout="constrained")
    left, right = figure.subplots(1, 2)
    for subject, step in steps.items():
        look = {"color": _colour(subject), "linestyle": "--" if subject == BICYCLE else "-", "label": subject}
        left.plot(step.t, np.degrees(step.steer), **look)
        right.plot(step.t, np.degrees(step.yaw_rate), **look)
    left.set(xlabel="time [s]", ylabel="steering angle [deg]", xlim=(0, 3))
    right.set(xlabel="time [s]", ylabel="yaw rate [deg/s]", xlim=(0, 3))
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def side_slope(rows: Mapping[str, list[tuple[float, float]]]) -> Figure:
    """Plot the crab angle of the heading versus the grade of a side slope, with the theoretical mean crab angle."""
    figure = Figure((PANEL_WIDTH_IN + 1.0, 3.2), layout="constrained")
    axes, grades = figure.subplots(), np.linspace(0.0, 16.0, 33)
    for kind, seen in rows.items():
        if tyre_of(kind).judged:
            paper = Tractor(tyre=tyre_of(kind))
            axes.plot(grades, [degrees(paper.side_slope(g).rear_slip) for g in grades], color=_colour(kind))
        axes.plot(*zip(*seen, strict=True), MARKS.get(kind, "d"), color=_colour(kind), markersize=4, label=kind)
    share = [degrees(linear_slip(Tractor(tyre=Linear()), grade)) for grade in grades]
    axes.plot(grades, share, ":", color=COLOURS["linear"], label="linear: m g sin / (C_f + C_r), mean of both axles")
    axes.set(xlabel="side slope [deg]", ylabel="heading above the course [deg]")
    axes.legend()
    return figure


def antenna_lean(rows: Mapping[str, Mapping[str, list[tuple[float, float]]]]) -> Figure:
    """Plot the offset of the CG from the line versus the grade of a side slope, with one panel per controller and one
    line style per estimator."""
    controllers = list(dict.fromkeys(words.split(", ")[0] for words in rows))
    figure = Figure((2 * PANEL_WIDTH_IN, 3.2), layout="constrained")
    grades = np.linspace(0.5, 15.0, 30)
    panels = figure.subplots(1, len(controllers), sharey=True, squeeze=False)[0]
    named = set[tuple[str, str]]()
    for words, by_tyre in rows.items():
        controller, _, estimator = words.partition(", ")
        axes, style = panels[controllers.index(controller)], STYLES[estimator]
        for kind, seen in by_tyre.items():
            scenario = load_scenario("straight_line", loop(controller, ESTIMATORS[estimator]))
            theory = [100 * offset(scenario, steady_state(tyre_of(kind), grade)) for grade in grades]
            label = None if (controller, kind) in named else kind
            named.add((controller, kind))
            axes.plot(grades, theory, style, color=_colour(kind), label=label)
            x, y = zip(*seen, strict=True)
            axes.plot(x, 100 * np.array(y), MARKS.get(kind, "d"), color=_colour(kind), markersize=4)
        axes.set(title=controller, xlabel="side slope [deg]", xlim=(0, 16))
    for estimator, style in STYLES.items():
        panels[-1].plot([], [], style, color="black", label=estimator)
    panels[0].set(ylabel="CG above the line [cm]")
    figure.legend(*panels[-1].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def understeer(rows: Mapping[str, np.ndarray]) -> Figure:
    """Plot the steering angle minus wheelbase divided by radius versus the lateral acceleration, with one curve per
    tyre."""
    figure = Figure((PANEL_WIDTH_IN + 1.0, 3.2), layout="constrained")
    axes, a = figure.subplots(), np.linspace(0.02, 0.6, 25)
    for subject, seen in rows.items():
        mark, size = MARKS.get(subject, "d"), 6 if subject == BICYCLE else 4
        axes.plot(seen[:, 0], np.degrees(seen[:, 1]), mark, color=_colour(subject), markersize=size, label=subject)
        if subject == BICYCLE:
            axes.plot(a, np.degrees(a * paper_gradient(subject)), "--", color=_colour(subject), zorder=3)
        elif tyre_of(subject).judged:
            states = [Tractor(tyre=tyre_of(subject)).balance(value, curvature=1 / RADIUS_M) for value in a]
            slips = [degrees(state.front_slip - state.rear_slip) for state in states]
            axes.plot(a, slips, color=_colour(subject))
    axes.set(xlabel="lateral acceleration [m/s$^2$]", ylabel="steering angle beyond L/R [deg]")
    axes.legend()
    return figure


def _colour(subject: str) -> str:
    return COLOURS.get(subject, SPARE_COLOUR)


FIGURES: dict[str, tuple[Callable[[Any], Figure], str]] = {
    "side slope": (side_slope, "Crab angle across a side slope: simulation (markers) and theory (lines)"),
    "antenna lean": (antenna_lean, "Error of the CG along a side slope: simulation (markers) and theory (lines)"),
    "constant radius": (understeer, "Understeer: simulation (markers) and theory (lines)"),
    "step steer": (step_steer, "Step steer at 4 m/s"),
}
"""Function and caption of each figure, by manoeuvre name. Each figure file is named after its function."""
