"""Axle loads on slopes

The wheel loads of a tractor parked on 15 degrees must equal the static loads. If the tractor faces uphill or downhill,
the static loads follow from moments about an axle, including pitch due to tyre deflection. Across the slope, the static
loads follow from moments about the line through the pivot of the front axle. These moments include the effects of roll
due to rear tyre deflection and of side deflection of the carcasses. The pivot transfers the complete roll moment of the
body to the rear wheels.
"""

from collections.abc import Iterator
from math import cos, radians, sin

import numpy as np

from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, tyres
from agrobot_mj.extensions.bench.manoeuvres.parking import FACING, GRADE_DEG
from agrobot_mj.extensions.bench.manoeuvres.theory import LINEAR, Tractor
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants.driver import hold
from agrobot_mj.terrain import Slope

SETTLED_S, WATCHED_S = 5.0, 5.0
BAND = 0.01  # Maximum difference between measured and theoretical load, divided by the load [-]


def facing_uphill(tractor: TractorParameters, grade: float) -> tuple[float, float]:
    """Return the static loads of the front and rear axles [N]. A tractor facing uphill has a positive `grade` [rad]."""
    L, weight = tractor.wheelbase_m, tractor.mass_kg * GRAVITY
    front = tractor.front_axle_load
    for _ in range(5):
        raised = (tractor.front_axle_load - front) / (2 * tractor.front_wheel.stiffness)
        sunk = (weight * cos(grade) - front - tractor.rear_axle_load) / (2 * tractor.rear_wheel.stiffness)
        nose_up = (raised + sunk) / L
        back = tractor.cg_to_rear_axle - nose_up * tractor.cg_height_m
        height = tractor.cg_height_m + nose_up * tractor.cg_to_rear_axle - sunk
        front = weight * (cos(grade) * back - sin(grade) * height) / L
    return front, weight * cos(grade) - front


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the wheel loads on a slope with every tyre, also in quick mode."""
    for tyre in tyres():
        theory_tyre = tyre if tyre.judged else LINEAR
        for facing, direction in FACING.items():
            plant, _ = m.mujoco(tyre, Slope(grade_deg=GRADE_DEG, direction_deg=direction))
            reports = [plant.wheels()[:4].copy() for _ in hold(plant, SETTLED_S + WATCHED_S)]
            carried: Array = np.array(reports[round(SETTLED_S / TICK_S) :]).mean(axis=0)
            for name, measured, theory in _compare(Tractor(plant.tractor, theory_tyre), facing, carried):
                about = m.about(f"{name}, {facing} on {GRADE_DEG:g} deg", tyre.kind, "N")
                yield about.near(measured, theory, BAND).judged(tyre.judged)


def _compare(tractor: Tractor, facing: str, carried: Array) -> list[tuple[str, float, float]]:
    if facing == "across":
        wanted = tractor.side_slope(GRADE_DEG, rolling=False).loads.wheels
        return [
            ("front axle", carried[:2].sum(), wanted[:2].sum()),
            ("lower rear wheel", carried[3], wanted[3]),
            ("upper rear wheel", carried[2], wanted[2]),
        ]
    front, rear = facing_uphill(tractor.p, radians(GRADE_DEG) * (1 if facing == "uphill" else -1))
    return [("front axle", carried[:2].sum(), front), ("rear axle", carried[2:].sum(), rear)]
