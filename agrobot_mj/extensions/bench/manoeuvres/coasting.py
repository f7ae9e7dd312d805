"""Coasting downhill

With the driveline disconnected, the tractor rolls down a slope of 5 degrees. Its acceleration must be

    a = (g sin(theta) - sum(rho_i N_i) / m) / (1 + sum(I_i / r_i^2) / m),

where rho_i N_i is the rolling and soil resistance of a wheel at its static load. I_i / r_i^2 is the spin inertia of the
wheel divided by its squared effective rolling radius. The wheels increase the effective mass by 5 to 6 %.
"""

from collections.abc import Iterator
from math import radians, sin

import numpy as np

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, tyres
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import REST, acceleration
from agrobot_mj.terrain import Slope

GRADE_DEG = 5.0
FROM_M_S, TO_M_S = 1.0, 4.0  # Speeds between which the acceleration is measured [m/s], well above standstill
BAND = 0.02


def spin_inertia(plant: MujocoPlant) -> Array:
    """Return the moment of inertia about each wheel axle [kg m2], including all rotating parts, shape (4,)."""
    model = plant.model
    wheels = [model.body(f"wheel_{wheel}").inertia[1] for wheel in WHEELS]
    along = [model.dof_armature[model.joint(f"spin_{wheel}").dofadr[0]] for wheel in WHEELS]
    return np.array([float(a + b) for a, b in zip(wheels, along, strict=True)])


def theory(plant: MujocoPlant, paper: Tractor) -> float:
    """Return the theoretical acceleration [m/s2] of the coasting tractor down the slope."""
    grade, p = radians(GRADE_DEG), plant.tractor
    radius, resisted = paper.rolling(grade)
    effective = 1 + float(np.sum(spin_inertia(plant) / radius**2)) / p.mass_kg
    return (GRAVITY * sin(grade) - resisted / p.mass_kg) / effective


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the downhill acceleration with every tyre, also in quick mode."""
    for tyre in tyres():
        slope, free = Slope(grade_deg=GRADE_DEG, direction_deg=180.0), Machine(driveline=Driveline(connected=False))
        plant, _ = m.mujoco(tyre, slope, free, settle_s=0.0)
        wanted = theory(plant, Tractor(plant.tractor, tyre))
        measured = acceleration(plant, REST, FROM_M_S, TO_M_S, radians(GRADE_DEG))
        about = m.about(f"acceleration down {GRADE_DEG:g} deg", tyre.kind, "m/s2")
        yield about.near(measured, wanted, BAND).judged(tyre.judged)
