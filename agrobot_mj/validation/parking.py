"""Parking on a slope

The tractor stands on a slope of 15 degrees, uphill, downhill and across, valves in neutral, for ten minutes. After
ten seconds of settling nothing may creep: the carcass is a bristle that holds like a spring, the hydrostat and the
steering oil are springs too. MuJoCo's own contact creeps, so its drift is reported and not judged.
"""

from math import hypot

from agrobot_mj.hydraulics import NEUTRAL_V
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.signals import Drive
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import Contact
from agrobot_mj.validation.base import TICK_S, About, Check, Findings, mujoco_plant, tyres, warnings

GRADE_DEG = 15.0
FACING = {"uphill": 0.0, "downhill": 180.0, "across": 90.0}
"""Direction of steepest ascent for a tractor that faces east [deg]."""
SETTLED_S, PARKED_S, BRIEFLY_S = 10.0, 600.0, 30.0
REST = Drive(NEUTRAL_V, NEUTRAL_V)


def drift(plant: MujocoPlant, seconds: float) -> float:
    """How far the CG moves from `SETTLED_S` until `seconds` [mm]."""
    first = last = None
    for tick in range(round(seconds / TICK_S)):
        last = plant.advance(REST)
        if tick + 1 == round(SETTLED_S / TICK_S):
            first = last
    if first is None or last is None:
        raise ValueError(f"park for more than {SETTLED_S:g} s, got {seconds:g}")
    return 1e3 * hypot(last.x - first.x, last.y - first.y, last.z - first.z)


def run(quick: bool = False) -> Findings:
    """Drift on every tyre; `quick` parks for half a minute."""
    seconds = BRIEFLY_S if quick else PARKED_S
    checks: list[Check] = []
    warned = 0
    for tyre in tyres():
        for facing, direction in FACING.items():
            plant, _ = mujoco_plant(tyre, Slope(grade_deg=GRADE_DEG, direction_deg=direction))
            moved = drift(plant, seconds)
            about = About("parking", f"drift in {seconds:g} s, {facing} on {GRADE_DEG:g} deg", tyre.kind, "mm")
            checks.append(about.reported(moved) if isinstance(tyre, Contact) else about.below(moved, 1.0))
            warned += warnings([plant])
    return Findings(checks, warned)
