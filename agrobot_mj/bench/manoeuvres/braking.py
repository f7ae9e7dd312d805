"""Brake

The hydrostat is disconnected, and the brake on the rear wheels alone holds the tractor. Parked nose up and nose down it
is released slowly: the tractor must begin to roll at the torque

    T = m g sin(theta) r_e,

with the effective rolling radius r_e at the load on the slope; rolling resistance does not act at rest. On level ground
the brake then stops it from 3 m/s with the deceleration

    a = (T / r_e + sum(rho_i N_i)) / (m + sum(I_i / r_i^2)).

Tractors of other masses and the same shape park on 12 degrees with the drive and the brake that follow from their
size.
"""

from math import cos, dist, hypot, radians, sin
from typing import Any

import numpy as np

from agrobot_mj.bench.manoeuvres.base import About, Check, Findings, force_tyres, mujoco_plant, tractor_of, warnings
from agrobot_mj.bench.manoeuvres.coasting import spin_inertia
from agrobot_mj.bench.manoeuvres.theory import Tractor
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, WHEELS, Array, Drive
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import Linear

GRADE_DEG = 8.0
FACING = {"nose up": 0.0, "nose down": 180.0}
"""Direction of steepest ascent for a tractor that faces east [deg]."""
CAPACITY_N_M, STOPPING_N_M = 1000.0, 700.0
"""Torque of the brake on the slope, and that with which it stops: half of what locks the wheels [N m]."""
ROLLING_M_S = 0.0003
"""Speed from which it counts as rolling [m/s]: a hundredth of that at which the rolling resistance has built up."""
FROM_M_S, TO_M_S = 2.5, 0.5
BAND = 0.02
MASSES_KG, PARKED_DEG = (700.0, 2000.0, 5000.0, 9000.0), 12.0
DRIFT_MM = 1.0
FREE = Machine(driveline=Driveline(connected=False, brake_torque_n_m=CAPACITY_N_M))


def radii(plant: MujocoPlant, tyre: Tractor, grade: float) -> Array:
    """Effective rolling radii (4,) under the loads of level ground times cos(`grade`) [m]; `grade` [rad]."""
    loads = np.repeat([plant.tractor.front_axle_load, plant.tractor.rear_axle_load], 2) / 2 * cos(grade)
    return np.asarray(tyre.tyres.radius - loads / tyre.tyres.stiffness / 3)


def released(plant: MujocoPlant, needed: float) -> float:
    """Torque at which the tractor begins to roll while the brake goes from above `needed` to nothing [N m]."""
    torque = 1.1 * needed
    while torque > 0.0:
        truth = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V, torque / CAPACITY_N_M))
        if abs(truth.speed) > ROLLING_M_S:
            break
        torque -= 5e-4 * needed
    return torque


def deceleration(plant: MujocoPlant) -> float:
    """Deceleration on level ground from `FROM_M_S` to `TO_M_S` under `STOPPING_N_M` [m/s2]."""
    plant.data.qvel[0] = 3.0
    for wheel, radius in zip(WHEELS, plant.tyred.tyres.radius, strict=True):
        plant.data.qvel[plant.model.joint(f"spin_{wheel}").dofadr[0]] = 3.0 / radius
    t, v = [], []
    for _ in range(round(5.0 / TICK_S)):
        truth = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V, STOPPING_N_M / CAPACITY_N_M))
        if truth.speed < TO_M_S:
            break
        if truth.speed < FROM_M_S:
            t.append(truth.t)
            v.append(truth.speed)
    return -float(np.polyfit(t, v, 1)[0])


def parked(mass_kg: float) -> tuple[float, int]:
    """How far a tractor of this mass moves in ten seconds on the slope, for its mass' tyres [mm], and warnings."""
    share = mass_kg / TractorParameters().mass_kg
    grown = {key: share * value for key, value in Linear().model_dump().items() if key.endswith(("_n_rad", "_n"))}
    slope = Slope(grade_deg=PARKED_DEG, direction_deg=20.0)
    plant, start = mujoco_plant(Linear(**grown), slope, Machine(tractor=tractor_of(mass_kg)))
    away = hypot(start.x, start.y)
    for _ in range(round(10.0 / TICK_S)):
        end = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V, 1.0))
    return 1e3 * max(away, dist((start.x, start.y), (end.x, end.y))), warnings([plant])


def on_a_slope(tyre: Any) -> list[Check]:
    """Torque that holds the tractor, nose up and nose down."""
    checks, grade = [], radians(GRADE_DEG)
    for facing, direction in FACING.items():
        plant, _ = mujoco_plant(tyre, Slope(grade_deg=GRADE_DEG, direction_deg=direction), FREE)
        r_e = float(radii(plant, Tractor(plant.tractor, tyre), grade)[2])
        needed = plant.tractor.mass_kg * GRAVITY * sin(grade) * r_e
        about = About("brake", f"torque that holds {facing} on {GRADE_DEG:g} deg", tyre.kind, "N m")
        checks.append(about.near(released(plant, needed), needed, BAND))
    return checks


def on_the_flat(tyre: Any) -> tuple[Check, int]:
    """Deceleration by the brake, and MuJoCo's warnings."""
    plant, _ = mujoco_plant(tyre, machine=FREE)
    paper, p = Tractor(plant.tractor, tyre), plant.tractor
    r, loads = radii(plant, paper, 0.0), np.repeat([p.front_axle_load, p.rear_axle_load], 2) / 2
    resisted = sum(paper.resistance(i, loads[i]) for i in range(4))
    wanted = (STOPPING_N_M / r[2] + resisted) / (p.mass_kg + float(np.sum(spin_inertia(plant) / r**2)))
    about = About("brake", f"deceleration under {STOPPING_N_M:g} N m", tyre.kind, "m/s2")
    return about.near(deceleration(plant), wanted, BAND), warnings([plant])


def run(quick: bool = False) -> Findings:
    """Torque that holds, deceleration, and parking by mass; `quick` takes the lightest and the heaviest tractor."""
    checks: list[Check] = []
    warned = 0
    for tyre in force_tyres():
        stopped, more = on_the_flat(tyre)
        checks += [*on_a_slope(tyre), stopped]
        warned += more
    for mass in MASSES_KG[:: 3 if quick else 1]:
        moved, more = parked(mass)
        about = About("brake", f"start and drift in 10 s, {mass:g} kg on {PARKED_DEG:g} deg", "linear", "mm")
        checks.append(about.below(moved, DRIFT_MM))
        warned += more
    return Findings(checks, warned)
