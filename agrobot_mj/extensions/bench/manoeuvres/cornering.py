"""Constant radius, after ISO 4138

The tractor follows a circle of 30 m radius at 1, 2, 3 and 4 m/s. With the lateral acceleration a_y, the required
steering angle is delta = delta_0 + K a_y. For the bicycle and for the `linear` tyre, the understeer gradient K must
equal the paper's expression m (l_r C_r - l_f C_f) / (L C_f C_r). The other tyres understeer about twice as much, for
four reasons. The outer wheels carry more load and have more rolling resistance, which turns the tractor out of the
bend. The pneumatic trail shifts side force to the front axle. Rolling resistance unloads the front axle. Cornering
stiffness grows less than in proportion to load. The theoretical gradient of these tyres is a straight-line fit to the
balances of forces and moments at the same speeds. The contact model of MuJoCo has no meaningful slip angle.
"""

from collections.abc import Iterator
from math import hypot

import numpy as np

from agrobot_mj.core.signals import TICK_S, Array, Truth
from agrobot_mj.extensions.bench.manoeuvres.base import BICYCLE, Check, Trial, tyre_of
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor, understeer_gradient
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Bicycle
from agrobot_mj.plants.driver import Driver, Steer
from agrobot_mj.tyres import Linear

RADIUS_M = 30.0
SPEEDS_M_S = np.array([1.0, 2.0, 3.0, 4.0])
BAND = 0.02


def hold_radius(radius: float, wheelbase: float) -> Steer:
    """Return a steering function that holds a path radius [m] by integral control of the curvature."""
    steer = wheelbase / radius

    def rule(truth: Truth) -> float:
        nonlocal steer
        speed = hypot(truth.speed, truth.lateral_speed)
        if speed > 0.5:
            steer += 0.5 * wheelbase * (1 / radius - truth.yaw_rate / speed) * TICK_S
        return steer

    return rule


def circle(driver: Driver, seconds: float, radius: float = RADIUS_M, speeds: Array = SPEEDS_M_S) -> Array:
    """Drive a circle for `seconds` at each speed. Return the lateral acceleration [m/s2] and the steering angle minus
    wheelbase divided by radius [rad] at each speed, shape (n, 2)."""
    L = driver.plant.tractor.wheelbase_m
    rule, rows = hold_radius(radius, L), []
    for speed in speeds:
        driver.speed = float(speed)
        trace = driver.go(seconds, rule)
        u, gamma = trace.mean("speed", 2.0), trace.mean("yaw_rate", 2.0)
        rows.append((u * gamma, trace.mean("steer", 2.0) - L * gamma / u))
    return np.array(rows)


def paper_gradient(kind: str) -> float:
    """Return the understeer gradient [rad s2/m] of the bicycle model, or of a tractor on `linear` tyres, by the formula
    of the paper."""
    tyre, bicycle = Linear(), Bicycle()
    front, rear = bicycle.front_cornering_stiffness_n_rad, bicycle.rear_cornering_stiffness_n_rad
    if kind != BICYCLE:
        front, rear = 2 * tyre.front_cornering_stiffness_n_rad, 2 * tyre.rear_cornering_stiffness_n_rad
    return understeer_gradient(TractorParameters(), front, rear)


def theory(kind: str) -> float | None:
    """Return the theoretical understeer gradient of a tractor [rad s2/m], or None for tyres without theory. `kind` is a
    type of tyre, or `BICYCLE`."""
    if kind in (BICYCLE, Linear().kind):
        return paper_gradient(kind)
    if not tyre_of(kind).judged:
        return None
    return Tractor(tyre=tyre_of(kind)).understeer_gradient(SPEEDS_M_S, RADIUS_M)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the understeer gradient for the bicycle model and every tyre. Runs are shorter in quick mode."""
    for subject, plant, truth in m.level_plants():
        m.curves[subject] = rows = circle(Driver(plant, truth), 12.0 if m.quick else 30.0)
        about, wanted = m.about("understeer gradient", subject, "mrad s2/m"), theory(subject)
        measured = 1e3 * float(np.polyfit(rows[:, 0], rows[:, 1], 1)[0])
        yield about.reported(measured) if wanted is None else about.near(measured, 1e3 * wanted, BAND)
