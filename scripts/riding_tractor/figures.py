"""Figures of the page about real machines, in the style of all figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLUE, DARK_GREY, GREEN, ORANGE, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save
from riding_tractor.closed_loop import Pass
from riding_tractor.coverage import Straight

MODEL_COLOURS = (BLUE, ORANGE, GREEN, VERMILION)
"""Colours of the models beside the recording, which is grey."""


def drawn(file: Path, height: float, columns: int, draw: Any, **layout: Any) -> Path:
    """Draw a row of panels of some height [in]; `draw` gets their axes."""
    with rc_context(STYLE):
        figure = Figure(figsize=(columns * PANEL_WIDTH_IN, height), layout="constrained")
        draw(figure.subplots(1, columns, **layout))
        return save(figure, file)


def slipping(passes: Sequence[Straight], heading_error: float, file: Path) -> Path:
    """Reading straight ahead, and the offset from the line beside what that reading asks for."""
    minutes = np.array([p.t for p in passes]) / 60.0
    west = np.array([p.westwards for p in passes])

    def draw(axes: Any) -> None:
        reading, offset = axes
        for way, marker, name in ((west, "<", "westwards"), (~west, ">", "eastwards")):
            pots, lefts = (np.array([getattr(p, key) for p in passes])[way] for key in ("pot", "left"))
            reading.plot(minutes[way], pots, marker, color=BLUE, markersize=3.5, label=name)
            offset.plot(minutes[way], 100 * lefts, marker, color=BLUE, markersize=3.5, label=f"recorded, {name}")
        reading.axhline(447, color=DARK_GREY, label="straight ahead by the firmware")
        asked = [100 * p.expected(heading_error) for p in passes]
        offset.plot(
            minutes, asked, "x", color=VERMILION, markersize=3.5, label="by firmware and sensor, nothing fitted"
        )
        reading.set(xlabel="Time [min]", ylabel="Counts", title="Potentiometer while driving straight on")
        offset.set(xlabel="Time [min]", ylabel="Left of the line [cm]", title="Offset from the mission")
        reading.legend(loc="lower left")
        offset.legend(loc="upper left")

    return drawn(file, 2.6, 2, draw)


def yaw_rates(t: Array, recorded: Array, models: Mapping[str, Array], file: Path) -> Path:
    """Yaw rate of a held-out piece [rad/s], recorded and predicted, and what is left of it."""

    def draw(axes: Any) -> None:
        rate, rest = axes
        rate.plot(t, np.degrees(recorded), color=DARK_GREY, linewidth=1.8, label="recorded")
        for colour, (name, values) in zip(MODEL_COLOURS, models.items(), strict=False):
            rate.plot(t, np.degrees(values), color=colour, label=name)
            rest.plot(t, np.degrees(values - recorded), color=colour, label=name)
        rate.set(xlabel="Time [s]", ylabel="Yaw rate [deg/s]", title="Yaw rate")
        rest.set(xlabel="Time [s]", ylabel="Model less recording [deg/s]", title="Residual")
        rate.legend()

    return drawn(file, 2.6, 2, draw)


def passes(recorded: Mapping[str, Pass], simulated: Mapping[str, Sequence[Pass]], file: Path) -> Path:
    """Distances from the line: recorded passes as points, those of the twin over seeds as boxes."""

    def draw(axes: Any) -> None:
        for panel, key, title in zip(axes, ("mean", "p95", "left"), ("Mean", "95 %", "To the left"), strict=True):
            groups = [[getattr(p, key) for p in some] for some in simulated.values()]
            panel.boxplot(groups, widths=0.5, whis=(0, 100), medianprops={"color": BLUE})
            for k, speed in enumerate((0.5, 0.85), 1):
                values = [getattr(p, key) for name, p in recorded.items() if name.endswith("85") == (speed > 0.5)]
                panel.plot(np.full(len(values), k), values, "o", color=VERMILION, markersize=4, label="recorded")
            panel.set_xticks(range(1, len(groups) + 1), list(simulated), rotation=20, ha="right")
            panel.set(ylabel="Distance [cm]", title=title)
        axes[0].legend(*(each[:1] for each in axes[0].get_legend_handles_labels()))

    return drawn(file, 2.8, 3, draw)


def turns(found: Sequence[tuple[str, Array, Mapping[str, Array]]], file: Path) -> Path:
    """Keyhole turns: planned, recorded and simulated ways, each (2, n) [m]."""
    styles = {"recorded": (DARK_GREY, 1.8), "replayed": (BLUE, 0.9), "twin under its guidance": (VERMILION, 0.9)}

    def draw(axes: Any) -> None:
        for panel, (title, planned, ways) in zip(axes, found, strict=True):
            panel.plot(*planned, "k:", label="planned")
            for name, way in ways.items():
                colour, width = styles[name]
                panel.plot(*way, color=colour, linewidth=width, label=name)
            panel.set_aspect("equal", adjustable="datalim")
            panel.set(xlabel="East [m]", ylabel="North [m]", title=title)
        axes[0].legend()

    return drawn(file, 3.2, len(found), draw)
