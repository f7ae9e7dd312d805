"""Coasting downhill

With the driveline disconnected the tractor rolls down 5 degrees. Its acceleration must be

    a = (g sin(theta) - sum(rho_i N_i) / m) / (1 + sum(I_i / r_i^2) / m),

where rho_i N_i are rolling and soil resistance at the static loads and I_i / r_i^2 the spin inertia of each wheel
over its effective rolling radius squared: the effective mass is 5 to 6 % above the mass.
"""

from math import cos, radians, sin

import numpy as np

from agrobot_mj.bench.manoeuvres.base import About, Check, Findings, mujoco_plant, tyres, warnings
from agrobot_mj.bench.manoeuvres.theory import Tractor
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, WHEELS, Array, Drive
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.terrain import Slope

GRADE_DEG = 5.0
FROM_M_S, TO_M_S = 1.0, 4.0
"""Speeds between which the acceleration is measured: well away from standstill."""
BAND = 0.02


def spin_inertia(plant: MujocoPlant) -> Array:
    """Inertia about each wheel's axle, with everything that turns with it, shape (4,) [kg m2]."""
    model = plant.model
    wheels = [model.body(f"wheel_{wheel}").inertia[1] for wheel in WHEELS]
    along = [model.dof_armature[model.joint(f"spin_{wheel}").dofadr[0]] for wheel in WHEELS]
    return np.array([float(a + b) for a, b in zip(wheels, along, strict=True)])


def theory(plant: MujocoPlant, paper: Tractor) -> float:
    """Acceleration down the slope [m/s2]."""
    grade, p, t = radians(GRADE_DEG), plant.tractor, paper.tyres
    loads = np.repeat([p.front_axle_load, p.rear_axle_load], 2) / 2 * cos(grade)
    radius = t.radius - loads / t.stiffness / 3
    resisted = sum(paper.resistance(i, loads[i]) for i in range(4))
    effective = 1 + float(np.sum(spin_inertia(plant) / radius**2)) / p.mass_kg
    return (GRAVITY * sin(grade) - resisted / p.mass_kg) / effective


def coast(plant: MujocoPlant) -> float:
    """Acceleration along the slope between the two speeds [m/s2]."""
    t, v = [], []
    for _ in range(round(30.0 / TICK_S)):
        truth = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V))
        speed = truth.speed / cos(radians(GRADE_DEG))
        if speed > TO_M_S:
            break
        if speed > FROM_M_S:
            t.append(truth.t)
            v.append(speed)
    return float(np.polyfit(t, v, 1)[0])


def run(quick: bool = False) -> Findings:
    """Acceleration on every tyre; `quick` changes nothing."""
    checks: list[Check] = []
    warned = 0
    for tyre in tyres():
        slope, free = Slope(grade_deg=GRADE_DEG, direction_deg=180.0), Machine(driveline=Driveline(connected=False))
        plant, _ = mujoco_plant(tyre, slope, free, settle_s=0.0)
        wanted = theory(plant, Tractor(plant.tractor, tyre))
        about = About("coasting", f"acceleration down {GRADE_DEG:g} deg", tyre.kind, "m/s2")
        measured = coast(plant)
        checks.append(about.judged(tyre, about.near(measured, wanted, BAND)))
        warned += warnings([plant])
    return Findings(checks, warned)
