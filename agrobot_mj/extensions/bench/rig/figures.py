"""Figures of measurements on the tyre rig, in the style of the reports: PNG files with one panel per axle.

Forces and slips keep their signs: a lateral force has the opposite sign of its slip angle.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLACK, BLUE, GREEN, ORANGE, SKY_BLUE, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.bench.rig.sweep import CREEP_DEG, LOADS, SPEED_M_S, SPEEDS_M_S
from agrobot_mj.studies.style import PANEL_WIDTH_IN

SHADES = (SKY_BLUE, BLUE, ORANGE, VERMILION, GREEN, BLACK)
WIDTHS = (4.0, 2.8, 1.7, 0.7)  # Line widths of overlapping curves [pt], from the lowest to the uppermost
COLUMNS_OF_LEGEND = 7


def lateral(table: pa.Table) -> Figure:
    """Plot lateral force versus slip angle, with one curve per load."""
    return _by_load(table, "lateral", "fy_n", "lateral force [kN]", 1e-3)


def longitudinal(table: pa.Table) -> Figure:
    """Plot longitudinal force versus slip ratio, with one curve per load."""
    return _by_load(table, "longitudinal", "fx_n", "longitudinal force [kN]", 1e-3)


def aligning(table: pa.Table) -> Figure | None:
    """Plot aligning moment versus slip angle, with one curve per load. Return None for tyres without this moment."""
    if not np.any(_column(_rows(table, test="lateral"), "mz_n_m")):
        return None
    return _by_load(table, "lateral", "mz_n_m", "aligning moment [N m]", 1.0)


def combined(table: pa.Table) -> Figure:
    """Plot lateral versus longitudinal force at several slip angles, with an ellipse through the maximum forces at pure
    slip."""
    figure, grid = _panels(table, height=2.9)
    for axes, axle in grid:
        rows = _rows(table, test="combined", axle=axle)
        swept = _rows(rows, speed_m_s=SPEED_M_S).filter(pc.not_equal(rows["slip_ratio"], 0.0))
        for colour, angle in zip(SHADES, np.unique(_column(swept, "slip_angle_rad")), strict=True):
            curve = _rows(swept, slip_angle_rad=angle)
            x, y = 1e-3 * _column(curve, "fx_n"), 1e-3 * _column(curve, "fy_n")
            axes.plot(x, y, color=colour, label=f"{np.degrees(angle):g} deg", marker=".", markersize=2, linewidth=0.6)
        if _kind(table) != "linear":
            _draw_ellipse(axes, rows)
        axes.set_xlabel("longitudinal force [kN]")
    return _add_legend(figure, grid, "lateral force [kN]")


def step(table: pa.Table) -> Figure | None:
    """Plot the lateral force after a step of the slip angle, divided by its steady value, versus distance, with one
    curve per speed. Return None for tyres without relaxation."""
    if not _rows(table, test="step").num_rows:
        return None
    figure, grid = _panels(table)
    for axes, axle in grid:
        rows = _rows(table, test="step", axle=axle)
        for speed, colour, width in zip(SPEEDS_M_S, SHADES, WIDTHS, strict=False):
            curve = _rows(rows, speed_m_s=speed)
            steady = _steady_force(table, axle, speed, curve)
            share = _column(curve, "fy_n") / steady
            axes.plot(_column(curve, "distance_m"), share, color=colour, linewidth=width, label=f"{speed:g} m/s")
        axes.axhline(1 - np.exp(-1), color="#666666", linestyle="--", linewidth=0.7, label="63 %")
        axes.set(xlabel="distance travelled [m]", ylim=(0, 1.15))
    return _add_legend(figure, grid, "lateral force over steady [-]")


def speed(table: pa.Table) -> Figure:
    """Plot lateral force versus small slip angles at several speeds, for the tyre and for MuJoCo's contact model."""
    own = _kind(table)
    panels = {"contact": "contact"} if own == "contact" else {"lateral": own, "contact": "contact"}
    figure = Figure((PANEL_WIDTH_IN * len(panels), 2.6), layout="constrained")
    grid = list(zip(np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True))
    load = _column(_rows(table, test="contact"), "load_n")[0]
    for axes, test in grid:
        rows = _rows(table, test=test, axle="front", load_n=load)
        slopes = [_draw_creep(axes, rows, *style) for style in zip(SPEEDS_M_S, SHADES, WIDTHS, strict=False)]
        axes.text(0.03, 0.05, "slope at zero [1/rad]:\n" + ", ".join(slopes), transform=axes.transAxes)
        axes.set(title=f"{panels[test]}, front, {load:.0f} N", xlabel="slip angle [deg]")
        axes.set(xlim=(-CREEP_DEG[-1], CREEP_DEG[-1]), ylim=(-1, 1))
    return _add_legend(figure, grid, "lateral force over load [-]")


def hopping(table: pa.Table) -> Figure | None:
    """Plot the fraction of time in which the wheel touches the ground versus slip angle, with one curve per speed.
    Return None if the wheel never leaves the ground."""
    if np.all(_column(_rows(table, test="lateral"), "grounded") == 1.0):
        return None
    figure, grid = _panels(table)
    for axes, axle in grid:
        rows = _rows(table, test="lateral", axle=axle)
        rows = _rows(rows, load_n=_column(_rows(table, test="combined", axle=axle), "load_n")[0])
        for speed, colour in zip(SPEEDS_M_S, SHADES, strict=False):
            curve = _rows(rows, speed_m_s=speed)
            angle = np.degrees(_column(curve, "slip_angle_rad"))
            axes.plot(angle, _column(curve, "grounded"), color=colour, label=f"{speed:g} m/s")
        axes.set(xlabel="slip angle [deg]", ylim=(0, 1.05))
    return _add_legend(figure, grid, "time on the ground [-]")


FIGURES: list[Callable[[pa.Table], Figure | None]] = [lateral, longitudinal, aligning, combined]
FIGURES += [step, speed, hopping]
"""Functions that draw one figure each. The PNG file is named after the function."""


def _by_load(table: pa.Table, test: str, column: str, label: str, scale: float) -> Figure:
    figure, grid = _panels(table)
    for axes, axle in grid:
        rows = _rows(table, test=test, axle=axle, speed_m_s=SPEED_M_S)
        for load, colour, share in zip(np.unique(_column(rows, "load_n")), SHADES, LOADS, strict=False):
            curve = _rows(rows, load_n=load)
            slip = np.degrees(_column(curve, "slip_angle_rad")) if test == "lateral" else _column(curve, "slip_ratio")
            axes.plot(slip, scale * _column(curve, column), color=colour, label=f"{share:g} static load")
        axes.set_xlabel("slip angle [deg]" if test == "lateral" else "slip ratio [-]")
    return _add_legend(figure, grid, label)


def _draw_ellipse(axes: Axes, rows: pa.Table) -> None:
    pure_x, pure_y = _rows(rows, slip_angle_rad=0.0), _rows(rows, slip_ratio=0.0)
    a, b = (1e-3 * np.abs(_column(pure, name)).max() for pure, name in ((pure_x, "fx_n"), (pure_y, "fy_n")))
    angle = np.linspace(-np.pi, 0, 200)
    axes.plot(a * np.cos(angle), b * np.sin(angle), color="#666666", linestyle="--", label="ellipse of the peaks")


def _steady_force(table: pa.Table, axle: str, speed: float, step: pa.Table) -> float:
    """Return the steady lateral force at the slip angle of the step test [N], from the sweep of slip angles."""
    load, angle = (_column(step, name)[0] for name in ("load_n", "slip_angle_rad"))
    rows = _rows(table, test="lateral", axle=axle, speed_m_s=speed, load_n=load)
    nearest = np.abs(_column(rows, "slip_angle_rad") - angle).argmin()
    return float(_column(rows, "fy_n")[nearest])


def _draw_creep(axes: Axes, rows: pa.Table, speed: float, colour: str, width: float) -> str:
    """Plot the lateral force divided by the load versus small slip angles, at one speed. Return the slope of the curve
    at zero slip as text [1/rad]."""
    curve = _rows(rows, speed_m_s=speed)
    angle, force = _column(curve, "slip_angle_rad"), _column(curve, "fy_n") / _column(curve, "load_n")
    axes.plot(np.degrees(angle), force, color=colour, linewidth=width, label=f"{speed:g} m/s")
    first = np.flatnonzero(angle > 0)[0]
    return f"{abs(force[first] / angle[first]):.3g}"


def _panels(table: pa.Table, height: float = 2.6) -> tuple[Figure, list[tuple[Axes, str]]]:
    kind = _kind(table)
    axles = list(dict.fromkeys(_rows(table, tyre=kind)["axle"].to_pylist()))
    figure = Figure((PANEL_WIDTH_IN * len(axles), height), layout="constrained")
    grid = list(zip(figure.subplots(1, len(axles)), axles, strict=True))
    for axes, axle in grid:
        axes.set_title(f"{kind}, {axle}")
    return figure, grid


def _add_legend(figure: Figure, grid: Sequence[tuple[Axes, object]], label: str) -> Figure:
    first = grid[0][0]
    first.set_ylabel(label)
    handles, names = first.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=min(len(names), COLUMNS_OF_LEGEND))
    return figure


def _rows(table: pa.Table, **equal: str | float) -> pa.Table:
    for name, value in equal.items():
        table = table.filter(pc.equal(table[name], value))
    return table


def _kind(table: pa.Table) -> str:
    return str(table["tyre"][0])


def _column(table: pa.Table, name: str) -> Array:
    values: Array = table[name].to_numpy()
    return values
