"""Parking on a slope

The tractor is parked for ten minutes on a slope of 15 degrees, facing uphill, downhill and across, with the valves in
neutral. After ten seconds of settling, the tractor must not creep, because the tyre carcasses (bristles), the hydrostat
and the steering oil act as springs. With the contact model of MuJoCo (`contact`), the tractor creeps without the brake;
this drift has no acceptance limit.
"""

from collections.abc import Iterator
from math import dist

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, tyres
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import hold
from agrobot_mj.terrain import Slope

GRADE_DEG = 15.0
FACING = {"uphill": 0.0, "downhill": 180.0, "across": 90.0}
"""Direction of steepest ascent [deg], counter-clockwise from east, by orientation of a tractor that heads east."""
SETTLED_S, PARKED_S, BRIEFLY_S = 10.0, 600.0, 30.0
DRIFT_MM = 1.0  # Maximum displacement in ten minutes [mm]


def drift(plant: MujocoPlant, seconds: float) -> tuple[float, float]:
    """Return the displacement of the CG from `SETTLED_S` to `seconds` [mm], and its speed in the last 10 s [mm/min]."""
    settled = round(SETTLED_S / TICK_S)
    places = [(truth.x, truth.y, truth.z) for truth in hold(plant, seconds)]
    moved = 1e3 * dist(places[-1], places[settled - 1])
    return moved, 1e3 * dist(places[-1], places[-settled]) * 60 / SETTLED_S


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the displacement on a slope with every tyre. Quick mode simulates only half a minute."""
    seconds = BRIEFLY_S if m.quick else PARKED_S
    for tyre in tyres():
        for facing, direction in FACING.items():
            plant, _ = m.mujoco(tyre, Slope(grade_deg=GRADE_DEG, direction_deg=direction))
            moved, creep = drift(plant, seconds)
            where = f"{facing} on {GRADE_DEG:g} deg"
            total = m.about(f"drift in {seconds:g} s, {where}", tyre.kind, "mm").below(moved, DRIFT_MM)
            last = m.about(f"creep at the end, {where}", tyre.kind, "mm/min").below(creep, DRIFT_MM / 10)
            yield total.judged(tyre.judged)
            yield last.judged(tyre.judged)
