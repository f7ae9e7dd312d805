"""Figures of a comparison, similar to the figures of the paper.

There is one run per plant and law. Each figure is a PNG with one column of panels per plant. A law has the same colour
in all figures. Signals that do not exist for a law, such as a yaw-rate error, are omitted. Errors are position minus
reference: positive to the left of the path and ahead of the reference. (The log contains reference minus position, as
in the paper.) A cross marks the end of a failed run.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from agrobot_mj.core.palette import BLUE, DARK_GREY, LIGHT_GREY, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.core.smoothing import moving_mean
from agrobot_mj.metrics import LogLike
from agrobot_mj.paths import sample
from agrobot_mj.studies import style
from agrobot_mj.studies.style import COLOURS, PANEL_WIDTH_IN, SPARE_COLOURS, law_name

SMOOTHING_S = 1.0  # Window length of the moving average of noisy signals [s]
PATH_STEP_M, MOST_PATH_POINTS = 0.25, 20_000
"""Point distance of a drawn path [m], and maximum number of points [-]."""
KEY_IN, LETTER_IN = 0.45, 0.058  # Width of a legend entry without its text, and mean width of a letter of 8 pt [in]
ZOOM_M = (6.0, 3.0)  # Width and height of the enlarged part of the trajectory [m]
LOST = {"[m]": 5.0, "[rad/s]": 1.5, "[deg]": 50.0}
"""Maximum plotted values by axis unit. Curves that exceed these values do not affect the common axis range."""


class ReportedRun(NamedTuple):
    """Run that is drawn in the figures of a comparison."""

    plant: str
    law: str  # Name of the law: a yaw controller, a guidance law, or a variant
    log: LogLike
    failed: bool = False

    @property
    def name(self) -> str:
        """Name of the law in legends. "$" is escaped, and a space precedes a leading "_", which matplotlib would
        hide."""
        name = law_name(self.law).replace("$", r"\$")
        return f" {name}" if name.startswith("_") else name


Runs = Sequence[ReportedRun]


def write_figures(runs: Runs, folder: Path) -> list[Path]:
    """Draw all figures for which the runs contain data, write them to `folder`, and return the files."""
    return style.write_figures(folder, FIGURES, runs) if runs else []


def trajectory(runs: Runs) -> Figure:
    """Draw the reference and the tracks, with one column per plant. The lower row enlarges the region of maximum
    errors.

    The reference is thin and dashed. Tracks are dotted in the first lap, then solid.
    """
    plants, (low, high), zoom = _plants(runs), _extent(runs[0]), np.array(ZOOM_M)
    heights = PANEL_WIDTH_IN * (high - low)[1] / (high - low)[0], PANEL_WIDTH_IN * zoom[1] / zoom[0]
    figure = Figure((PANEL_WIDTH_IN * len(plants), sum(heights) + 1.25), layout="constrained")
    grid = figure.subplots(2, len(plants), sharex="row", sharey="row", squeeze=False, height_ratios=heights)
    corner = np.clip(_worst_place(runs) - zoom / 2, low, high - zoom)
    for axes, start, size in ((grid[0], low, high - low), (grid[1], corner, zoom)):
        for panel, plant in zip(axes, plants, strict=True):
            _draw_tracks(panel, runs, plant)
            (left, bottom), (right, top) = start, start + size
            panel.set(aspect="equal", xlim=(left, right), ylim=(bottom, top))
    for overview, plant in zip(grid[0], plants, strict=True):
        overview.set_title(plant)
        overview.indicate_inset((*corner, *zoom), edgecolor="black", alpha=1, linewidth=0.6)
    _label(grid, "x [m]", "y [m]")
    turns = [_key("first turn", DARK_GREY, ":"), _key("later turns", DARK_GREY)]
    several = len(runs[0].log.scenario.path.turns_s) > 1
    _legend(figure, [_key("reference", "black", "--", 0.5), *(turns if several else []), *_keys(runs), *_crosses(runs)])
    return figure


def longitudinal_error(runs: Runs) -> Figure:
    """Draw the longitudinal error over time, with one panel per plant."""
    return _error(runs, "e_longitudinal", "longitudinal error, ahead + [m]")


def lateral_error(runs: Runs) -> Figure:
    """Draw the lateral error over time, with one panel per plant."""
    return _error(runs, "e_lateral", "lateral error, left + [m]")


def control_signals(runs: Runs) -> Figure:
    """Draw the components and the sum of the steering command, with one row per law.

    Plain PD laws are omitted if other laws exist.
    """
    parts = {
        "steering reference": ("steer_ref", 1, "black"),
        "PD $\\tau_c$": ("tau_c", 1, VERMILION),
        "network $-\\tau_n$": ("tau_n", -1, BLUE),
    }

    def draw(axes: Axes, run: ReportedRun) -> None:
        for column, sign, colour in parts.values():
            if _has(run, column):
                _draw_noisy(axes, run.log.column("t"), sign * np.degrees(run.log.column(column)), colour)

    shown = [run for run in runs if _has(run, "tau_n") or not _has(run, "tau_c")]
    for name in [name for name, (column, _, _) in parts.items() if not any(_has(run, column) for run in shown or runs)]:
        del parts[name]
    keys = [_key(name, colour) for name, (_, _, colour) in parts.items()]
    return _panels(shown or runs, draw, "steering [deg]", [*keys, _raw_key()])


def yaw_rate_error(runs: Runs) -> Figure | None:
    """Draw the yaw-rate error over time, with one row per law that uses a yaw-rate reference."""

    def draw(axes: Axes, run: ReportedRun) -> None:
        _draw_noisy(axes, run.log.column("t"), run.log.column("e_yaw_rate"), _colour(runs, run.law))

    following = [run for run in runs if np.isfinite(run.log.column("e_yaw_rate")).any()]
    return _panels(following, draw, "yaw rate error\n[rad/s]", [_raw_key()]) if following else None


def q(runs: Runs) -> Figure | None:
    """Draw the network parameter q over time, with one row per law whose network has this parameter."""

    def draw(axes: Axes, run: ReportedRun) -> None:
        axes.plot(run.log.column("t"), run.log.column("q"), color=_colour(runs, run.law))
        axes.set_ylim(-0.05, 1.05)

    with_q = [run for run in runs if np.isfinite(run.log.column("q")).any()]
    return _panels(with_q, draw, "q [-]", []) if with_q else None


FIGURES: list[Callable[[Runs], Figure | None]] = [trajectory, longitudinal_error, lateral_error]
FIGURES += [control_signals, yaw_rate_error, q]
"""Functions that draw one figure each. The name of the function is the name of the PNG file."""


def _error(runs: Runs, column: str, label: str) -> Figure:

    def draw(axes: Axes, run: ReportedRun) -> None:
        t, values = run.log.column("t"), -run.log.column(column)
        axes.plot(t, values, color=_colour(runs, run.law))
        _mark_end(axes, runs, run, t, values)

    return _panels(runs, draw, label, [*_keys(runs), *_crosses(runs)], rows=False)


def _panels(
    runs: Runs, draw: Callable[[Axes, ReportedRun], None], label: str, keys: list[Line2D], rows: bool = True
) -> Figure:
    plants, laws = _plants(runs), list(dict.fromkeys(run.law for run in runs)) if rows else [""]
    height = 1.45 * len(laws) + 0.7 if rows else 2.6
    figure = Figure((PANEL_WIDTH_IN * len(plants), height), layout="constrained")
    grid = figure.subplots(len(laws), len(plants), sharex=True, sharey=True, squeeze=False)
    for run in runs:
        axes = grid[laws.index(run.law) if rows else 0, plants.index(run.plant)]
        draw(axes, run)
        axes.set_title(f"{run.plant}: {run.name}" if rows else run.plant)
    _finish(figure, grid, runs, label, keys)
    return figure


def _finish(figure: Figure, grid: Any, runs: Runs, label: str, keys: list[Line2D]) -> None:
    _leave_out_lost(grid, next((limit for unit, limit in LOST.items() if unit in label), np.inf))
    ends = [end for _, end in runs[0].log.scenario.path.turns_s[:-1]][:10]
    for axes in grid.flat:
        for end in ends:
            axes.axvline(end, color=DARK_GREY, linestyle="--", linewidth=0.7)
    _label(grid, "time [s]", label)
    _legend(figure, [*keys, *([_key("end of a turn", DARK_GREY, "--", 0.7)] if ends else [])])


def _leave_out_lost(grid: Any, limit: float) -> None:
    """Fit the common y axis to the curves within +-`limit`, if some but not all curves are within this range."""
    values = [np.asarray(line.get_ydata(), dtype=float) for axes in grid.flat for line in axes.lines]
    curves = [finite for finite in (curve[np.isfinite(curve)] for curve in values) if finite.size]
    kept = [curve for curve in curves if np.abs(curve).max() <= limit]
    if 0 < len(kept) < len(curves):
        low, high = min(map(min, kept)), max(map(max, kept))
        room = 0.05 * (high - low)
        grid[0, 0].set_ylim(low - room, high + room)


def _label(grid: Any, x: str, y: str) -> None:
    for axes in grid[-1]:
        axes.set_xlabel(x)
    for axes in grid[:, 0]:
        axes.set_ylabel(y)


def _legend(figure: Figure, keys: list[Line2D]) -> None:
    if not keys:
        return
    most = 2 if figure.get_figwidth() <= PANEL_WIDTH_IN else 5 if len(keys) <= 5 else 4
    widths = [KEY_IN + LETTER_IN * len(str(key.get_label())) for key in keys]
    columns = next((n for n in range(most, 1, -1) if _width(widths, n) <= figure.get_figwidth()), 1)
    figure.legend(handles=keys, loc="outside upper center", ncols=columns)


def _width(widths: Sequence[float], columns: int) -> float:
    rows = -(-len(widths) // columns)
    return sum(max(widths[first : first + rows]) for first in range(0, len(widths), rows))


def _has(run: ReportedRun, column: str) -> bool:
    return bool(np.nan_to_num(run.log.column(column)).any())


def _key(name: str, colour: str, style: Literal["-", "--", ":"] = "-", width: float = 0.9) -> Line2D:
    return Line2D([], [], label=name, color=colour, linestyle=style, linewidth=width)


def _raw_key() -> Line2D:
    return _key(f"pale: raw, bold: {SMOOTHING_S:g} s mean", LIGHT_GREY, width=2.0)


def _keys(runs: Runs) -> list[Line2D]:
    names = {run.law: run.name for run in runs}
    return [_key(name, _colour(runs, law)) for law, name in names.items()]


def _crosses(runs: Runs) -> list[Line2D]:
    if not any(run.failed for run in runs):
        return []
    return [Line2D([], [], label="failed", color="black", marker="x", markersize=5, linestyle="")]


def _mark_end(axes: Axes, runs: Runs, run: ReportedRun, x: Array, y: Array) -> None:
    if run.failed and len(x):
        axes.scatter(x[-1:], y[-1:], marker="x", s=25, color=_colour(runs, run.law), zorder=3)


def _colour(runs: Runs, law: str) -> str:
    """Return the colour of a law: its assigned colour, or the next spare colour."""
    others = list(dict.fromkeys(run.law for run in runs if run.law not in COLOURS))
    used = {COLOURS[run.law] for run in runs if run.law in COLOURS}
    free = [*SPARE_COLOURS, *(colour for colour in COLOURS.values() if colour not in used)]
    return COLOURS.get(law) or free[others.index(law) % len(free)]


def _plants(runs: Runs) -> list[str]:
    return list(dict.fromkeys(run.plant for run in runs))


def _draw_tracks(axes: Axes, runs: Runs, plant: str) -> None:
    path = runs[0].log.scenario.path
    first_end = path.turns_s[0][1] if len(path.turns_s) > 1 else -np.inf
    for run in (run for run in runs if run.plant == plant):
        t, x, y = (run.log.column(name) for name in ("t", "x", "y"))
        for rows, dashes in ((t > first_end, "-"), (t <= first_end, ":")):
            axes.plot(x[rows], y[rows], color=_colour(runs, run.law), linestyle=dashes)
        _mark_end(axes, runs, run, x, y)
    paths = [run.log.scenario.path for run in runs]
    for path in (path for k, path in enumerate(paths) if path not in paths[:k]):
        start, end = path.turns_s[0]
        count = int(np.clip((end - start) * path.speed_m_s / PATH_STEP_M, 2, MOST_PATH_POINTS))
        axes.plot(
            *sample(path, np.linspace(start, end, count)).T, color="black", linestyle="--", linewidth=0.5, zorder=1
        )


def _draw_noisy(axes: Axes, t: Array, values: Array, colour: str) -> None:
    axes.plot(t, values, color=colour, alpha=0.3, linewidth=0.4)
    axes.plot(t, _smooth(t, values), color=colour)


def _smooth(t: Array, values: Array) -> Array:
    return values if len(t) < 2 else moving_mean(values, round(SMOOTHING_S / (t[1] - t[0])))


def _extent(run: ReportedRun) -> tuple[Array, Array]:
    """Return two opposite corners of the plotted area [m]: the path with a margin. The area is not higher than wide."""
    path = run.log.scenario.path
    points = sample(path, np.linspace(*path.turns_s[0], 500))
    low, high = points.min(axis=0), points.max(axis=0)
    half = np.maximum((high - low) / 2 + 2.0, max((high - low).max() / 10, max(ZOOM_M) / 2))
    half[0] = max(half)
    return (low + high) / 2 - half, (low + high) / 2 + half


def _worst_place(runs: Runs) -> Array:
    """Return the path point [m] at which the lateral errors of all runs, limited to 1 m each, have the largest sum."""
    longest = max((run.log for run in runs), key=lambda log: len(log.column("t")))
    t = np.append(longest.column("t"), 0.0)
    total = np.zeros(len(t))
    for run in runs:
        error = run.log.column("e_lateral")
        total[: len(error)] += np.nan_to_num(np.minimum(np.abs(error), 1.0))
    place: Array = sample(longest.scenario.path, t[[total.argmax()]])[0]
    return place
