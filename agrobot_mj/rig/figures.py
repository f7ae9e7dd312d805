"""Figures of the rig's table, in the style of the reports. Forces and slips keep their signs: a force opposes its slip."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from agrobot_mj.report import DPI, PANEL_WIDTH_IN, STYLE
from agrobot_mj.rig.sweep import LOADS, SPEED_M_S, SPEEDS_M_S
from agrobot_mj.signals import Array
from agrobot_mj.storage import whole

SHADES = ("#56B4E9", "#0072B2", "#E69F00", "#D55E00", "#009E73", "#000000")
"""Of curves in order, of the colour-blind-safe palette of Okabe and Ito."""
WIDTHS = (4.0, 2.8, 1.7, 0.7)
"""Of curves that lie on each other, the first at the bottom [pt]."""
CREEP_DEG, CREEP_ROOM = 1.5, 1.12
"""Slip angles shown beside `contact` [deg], and the height of the panel over its largest force [-]."""
COLUMNS_OF_LEGEND = 4


def write_figures(table: pa.Table, folder: Path) -> list[Path]:
    """Draw the figures of a table of `sweep.sweep` into `folder`; return the files."""
    with mpl.rc_context(STYLE):
        drawn = {draw.__name__: draw(table) for draw in FIGURES}
        return [_write(figure, folder / f"{name}.png") for name, figure in drawn.items() if figure is not None]


def lateral(table: pa.Table) -> Figure:
    """Lateral force over slip angle, a curve a load."""
    return _by_load(table, "lateral", "fy_n", "lateral force [kN]", 1e-3)


def longitudinal(table: pa.Table) -> Figure:
    """Longitudinal force over slip ratio, a curve a load."""
    return _by_load(table, "longitudinal", "fx_n", "longitudinal force [kN]", 1e-3)


def aligning(table: pa.Table) -> Figure | None:
    """Aligning moment over slip angle, a curve a load; of tyres that have one."""
    if not np.any(_column(_rows(table, test="lateral"), "mz_n_m")):
        return None
    return _by_load(table, "lateral", "mz_n_m", "aligning moment [N m]", 1.0)


def combined(table: pa.Table) -> Figure:
    """Lateral over longitudinal force at several slip angles, and the ellipse of both pure peaks."""
    figure, grid = _panels(table, height=2.9)
    for axes, axle in grid:
        rows = _rows(table, test="combined", axle=axle)
        swept = _rows(rows, speed_m_s=SPEED_M_S).filter(pc.not_equal(rows["slip_ratio"], 0.0))
        for colour, angle in zip(SHADES, np.unique(_column(swept, "slip_angle_rad")), strict=True):
            curve = _rows(swept, slip_angle_rad=angle)
            x, y = 1e-3 * _column(curve, "fx_n"), 1e-3 * _column(curve, "fy_n")
            axes.plot(x, y, color=colour, label=f"{np.degrees(angle):g} deg", marker=".", markersize=2, linewidth=0.6)
        if "linear" not in table["tyre"].to_pylist():
            _draw_ellipse(axes, rows)
        axes.set_xlabel("longitudinal force [kN]")
    return _finished(figure, grid, "lateral force [kN]")


def step(table: pa.Table) -> Figure:
    """Share of the steady lateral force over the distance travelled since a step in slip angle, a curve a speed."""
    figure, grid = _panels(table)
    for axes, axle in grid:
        rows = _rows(table, test="step", axle=axle)
        for (speed, width), colour in zip(zip(SPEEDS_M_S, WIDTHS, strict=True), SHADES, strict=False):
            curve = _rows(rows, speed_m_s=speed)
            force = _column(curve, "fy_n")
            share = force / force[-len(force) // 4 :].mean()
            axes.plot(_column(curve, "distance_m"), share, color=colour, linewidth=width, label=f"{speed:g} m/s")
        axes.axhline(1 - np.exp(-1), color="#666666", linestyle="--", linewidth=0.7, label="63 %")
        axes.set(xlabel="distance travelled [m]", ylim=(0, 1.15))
    return _finished(figure, grid, "lateral force over steady [-]")


def speed(table: pa.Table) -> Figure:
    """Lateral force over a small slip angle at several speeds: a tyre's own law beside MuJoCo's contact."""
    own = table["tyre"][0].as_py()
    sources = [("contact", "contact")] if own == "contact" else [("lateral", own), ("contact", "contact")]
    figure = Figure((PANEL_WIDTH_IN * 2, 2.6), layout="constrained")
    grid = list(zip(np.atleast_1d(figure.subplots(1, len(sources), sharey=True)), sources, strict=True))
    highest = 0.0
    for axes, (test, kind) in grid:
        rows = _rows(table, test=test, axle="front")
        static = _column(_rows(table, test="contact"), "load_n")[0]
        rows = _rows(rows, load_n=static)
        for (speed_m_s, width), colour in zip(zip(SPEEDS_M_S, WIDTHS, strict=True), SHADES, strict=False):
            curve = _rows(rows, speed_m_s=speed_m_s)
            angle, force = np.degrees(_column(curve, "slip_angle_rad")), _column(curve, "fy_n") / static
            near = np.abs(angle) <= CREEP_DEG
            highest = max(highest, float(np.abs(force[near]).max()))
            axes.plot(angle[near], force[near], color=colour, linewidth=width, label=f"{speed_m_s:g} m/s")
        axes.set(title=f"{kind}, front, {static:.0f} N", xlabel="slip angle [deg]")
        axes.set_ylim(-CREEP_ROOM * highest, CREEP_ROOM * highest)
    return _finished(figure, grid, "lateral force over load [-]")


FIGURES: list[Callable[[pa.Table], Figure | None]] = [lateral, longitudinal, aligning, combined, step, speed]
"""Each draws one figure, a PNG of its name."""

Panels = Sequence[tuple[Axes, object]]


def _by_load(table: pa.Table, test: str, column: str, label: str, scale: float) -> Figure:
    figure, grid = _panels(table)
    for axes, axle in grid:
        rows = _rows(table, test=test, axle=axle, speed_m_s=SPEED_M_S)
        for (x, y, _), colour, share in zip(_curves(rows, test, column), SHADES, LOADS, strict=False):
            axes.plot(x, scale * y, color=colour, label=f"{share:g} static load")
        axes.set_xlabel("slip angle [deg]" if test == "lateral" else "slip ratio [-]")
    return _finished(figure, grid, label)


def _curves(rows: pa.Table, test: str, column: str) -> Iterator[tuple[Array, Array, float]]:
    """(slip, value, load) of each load, in order."""
    for load in np.unique(_column(rows, "load_n")):
        curve = _rows(rows, load_n=load)
        slip = np.degrees(_column(curve, "slip_angle_rad")) if test == "lateral" else _column(curve, "slip_ratio")
        yield slip, _column(curve, column), float(load)


def _draw_ellipse(axes: Axes, rows: pa.Table) -> None:
    pure_x, pure_y = _rows(rows, slip_angle_rad=0.0), _rows(rows, slip_ratio=0.0)
    a, b = (1e-3 * np.abs(_column(pure, name)).max() for pure, name in ((pure_x, "fx_n"), (pure_y, "fy_n")))
    angle = np.linspace(-np.pi / 2 * 2, 0, 200)
    axes.plot(a * np.cos(angle), b * np.sin(angle), color="#666666", linestyle="--", label="ellipse of the peaks")


def _panels(table: pa.Table, height: float = 2.6) -> tuple[Figure, list[tuple[Axes, str]]]:
    """A figure of one panel an axle."""
    kind = table["tyre"][0].as_py()
    axles = list(dict.fromkeys(_rows(table, tyre=kind)["axle"].to_pylist()))
    figure = Figure((PANEL_WIDTH_IN * len(axles), height), layout="constrained")
    grid = list(zip(figure.subplots(1, len(axles)), axles, strict=True))
    for axes, axle in grid:
        axes.set_title(f"{kind}, {axle}, {SPEED_M_S:g} m/s" if height < 0 else f"{kind}, {axle}")
    return figure, grid


def _finished(figure: Figure, grid: Panels, label: str) -> Figure:
    """Label the ordinate and add the first panel's legend."""
    first = grid[0][0]
    first.set_ylabel(label)
    handles, names = first.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=min(len(names), COLUMNS_OF_LEGEND))
    return figure


def _rows(table: pa.Table, **equal: str | float) -> pa.Table:
    """The rows whose columns have these values."""
    for name, value in equal.items():
        table = table.filter(pc.equal(table[name], value))
    return table


def _column(table: pa.Table, name: str) -> Array:
    values: Array = table[name].to_numpy()
    return values


def _write(figure: Figure, file: Path) -> Path:
    """Save as PNG: the whole file or none."""
    with whole(file) as temporary:
        FigureCanvasAgg(figure).print_figure(temporary, format="png", dpi=DPI)
    return file
