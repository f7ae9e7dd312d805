"""Simulate every shipped scenario with the PD controller and with the network, and write docs/reference/library.md.

Each scenario has a figure (map and lateral error) and the description in its file. Scenarios without a yaw controller,
such as open-loop scenarios, are simulated with their own guidance.
"""

import argparse
import itertools
from pathlib import Path

import matplotlib as mpl
import numpy as np
from blocks import DOCS, page, put
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LightSource, ListedColormap
from matplotlib.figure import Figure

from agrobot_mj import load_scenario
from agrobot_mj.control.kinematic import CascadeLaw
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.passes import LABEL
from agrobot_mj.paths import sample
from agrobot_mj.scenario import Scenario, scenario_files
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import atomic
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.pages.drive import enlarge, enlargement, implement_of, magnification_text
from agrobot_mj.studies.style import COLOURS, STYLE, law_name
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.grid import heights

IMAGES = DOCS / "images" / "scenarios"
CONTROLLERS = ("pd", "pd_t2fnn")
MARGIN_M, PIXELS = 6.0, 260
SIGNALS, BARS = ("x", "y", "x_ref", "y_ref", "implement_x", "implement_y"), 30
"""Log columns for a map, and number of lines that connect the tracks of tractor and implement."""
GREEN, WET, SOFT = "#7E9A5B", "#5B8FB9", "#7A5230"
SIZE_IN, DPI = (9.0, 3.1), 110
INDEX_HEADS = ("name", "title", "ends", "lateral p95 [m]")
PASS_HEADS = (LABEL, "pass to pass, p95 [m]", "on the passes, p95 [m]")
IMPLEMENT_HEADS = ("implement", "rms [m]", "p95 [m]", "mean, left + [cm]", "pull [kN]", "hitch angle, p95 [deg]")


def runs_of(scenario: Scenario) -> dict[str, Log]:
    if not isinstance(scenario.guidance, CascadeLaw):
        return {scenario.guidance.kind: run(scenario)}  # the law has no yaw controller
    kinds = CONTROLLERS if scenario.controller.kind in CONTROLLERS else (scenario.controller.kind,)
    return {kind: run(scenario.changed({"controller.kind": kind})) for kind in kinds}


def shows(name: str) -> str:
    """Return the first sentence of the initial comment in a scenario file."""
    lines = scenario_files()[name].read_text(encoding="utf-8").splitlines()
    head = itertools.takewhile(lambda line: line.startswith("#"), lines)
    text = " ".join(line.lstrip("# ").rstrip() for line in head).partition("Look at: ")[0].rstrip()
    return text.partition(". ")[0].removesuffix(".") + "."


def picture(scenario: Scenario, logs: dict[str, Log], file: Path) -> None:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE_IN, layout="constrained")
        FigureCanvasAgg(figure)
        place, error = figure.subplots(1, 2, width_ratios=[1.15, 1])
        draw_map(place, scenario, logs)
        draw_error(error, scenario, logs)
        with atomic(file) as path:
            figure.savefig(path, dpi=DPI, format="png")


def draw_map(axes: Axes, scenario: Scenario, logs: dict[str, Log]) -> None:
    """Draw a map of ground, path and tracks. Tracks of implements are dashed and connected to the tracks of their
    tractors."""
    longest = max(logs.values(), key=lambda log: log.column("t")[-1])
    path = sample(scenario.path, longest.column("t"))
    signals = {
        kind: {name: log.column(name) for name in SIGNALS if name in log.rows.columns} for kind, log in logs.items()
    }
    times = enlargement(signals.values())
    tracks = {
        kind: [np.stack(enlarge(s, times), 1) for s in (own, implement_of(own)) if s] for kind, own in signals.items()
    }
    points = np.concatenate([path, *itertools.chain(*tracks.values())])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    short = np.maximum(0.45 * (high - low).max() - (high - low), 0) / 2
    paint_ground(axes, scenario.terrain.ground(), low - short, high + short)
    axes.plot(*path.T, color="white", lw=0.8, ls="--", label="path")
    for kind, (track, *implement) in tracks.items():
        colour = COLOURS.get(kind, "black")
        axes.plot(*track.T, color=colour, label=law_name(kind))
        axes.plot(*track[-1], "o", ms=3, color=colour)
        for drawn in implement:
            axes.plot(*drawn.T, color=colour, ls="--", label=f"{law_name(kind)}: implement")
            some = np.linspace(0, len(track) - 1, BARS).astype(int)
            axes.plot(*np.stack([track[some], drawn[some]]).transpose(2, 0, 1), color=colour, lw=0.6)
    (x_min, y_min), (x_max, y_max) = low - short, high + short
    axes.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", xlim=(x_min, x_max), ylim=(y_min, y_max))
    axes.set_title(magnification_text(times).removeprefix(", "))
    axes.grid(visible=False)


def paint_ground(axes: Axes, ground: Ground, low: np.ndarray, high: np.ndarray) -> None:
    """Draw a shaded relief with contour lines and with patches of wet and soft ground."""
    pixel = (high - low).max() / PIXELS
    x, y = np.arange(low[0], high[0], pixel), np.arange(low[1], high[1], pixel)
    X, Y = np.meshgrid(x, y)
    z = heights(ground, X, Y)
    shade = LightSource(azdeg=315, altdeg=40).hillshade(z, vert_exag=1.0, dx=pixel, dy=pixel)
    colour = np.array(mpl.colors.to_rgb(GREEN)) * (0.55 + 0.6 * shade[..., None])
    box = (low[0], high[0], low[1], high[1])
    axes.imshow(np.clip(colour, 0, 1), extent=box, origin="lower", interpolation="bilinear")
    surface = ground.surface
    if surface.friction.size:
        rows, columns = surface.friction.shape
        extent = (surface.x0, surface.x0 + columns * surface.spacing, surface.y0, surface.y0 + rows * surface.spacing)
        for mask, tint in ((surface.friction < 1, WET), (surface.cone_index > 0, SOFT)):
            shown = np.ma.masked_where(~mask, np.ones(mask.shape))
            axes.imshow(shown, extent=extent, origin="lower", cmap=ListedColormap([tint]), alpha=0.55)
    if np.ptp(z) > 1.0:
        lines = axes.contour(X, Y, z, levels=6, colors="#2F3B1E", linewidths=0.4)
        axes.clabel(lines, fmt="%g m", fontsize=6)


def draw_error(axes: Axes, scenario: Scenario, logs: dict[str, Log]) -> None:
    end = max(log.column("t")[-1] for log in logs.values())
    for k, fault in enumerate(scenario.fault):
        window = (fault.start_s, end if fault.end_s is None else fault.end_s)
        axes.axvspan(*window, color="#CCCCCC", alpha=0.6, lw=0, label=fault.kind.replace("_", " ") if k < 3 else None)
    for kind, log in logs.items():
        error = -100 * log.column("e_lateral")
        axes.plot(log.column("t"), error, color=COLOURS.get(kind, "black"), label=law_name(kind))
    axes.set(xlabel="time [s]", ylabel="lateral error, left + [cm]", xlim=(0, end))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=4, fontsize=7)


def section(name: str, logs: dict[str, Log]) -> str:
    picture = f"![Map and lateral error of {name}](../images/scenarios/{name}.png)"
    return "\n".join([f"## `{name}`", "", shows(name), "", picture, *passes(logs), *implements(logs), ""])


def passes(logs: dict[str, Log]) -> list[str]:
    """Return the lines of a table with errors on the passes of a field, or an empty list without passes."""
    found = {kind: log.metrics.get("iso_12188_2_style") for kind, log in logs.items()}
    rows = [
        (law_name(kind), f"{m['pass_to_pass_p95_m']:.3f}", f"{m['pass_xte_abs_p95_m']:.3f}")
        for kind, m in found.items()
        if m is not None
    ]
    return with_heads(PASS_HEADS, rows)


def implements(logs: dict[str, Log]) -> list[str]:
    """Return the lines of a table with implement errors relative to the path, or an empty list without implements."""
    rows = [
        (
            *(law_name(kind), f"{m['implement_xte_rms']:.3f}", f"{m['implement_xte_abs_p95']:.3f}"),
            *(f"{100 * m['implement_xte_mean']:+.1f}", f"{m['hitch_pull_mean'] / 1e3:.2f}"),
            f"{np.degrees(m['hitch_angle_abs_p95']):.1f}" if m["hitch_angle_abs_p95"] else "-",
        )
        for kind, m in ((kind, log.metrics) for kind, log in logs.items())
        if m.get("implement_xte_rms") is not None
    ]
    return with_heads(IMPLEMENT_HEADS, rows)


def with_heads(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Return an empty line and a table with the headings `heads`, or an empty list without rows."""
    return ["", markdown_table(heads, rows)] if rows else []


def line(name: str, scenario: Scenario, logs: dict[str, Log]) -> tuple[str, ...]:
    found = [(law_name(kind), log.metrics["lateral_abs_p95"]) for kind, log in logs.items()]
    errors = ", ".join(f"{law} {p95:.2f}" for law, p95 in found if p95 is not None)
    return f"[`{name}`](#{name})", scenario.title, scenario.expected_outcome.replace("_", " "), errors or "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="scenarios to draw; the page is not changed")
    chosen = parser.parse_args().names
    names = chosen or list(scenario_files())
    IMAGES.mkdir(parents=True, exist_ok=True)
    sections, index = [], []
    with tally(f"{len(names)} scenarios", len(names)) as advance:
        for name in names:
            scenario = load_scenario(name)
            logs = runs_of(scenario)
            picture(scenario, logs, IMAGES / f"{name}.png")
            sections.append(section(name, logs))
            index.append(line(name, scenario, logs))
            advance()
    if chosen:
        print("\n".join(sections))
        return
    text = page("library").read_text(encoding="utf-8")
    for name, content in (("index", markdown_table(INDEX_HEADS, index)), ("pages", "\n".join(sections).rstrip())):
        text = put(text, name, f"\n{content}\n")
    page("library").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
