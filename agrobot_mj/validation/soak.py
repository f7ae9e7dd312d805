"""Ten minutes of random driving

Steering and pedal voltages jump at random, on level ground and on a rough grid, on every tyre. Every number must
stay finite and MuJoCo must not warn. A tractor that rolls over (on `linear`, which has no limit of grip, it often
does) or leaves the grid is put back at the start and driven on.
"""

import numpy as np
from scipy.ndimage import gaussian_filter

from agrobot_mj.hydraulics import FULL_RANGE_V
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.signals import TICK_S, Drive
from agrobot_mj.terrain import Flat, Ground
from agrobot_mj.validation.base import ORIGIN, About, Check, Findings, mujoco_plant, tyres, warnings

DURATION_S, BRIEFLY_S = 600.0, 20.0
HOLD_S = 0.5
"""A voltage holds as long."""


def rough_grid(nodes: int = 200, spacing: float = 0.25, rms: float = 0.03) -> Ground:
    """Bumps of about a metre, `rms` high [m], on a square grid about the origin."""
    noise = gaussian_filter(np.random.default_rng(7).normal(size=(nodes, nodes)), 4.0)
    corner = -spacing * (nodes - 1) / 2
    return Ground(corner, corner, spacing, np.ascontiguousarray(rms * noise / noise.std()))


def soak(plant: MujocoPlant, seconds: float) -> tuple[int, int, int]:
    """Ticks with a number that is not finite, warnings of MuJoCo, and how often the run began anew."""
    rng = np.random.default_rng(1)
    broken = warned = restarts = 0
    drive = Drive(0.0, 0.0)
    for tick in range(round(seconds / TICK_S)):
        if tick % round(HOLD_S / TICK_S) == 0:
            drive = Drive(*rng.uniform(0.0, FULL_RANGE_V, 2).tolist())
        truth = plant.advance(drive)
        trouble = plant.trouble()
        sane = np.isfinite([*truth[:14], *plant.data.qpos, *plant.data.qvel, *plant.wheels()]).all()
        broken += not sane or trouble == "diverged"
        if trouble:
            warned, restarts = warned + warnings([plant]), restarts + 1
            plant.reset(ORIGIN)
    return broken, warned + warnings([plant]), restarts


def run(quick: bool = False) -> Findings:
    """Every tyre on both grounds; `quick` drives for 20 s."""
    seconds = BRIEFLY_S if quick else DURATION_S
    checks: list[Check] = []
    warned = 0
    for tyre in tyres():
        for name, ground in (("level ground", Flat().ground()), ("a rough grid", rough_grid())):
            plant, _ = mujoco_plant(tyre, ground)
            broken, counted, restarts = soak(plant, seconds)
            quantity = f"ticks with a broken number in {seconds:g} s on {name}"
            checks.append(About("soak", quantity, tyre.kind, "").none(broken))
            checks.append(About("soak", f"rolled over or off, on {name}", tyre.kind, "").reported(restarts))
            warned += counted
    return Findings(checks, warned)
