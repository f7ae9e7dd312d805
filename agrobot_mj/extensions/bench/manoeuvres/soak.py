"""Random driving for ten minutes

Steering and pedal voltages change at random, on level ground and on a field of ISO 8608 class E, with every tyre. All
numbers must stay finite, and MuJoCo must give no warnings. A tractor that rolls over (frequent on `linear`, which has
unlimited grip) or leaves the field restarts at the origin.
"""

from collections.abc import Iterator

import numpy as np

from agrobot_mj.core.signals import TICK_S, Drive
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, tyres
from agrobot_mj.machine.hydraulics import FULL_RANGE_V
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.terrain import Flat, Rough

DURATION_S, BRIEFLY_S = 600.0, 20.0
HOLD_S = 0.5  # Time for which a random voltage remains constant [s]


def soak(m: Trial, plant: MujocoPlant, seconds: float) -> tuple[int, int]:
    """Simulate random driving for `seconds`. Return the number of ticks with a diverged or non-finite state, and the
    number of restarts."""
    rng = np.random.default_rng(1)
    broken = restarts = 0
    drive = Drive(0.0, 0.0)
    for tick in range(round(seconds / TICK_S)):
        if tick % round(HOLD_S / TICK_S) == 0:
            drive = Drive(*rng.uniform(0.0, FULL_RANGE_V, 2).tolist())
        truth = plant.advance(drive)
        trouble = plant.trouble()
        sane = np.isfinite([*truth[:14], *plant.data.qpos, *plant.data.qvel, *plant.wheels()]).all()
        broken += not sane or trouble == "diverged"
        if trouble:
            m.restart(plant)
            restarts += 1
    return broken, restarts


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of random driving with every tyre, on level and rough ground. Quick mode simulates only 20 s."""
    seconds = BRIEFLY_S if m.quick else DURATION_S
    for tyre in tyres():
        for name, terrain in (("level ground", Flat()), ("a rough field", Rough(iso_class="E", half_size_m=25.0))):
            plant, _ = m.mujoco(tyre, terrain)
            broken, restarts = soak(m, plant, seconds)
            yield m.about(f"ticks with a non-finite value in {seconds:g} s on {name}", tyre.kind).none(broken)
            yield m.about(f"restarts after a roll-over or at the edge, on {name}", tyre.kind).reported(restarts)
