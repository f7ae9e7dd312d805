"""Where the linear bicycle stops to predict the tractor: steady bends on level ground, at equal speed and steering.

The steady yaw rate and sideslip of the MuJoCo tractor are compared with those of the bicycle, `lateral_dynamics` at
rest. It counts as holding while the yaw rate is within 10 % of the bicycle's, and the sideslip of the CG within 10 % of
l_r gamma / u, its kinematic part (the whole passes through zero). A driver with true values holds speed and angle, so
that no sensor and no law takes part.
"""

from collections.abc import Sequence
from math import atan2, radians
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from estimates import field, mean, ratio, select
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from sweeps import Row

from agrobot_mj.bench.manoeuvres.base import mujoco_plant
from agrobot_mj.bench.manoeuvres.driver import Driver
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.bicycle import Bicycle, BicycleLaw, lateral_dynamics
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE
from agrobot_mj.tyres import Linear, MagicFormula, Soil

LIMIT = 0.10
"""Share by which a prediction may be off [-]."""
SPEEDS_M_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
STEERS_DEG = (2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
TYRES: dict[str, Any] = {
    "linear": Linear(),
    "magic_formula": MagicFormula(),
    "soil, 1800 kPa": Soil(cone_index_kpa=1800),
    "soil, 450 kPa": Soil(cone_index_kpa=450),
}
"""Tyres by name in the figure."""
LATERAL_M_S2 = 4.0
"""Lateral acceleration of the bicycle beyond which nothing is driven; the tractor tips at about 6 [m/s2]."""
REACH_S, MEAN_S = 9.0, 1.0
"""Time in which speed and bend become steady, and over which they are then averaged [s]."""


class SteadyBend(NamedTuple):
    """Steady state in a bend."""

    yaw_rate: float
    """Yaw rate [rad/s]."""
    sideslip: float
    """Angle from the heading to the velocity of the CG, left positive [rad]."""


def predicted(speed: float, steer: float, tractor: TractorParameters, bicycle: Bicycle) -> SteadyBend:
    """Steady state of the bicycle at a speed [m/s] and steering angle [rad]."""
    C_f, C_r = bicycle.front_cornering_stiffness_n_rad, bicycle.rear_cornering_stiffness_n_rad
    m, I_z, l_f, l_r = tractor.mass_kg, tractor.yaw_inertia_kg_m2, tractor.cg_to_front_axle, tractor.cg_to_rear_axle
    p = lateral_dynamics(BicycleLaw(m, I_z, l_f, l_r, C_f, C_r, 1.0, 1.0), speed)
    v, gamma = np.linalg.solve([[p.A11, p.A12], [p.A21, p.A22]], [-p.B1 * steer, -p.B2 * steer])
    return SteadyBend(float(gamma), atan2(v, speed))


JOBS = [(tyre, steer) for tyre in TYRES for steer in STEERS_DEG]
"""Tyre and steering angle [deg] of each drive."""


def validity_drive(job: tuple[str, float]) -> Row:
    """The row of one tyre and steering angle: for every speed, the bend as driven and as predicted."""
    tyre, steer_deg = job
    tractor, bicycle = TractorParameters(), Bicycle()
    steer = radians(steer_deg)
    driver = Driver(*mujoco_plant(TYRES[tyre]))
    bends = []
    for speed in SPEEDS_M_S:
        expected = predicted(speed, steer, tractor, bicycle)
        if abs(expected.yaw_rate) * speed > LATERAL_M_S2:
            break
        driver.speed = speed
        trace = driver.go(REACH_S, steer)
        u, v, gamma = (trace.mean(name, MEAN_S) for name in ("speed", "lateral_speed", "yaw_rate"))
        model = predicted(u, trace.mean("steer", MEAN_S), tractor, bicycle)
        kinematic = tractor.cg_to_rear_axle * model.yaw_rate / u
        errors = {
            "yaw_rate_error": gamma / model.yaw_rate - 1.0,
            "sideslip_error": (atan2(v, u) - model[1]) / kinematic,
        }
        bends.append({"speed": speed, "lateral_m_s2": u * gamma, **errors})
    return {"tyre": tyre, "steer_deg": steer_deg, "bends": bends}


def validity_table(drives: Sequence[Row]) -> str:
    """Markdown table: for each tyre and steering angle, the speeds at which both predictions are within the limit."""
    rows = [
        (tyre, *(_range(found[0]) if (found := select(drives, tyre=tyre, steer_deg=s)) else "-" for s in STEERS_DEG))
        for tyre in TYRES
    ]
    return markdown_table(("tyre", *(f"{steer:g} deg" for steer in STEERS_DEG)), rows)


def _range(row: Row) -> str:
    """Range of speeds within the limit, as text."""
    good = [b["speed"] for b in row["bends"] if max(abs(b["yaw_rate_error"]), abs(b["sideslip_error"])) <= LIMIT]
    return f"{good[0]:g}-{good[-1]:g}" if good else "none"


def validity_figure(rows: Sequence[Row]) -> Figure:
    """Error of the predicted yaw rate over speed and steering angle, with the boundaries at which each leaves 10 %."""
    with mpl.rc_context(STYLE):
        figure = Figure((2 * PANEL_WIDTH_IN, 5.0), layout="constrained")
        grid = figure.subplots(2, 2, sharex=True, sharey=True)
        for axes, tyre in zip(grid.flat, TYRES, strict=True):
            image = _boundary(axes, tyre, select(rows, tyre=tyre))
        for axes in grid[-1]:
            axes.set_xlabel("speed [m/s]")
        for axes in grid[:, 0]:
            axes.set_ylabel("steering angle [deg]")
        figure.colorbar(image, ax=grid, label="yaw rate, MuJoCo over bicycle less 1 [%]", shrink=0.8)
        lines = [Line2D([], [], color="black", label="yaw rate leaves 10 %")]
        lines.append(Line2D([], [], color="black", linestyle="--", label="sideslip leaves 10 %"))
        figure.legend(handles=lines, loc="outside upper center", ncols=2)
        return figure


def _boundary(axes: Axes, tyre: str, rows: Sequence[Row]) -> QuadMesh:
    """One tyre: the error as colour, both boundaries as lines; white where nothing is driven."""
    errors = {
        name: np.full((len(STEERS_DEG), len(SPEEDS_M_S)), np.nan) for name in ("yaw_rate_error", "sideslip_error")
    }
    for row in rows:
        for k, bend in enumerate(row["bends"]):
            for name, grid in errors.items():
                grid[STEERS_DEG.index(row["steer_deg"]), k] = 100 * bend[name]
    image = axes.pcolormesh(
        SPEEDS_M_S, STEERS_DEG, errors["yaw_rate_error"], cmap="RdBu_r", vmin=-25, vmax=25, shading="gouraud"
    )
    for grid, style in zip(errors.values(), ("solid", "dashed"), strict=True):
        axes.contour(
            SPEEDS_M_S, STEERS_DEG, np.abs(grid), levels=[100 * LIMIT], colors="black", linestyles=style, linewidths=1.2
        )
    axes.set(title=tyre, ylim=(STEERS_DEG[0], STEERS_DEG[-1]))
    axes.grid(visible=False)
    return image


def closed_loop_table(rows: Sequence[Row]) -> str:
    """Markdown table: cross-track rms of each law on the bicycle and on MuJoCo, level, and their ratio [cm, -].

    `rows` are those of the sweep `results`, of which the paper's estimator counts.
    """
    xte, lines = field("xte_rms"), []
    for law in dict.fromkeys(row["variant"] for row in rows):
        of = {"estimator": '{"kind": "ekf"}', "variant": law}
        bicycle, mujoco = (select(rows, plant=f'{{"kind": "{kind}"}}', **of) for kind in ("bicycle", "mujoco"))
        if bicycle and mujoco:
            means = [mean(runs, xte).short(1, 100) for runs in (bicycle, mujoco)]
            lines.append((law, *means, ratio(mujoco, bicycle, xte).text()))
    return markdown_table(("law", "bicycle [cm]", "MuJoCo [cm]", "MuJoCo over bicycle"), lines, 1)
