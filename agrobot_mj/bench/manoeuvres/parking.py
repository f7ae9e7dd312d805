"""Parking on a slope

The tractor stands on a slope of 15 degrees, uphill, downhill and across, valves in neutral, for ten minutes. After
ten seconds of settling nothing may creep: the carcass is a bristle that holds like a spring, the hydrostat and the
steering oil are springs too. MuJoCo's own contact creeps, so its drift is reported and not judged.
"""

from math import dist

from agrobot_mj.bench.manoeuvres.base import About, Check, Findings, mujoco_plant, tyres, warnings
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Drive
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.terrain import Slope

GRADE_DEG = 15.0
FACING = {"uphill": 0.0, "downhill": 180.0, "across": 90.0}
"""Direction of steepest ascent for a tractor that faces east [deg]."""
SETTLED_S, PARKED_S, BRIEFLY_S = 10.0, 600.0, 30.0
DRIFT_MM = 1.0
"""Drift allowed in ten minutes [mm]."""
REST = Drive(NEUTRAL_V, NEUTRAL_V)


def drift(plant: MujocoPlant, seconds: float) -> tuple[float, float]:
    """How far the CG moves from `SETTLED_S` until `seconds` [mm], and how fast over the last 10 s [mm/min].

    Raises ValueError for less than 20 s.
    """
    if seconds < 2 * SETTLED_S:
        raise ValueError(f"park for {2 * SETTLED_S:g} s or more, got {seconds:g}")
    ticks, settled = round(seconds / TICK_S), round(SETTLED_S / TICK_S)
    places = [(truth.x, truth.y, truth.z) for truth in (plant.advance(REST) for _ in range(ticks))]
    moved = 1e3 * dist(places[-1], places[settled - 1])
    return moved, 1e3 * dist(places[-1], places[-settled]) * 60 / SETTLED_S


def run(quick: bool = False) -> Findings:
    """Drift on every tyre; `quick` parks for half a minute."""
    seconds = BRIEFLY_S if quick else PARKED_S
    checks: list[Check] = []
    warned = 0
    for tyre in tyres():
        for facing, direction in FACING.items():
            plant, _ = mujoco_plant(tyre, Slope(grade_deg=GRADE_DEG, direction_deg=direction))
            moved, creep = drift(plant, seconds)
            where = f"{facing} on {GRADE_DEG:g} deg"
            total = About("parking", f"drift in {seconds:g} s, {where}", tyre.kind, "mm")
            last = About("parking", f"creep at the end, {where}", tyre.kind, "mm/min")
            checks.append(total.judged(tyre, total.below(moved, DRIFT_MM)))
            checks.append(last.judged(tyre, last.below(creep, DRIFT_MM / 10)))
            warned += warnings([plant])
    return Findings(checks, warned)
