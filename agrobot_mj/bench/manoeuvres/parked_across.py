"""Parked across a slope, by size

A tractor is put down across a slope, in neutral, on soil that sinks and on firm ground: as it is, and half as large
again, with masses as the cube of its lengths, inertias as the fifth power and the stiffness of its tyres as the square.
Before its run it must come to rest, at less than half a millimetre a second, and then it stays where it is and digs no
deeper. Its lower wheels carry the share 1/2 + (h / b) tan(slope) of the load, with the height h of the centre of
gravity and the track b; lean on tyres and soil moves the centre a little further.
"""

from math import hypot, radians, tan

from agrobot_mj.bench.manoeuvres.base import About, Check, Findings, mujoco_plant, tractor_of, warnings
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Drive, Truth
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.mujoco.settling import REST_M_S
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import MagicFormula, Ruts, Soil
from agrobot_mj.tyres.patch import LOAD

GRADE_DEG = 15.0
SLOPE = Slope(grade_deg=GRADE_DEG, direction_deg=90.0)
MASSES_KG = (TractorParameters().mass_kg, 2500.0)
WATCHED_S = 20.0
MOVES_MM, DIGS_MM = 0.1, 0.1
"""Motion and sinkage allowed at rest [mm]."""
LEANS = 0.02
"""Share of the load that lean adds [-]."""
REST = Drive(NEUTRAL_V, NEUTRAL_V)


def run(quick: bool = False) -> Findings:
    """Every mass on sinking soil and on firm ground; `quick` takes the stock tractor."""
    checks: list[Check] = []
    warned = 0
    for mass in MASSES_KG[:1] if quick else MASSES_KG:
        for tyre in (MagicFormula(), Soil(), Ruts()):
            plant, truth = mujoco_plant(tyre, SLOPE, Machine(tractor=tractor_of(mass)))
            checks += parked(plant, truth, tyre.kind)
            warned += warnings([plant])
    return Findings(checks, warned)


def parked(plant: MujocoPlant, truth: Truth, kind: str) -> list[Check]:
    """Checks of a tractor that stands across `SLOPE`."""

    def about(quantity: str, unit: str) -> About:
        return About("parked across", f"{quantity}, {plant.tractor.mass_kg:.0f} kg", kind, unit)

    speed = max(hypot(truth.speed, truth.lateral_speed), abs(truth.yaw_rate))
    before, later = deepest(plant), truth
    for _ in range(round(WATCHED_S / TICK_S)):
        later = plant.advance(REST)
    tractor, loads = plant.tractor, plant.tyred.report[:, LOAD]
    theory = 0.5 + tractor.cg_height_m / tractor.track_m * tan(radians(GRADE_DEG))
    moved, dug = hypot(later.x - truth.x, later.y - truth.y), deepest(plant) - before
    return [
        about("speed at the start", "mm/s").below(1e3 * speed, 1e3 * REST_M_S),
        about(f"way in {WATCHED_S:g} s", "mm").below(1e3 * moved, MOVES_MM),
        about(f"sinkage in {WATCHED_S:g} s", "mm").below(1e3 * dug, DIGS_MM),
        about("share of the load on the lower wheels", "").near(
            float(loads[[1, 3]].sum() / loads.sum()), theory, LEANS
        ),
    ]


def deepest(plant: MujocoPlant) -> float:
    """Depth of the deepest rut [m]."""
    ruts = plant.ruts()
    return 0.0 if ruts is None or not len(ruts.depth) else float(ruts.depth.max())
