"""Brake

The hydrostat is disconnected, and only the brake on the rear wheels holds the tractor. The tractor is parked facing
uphill and downhill, and the brake is released slowly. The tractor must begin to roll at the torque

    T = m g sin(theta) r_e,

with the effective rolling radius r_e at the load on the slope; rolling resistance does not act at rest. On level ground
the brake then stops the tractor from 3 m/s with the deceleration

    a = (T / r_e + sum(rho_i N_i)) / (m + sum(I_i / r_i^2)).

Scaled tractors of other masses are parked on a slope of 12 degrees, with driveline and brake scaled to their size.
"""

from collections.abc import Iterator
from math import dist, hypot, radians, sin
from typing import Any

import numpy as np

from agrobot_mj.core.signals import NEUTRAL_V, WHEELS, Drive
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, force_tyres, machine_of_mass
from agrobot_mj.extensions.bench.manoeuvres.coasting import spin_inertia
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import acceleration, hold
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import Linear

GRADE_DEG = 8.0
FACING = {"nose up": 0.0, "nose down": 180.0}
"""Direction of steepest ascent [deg], counter-clockwise from east, by orientation of a tractor that heads east."""
CAPACITY_N_M, STOPPING_N_M = 1000.0, 700.0
"""Maximum torque of the brake, and brake torque in the stopping test, which is half of the torque that locks the wheels
[N m]."""
ROLLING_M_S = 0.0003
"""Speed above which the tractor counts as rolling [m/s]: 1 % of the speed for full rolling resistance."""
FASTEST_M_S, FROM_M_S, TO_M_S = 3.0, 2.5, 0.5
BAND = 0.02
MASSES_KG, PARKED_DEG = (700.0, 2000.0, 5000.0, 9000.0), 12.0
DRIFT_MM = 1.0
FREE = Machine(driveline=Driveline(connected=False, brake_torque_n_m=CAPACITY_N_M))


def release_torque(plant: MujocoPlant, needed: float) -> float:
    """Release the brake slowly from 1.1 times `needed` [N m]. Return the torque at which the tractor starts rolling."""
    torque = 1.1 * needed
    while torque > 0.0:
        truth = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V, torque / CAPACITY_N_M))
        if abs(truth.speed) > ROLLING_M_S:
            break
        torque -= 5e-4 * needed
    return torque


def deceleration(plant: MujocoPlant, brake: float, speed: float, fast: float, slow: float) -> float:
    """Return the deceleration [m/s2] by the `brake` (0 to 1) on level ground, between the speeds `fast` and `slow`
    [m/s]. The tractor initially rolls at `speed` [m/s]."""
    plant.data.qvel[0] = speed
    for wheel, radius in zip(WHEELS, plant.tyred.tyres.radius, strict=True):
        plant.data.qvel[plant.model.joint(f"spin_{wheel}").dofadr[0]] = speed / radius
    return -acceleration(plant, Drive(NEUTRAL_V, NEUTRAL_V, brake), fast, slow)


def parked_displacement(m: Trial, mass_kg: float) -> float:
    """Return the displacement of a parked tractor with tyres scaled to its mass [mm]: the maximum of its initial
    distance from the origin and its displacement in ten seconds."""
    share = mass_kg / TractorParameters().mass_kg
    stiffer = {key: share * value for key, value in Linear().model_dump().items() if key.endswith(("_n_rad", "_n"))}
    slope = Slope(grade_deg=PARKED_DEG, direction_deg=20.0)
    plant, start = m.mujoco(Linear(**stiffer), slope, machine_of_mass(mass_kg))
    *_, end = hold(plant, 10.0, Drive(NEUTRAL_V, NEUTRAL_V, 1.0))
    return 1e3 * max(hypot(start.x, start.y), dist((start.x, start.y), (end.x, end.y)))


def holding(m: Trial, tyre: Any) -> Iterator[Check]:
    """Yield checks of the brake torque that holds a tractor facing uphill or downhill."""
    for facing, direction in FACING.items():
        plant, _ = m.mujoco(tyre, Slope(grade_deg=GRADE_DEG, direction_deg=direction), FREE)
        radii, _ = Tractor(plant.tractor, tyre).rolling(radians(GRADE_DEG))
        needed = plant.tractor.mass_kg * GRAVITY * sin(radians(GRADE_DEG)) * float(radii[2])
        about = m.about(f"torque that holds {facing} on {GRADE_DEG:g} deg", tyre.kind, "N m")
        yield about.near(release_torque(plant, needed), needed, BAND)


def stopping(m: Trial, tyre: Any) -> Check:
    """Return a check of the deceleration by the brake on level ground."""
    plant, _ = m.mujoco(tyre, machine=FREE)
    r, resisted = Tractor(plant.tractor, tyre).rolling()
    moved = plant.tractor.mass_kg + float(np.sum(spin_inertia(plant) / r**2))
    about = m.about(f"deceleration under {STOPPING_N_M:g} N m", tyre.kind, "m/s2")
    measured = deceleration(plant, STOPPING_N_M / CAPACITY_N_M, FASTEST_M_S, FROM_M_S, TO_M_S)
    return about.near(measured, (STOPPING_N_M / r[2] + resisted) / moved, BAND)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of holding torque, deceleration and parking. Quick mode tests the smallest and the largest mass."""
    for tyre in force_tyres():
        yield from holding(m, tyre)
        yield stopping(m, tyre)
    for mass in MASSES_KG[:: 3 if m.quick else 1]:
        about = m.about(f"start and drift in 10 s, {mass:g} kg on {PARKED_DEG:g} deg", "linear", "mm")
        yield about.below(parked_displacement(m, mass), DRIFT_MM)
