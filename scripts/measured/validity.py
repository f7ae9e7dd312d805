"""Where the linear bicycle stops to predict the tractor: steady bends on level ground, at equal speed and steering.

The steady yaw rate and sideslip of the MuJoCo tractor are compared with those of the bicycle, `lateral_dynamics` at
rest. It counts as holding while the yaw rate is within 10 % of the bicycle's, and the sideslip of the CG within 10 % of
l_r gamma / u, its kinematic part (the whole passes through zero). A driver with true values holds speed and angle, so
that no sensor and no law takes part.
"""

from collections.abc import Sequence
from math import atan2, radians
from typing import Any, NamedTuple

import numpy as np
from estimates import select
from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.bicycle import Bicycle, BicycleLaw, lateral_dynamics
from agrobot_mj.plants.driver import Driver, mujoco_plant
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
LATERAL_M_S2 = 4.0
"""Lateral acceleration of the bicycle beyond which nothing is driven; the tractor tips at about 6 [m/s2]."""
REACH_S, MEAN_S = 9.0, 1.0
"""Time in which speed and bend become steady, and over which they are then averaged [s]."""
JOBS = [(tyre, steer) for tyre in TYRES for steer in STEERS_DEG]
"""Tyre and steering angle [deg] of each drive."""


class SteadyBend(NamedTuple):
    """Steady state in a bend."""

    yaw_rate: float  # yaw rate [rad/s]
    sideslip: float  # angle from the heading to the velocity of the CG, left positive [rad]


def validity(study: Study) -> Blocks:
    """The speeds at which the bicycle predicts the tractor."""
    rows = study.done("validity", drive, JOBS)
    return {"validity": validity_table(rows) if rows else ""}


def predicted(speed: float, steer: float, tractor: TractorParameters, bicycle: Bicycle) -> SteadyBend:
    """Steady state of the bicycle at a speed [m/s] and steering angle [rad]."""
    C_f, C_r = bicycle.front_cornering_stiffness_n_rad, bicycle.rear_cornering_stiffness_n_rad
    m, I_z, l_f, l_r = tractor.mass_kg, tractor.yaw_inertia_kg_m2, tractor.cg_to_front_axle, tractor.cg_to_rear_axle
    p = lateral_dynamics(BicycleLaw(m, I_z, l_f, l_r, C_f, C_r, 1.0, 1.0), speed)
    v, gamma = np.linalg.solve([[p.A11, p.A12], [p.A21, p.A22]], [-p.B1 * steer, -p.B2 * steer])
    return SteadyBend(float(gamma), atan2(v, speed))


def drive(job: tuple[str, float]) -> Row:
    """The row of one tyre and steering angle: for every speed, the bend as driven over that predicted."""
    tyre, steer_deg = job
    tractor, bicycle = TractorParameters(), Bicycle()
    driver, bends = Driver(*mujoco_plant(TYRES[tyre])), []
    for speed in SPEEDS_M_S:
        if abs(predicted(speed, radians(steer_deg), tractor, bicycle).yaw_rate) * speed > LATERAL_M_S2:
            break
        driver.speed = speed
        trace = driver.go(REACH_S, radians(steer_deg))
        u, v, gamma, steer = (trace.mean(name, MEAN_S) for name in ("speed", "lateral_speed", "yaw_rate", "steer"))
        model = predicted(u, steer, tractor, bicycle)
        slip = (atan2(v, u) - model.sideslip) / (tractor.cg_to_rear_axle * model.yaw_rate / u)
        bends.append({"speed": speed, "yaw_rate_error": gamma / model.yaw_rate - 1.0, "sideslip_error": slip})
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
