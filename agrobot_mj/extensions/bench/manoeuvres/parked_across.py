"""Parked across a slope, by size

A tractor is parked across a slope, on soft soil and on firm ground, with the transmission in neutral. The tractor has
its default size or is enlarged by half. Masses scale with the cube of the length, inertias with its fifth power, and
tyre stiffnesses with its square. At the start, the tractor must be at rest (slower than 0.5 mm/s). Afterwards the
tractor must neither move nor sink further. The lower wheels must carry the fraction 1/2 + (h / b) tan(slope) of the
load. Here h is the height of the centre of gravity, and b the track width. Roll and side deflection of the tyres
increase this fraction, as in the section on axle loads. Roll on soil shifts the centre of gravity slightly further.
"""

from collections.abc import Iterator
from math import hypot

from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, machine_of_mass
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import hold
from agrobot_mj.plants.mujoco.settling import REST_M_S
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import MagicFormula, Ruts, Soil
from agrobot_mj.tyres.patch import LOAD

GRADE_DEG = 15.0
SLOPE = Slope(grade_deg=GRADE_DEG, direction_deg=90.0)
MASSES_KG = (TractorParameters().mass_kg, 2500.0)
WATCHED_S = 20.0
MOVES_MM, DIGS_MM = 0.1, 0.1  # Maximum motion and maximum additional sinkage of a parked tractor [mm]
LEANS = 0.02  # Acceptance limit of the load on the lower wheels [relative]. Roll on soil shifts the centre of gravity.


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of parked tractors of every mass on soft and firm ground. Quick mode tests the default tractor."""
    for mass in MASSES_KG[:1] if m.quick else MASSES_KG:
        for tyre in (MagicFormula(), Soil(), Ruts()):
            plant, truth = m.mujoco(tyre, SLOPE, machine_of_mass(mass))
            before, tractor = deepest(plant), plant.tractor
            *_, later = hold(plant, WATCHED_S)
            loads = plant.tyred.report[:, LOAD]
            size, share = f"{tractor.mass_kg:.0f} kg", float(loads[[1, 3]].sum() / loads.sum())
            speed = 1e3 * max(hypot(truth.speed, truth.lateral_speed), abs(truth.yaw_rate))
            moved, dug = 1e3 * hypot(later.x - truth.x, later.y - truth.y), 1e3 * (deepest(plant) - before)
            balanced = Tractor(tractor, tyre).side_slope(GRADE_DEG, rolling=False).loads.wheels
            theory = float(balanced[[1, 3]].sum() / balanced.sum())
            yield m.about(f"speed at the start, {size}", tyre.kind, "mm/s").below(speed, 1e3 * REST_M_S)
            yield m.about(f"distance in {WATCHED_S:g} s, {size}", tyre.kind, "mm").below(moved, MOVES_MM)
            yield m.about(f"sinkage in {WATCHED_S:g} s, {size}", tyre.kind, "mm").below(dug, DIGS_MM)
            yield m.about(f"fraction of the load on the lower wheels, {size}", tyre.kind).near(share, theory, LEANS)


def deepest(plant: MujocoPlant) -> float:
    """Return the maximum depth of the ruts made by the plant [m], or 0 without ruts."""
    ruts = plant.ruts()
    return 0.0 if ruts is None or not len(ruts.depth) else float(ruts.depth.max())
