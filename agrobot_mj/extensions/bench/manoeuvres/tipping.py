"""Sideways tip-over

Gravity is tilted slowly, as if the field of a parked tractor were raised at one side, until the tractor rolls over. The
slope at which the upper rear wheel leaves the ground is compared with theory. The front axle rotates about its pivot
and carries no roll moment. Therefore the tractor tips about the line from the lower rear contact patch to the pivot, at
about 35 degrees. Tipping about the line through both downhill patches would need 42 degrees, but the pivot reaches its
stops only above this angle. The theory includes the roll of the body on its tyres and the side deflection of the
carcass, which reduce the angle by several degrees. Unequal deflection of the axles makes the tractor yaw. The contact
patches resist this yaw, which increases the angle by up to 1.2 degrees. On tyres with insufficient grip, the tractor
slides first.
"""

from collections.abc import Iterator
from math import cos, hypot, radians, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import TICK_S, WHEELS
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, tyres
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import REST
from agrobot_mj.terrain.grid import Surface

FROM_DEG, TO_DEG, STEEPEST_DEG = 18.0, 45.0, 60.0
QUICKLY_DEG_S, SLOWLY_DEG_S = 2.0, 0.25
"""Rates at which gravity is tilted, below the slope `FROM_DEG` and above this slope (quasi-static) [deg/s]."""
SLID_M = 1.0  # Displacement above which the tractor has slid [m], larger than the deflection of the carcasses
BAND_DEG = 2.0
GRIPPING = Surface(-50.0, -50.0, 100.0, np.array([[4.0]]), np.array([[0.0]]))
"""Ground surface with four times the normal friction, on which machines tip over before they slide."""


class TiltTest(NamedTuple):
    """Result of a tilt test."""

    lifted_deg: float  # Slope at which the upper rear wheel last touched the ground [deg], or the final slope
    slid_deg: float | None
    """Slope at which the tractor has slid by `SLID_M` [deg], or None if the tractor tipped over first."""


def tilt(
    plant: MujocoPlant, left_side_up: bool, last_deg: float = TO_DEG, slowly_deg_s: float = SLOWLY_DEG_S
) -> TiltTest:
    """Tilt gravity up to `last_deg`, or until the tractor rolls over or slides. Return the slopes at these events.

    The tilt direction follows the yaw of the tractor, which changes by some degrees on its tyres.

    `slowly_deg_s` is the rate of the tilt above `FROM_DEG` [deg/s]. The carcass of the lower wheel needs seconds to
    deflect before the upper wheel lifts off, which increases the slope by up to 0.2 deg at the default rate.
    """
    side, upper = (1.0, WHEELS.index("rl")) if left_side_up else (-1.0, WHEELS.index("rr"))
    start = truth = plant.truth()
    grade = lifted = 0.0
    while grade < last_deg:
        grade += TICK_S * (QUICKLY_DEG_S if grade < FROM_DEG else slowly_deg_s)
        across = radians(grade)
        aside = side * GRAVITY * sin(across)
        plant.model.opt.gravity[:] = aside * sin(truth.yaw), -aside * cos(truth.yaw), -GRAVITY * cos(across)
        truth = plant.advance(REST)
        if plant.trouble() == "rolled_over":
            return TiltTest(lifted, None)
        if plant.wheels()[upper] > 0.0:
            lifted = grade
            if hypot(truth.x - start.x, truth.y - start.y) > SLID_M:
                return TiltTest(lifted, grade)
    return TiltTest(last_deg, None)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the tip-over slope with every tyre. Quick mode tests one side only."""
    for tyre in tyres():
        wanted = Tractor(tyre=tyre).tipping_deg
        for left_side_up in (True,) if m.quick else (True, False):
            ended, side = tilt(m.mujoco(tyre)[0], left_side_up), "right" if left_side_up else "left"
            if ended.slid_deg is not None:
                yield m.about(f"slope at which it slides off to the {side}", tyre.kind, "deg").reported(ended.slid_deg)
            else:
                tips = m.about(f"slope at which it tips to the {side}", tyre.kind, "deg")
                yield tips.close(ended.lifted_deg, wanted, BAND_DEG).judged(tyre.judged)
