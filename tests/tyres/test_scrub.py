"""Scrubbing moment of a turning contact patch, which equals the moment of a brush with the width of the patch."""

from math import sqrt

import numpy as np
import pytest
from wheel_steps import step_of

from agrobot_mj.machine.linkage import DRY_GRIP
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import MagicFormula, Soil
from agrobot_mj.tyres.base import Footing
from agrobot_mj.tyres.laws import slip_stiffness, tyre_set
from agrobot_mj.tyres.patch import FORCE_Y, WheelMotion

TRACTOR, GROUND, DT, REAR = TractorParameters(), Flat().ground(), 0.002, 2
LOAD, STIFFNESS, RADIUS, WIDTH = TRACTOR.rear_wheel.load, TRACTOR.rear_wheel.stiffness, 0.42, 0.24


def torques(tyre, v, turn, steps=2000, v_y=0.0):
    """Return the torque about the wheel centre (3,) and the side force after a steady motion at the static load."""
    tyres, sunk = tyre_set(tyre, TRACTOR), LOAD / STIFFNESS
    spin = v / (RADIUS - sunk / 3)
    motion = WheelMotion((0.0, 0.0, RADIUS - sunk), (0.0, 1.0, 0.0), (v, v_y, 0.0), (0.0, spin, turn))
    bristle, wrench, report = np.zeros(4), np.zeros(6), np.zeros(6)
    wheel_step = step_of(tyres, GROUND)
    for _ in range(steps):
        wheel_step(tyres, REAR, GROUND, motion, DT, bristle, wrench, report)
    return wrench[3:], report[FORCE_Y]


def moment(tyre, v, turn, steps=2000):
    return torques(tyre, v, turn, steps)[0][2]


@pytest.mark.parametrize("kind", [MagicFormula, Soil])
def test_scrubbing_moment_on_a_curve_equals_the_brush_model(kind):
    tyre, curvature = kind(), 0.1
    tyres = tyre_set(tyre, TRACTOR)
    footing = Footing(1.0, tyres.cone_index)
    K_x = slip_stiffness(tyres.rear, LOAD, LOAD / STIFFNESS, footing, 0.0, 0.0)[0]
    assert moment(tyre, 1.0, curvature) == pytest.approx(-K_x * WIDTH**2 / 12 * curvature, rel=0.01)


def test_scrub_moment_on_the_spot_is_limited_by_width_and_friction():
    most = DRY_GRIP * LOAD * WIDTH / sqrt(8)
    assert moment(MagicFormula(), 0.0, 0.5) == pytest.approx(-most, rel=1e-6)


def test_contact_patch_without_length_has_no_aligning_moment():
    assert moment(MagicFormula(patch_half_length_m=0.0), 1.0, 0.2) == 0.0


def test_wheel_load_acts_at_the_patch_displaced_by_the_side_force():
    """The moment of the load about the forward axis is load times side force divided by lateral stiffness."""
    plain, force = torques(MagicFormula(load_follows_carcass=False), 1.0, 0.0, v_y=0.05)
    moved, same = torques(MagicFormula(), 1.0, 0.0, v_y=0.05)
    assert force == same != 0.0
    assert moved[0] - plain[0] == pytest.approx(LOAD * force / (0.45 * STIFFNESS), rel=1e-6)
    assert moved[1] == pytest.approx(plain[1], abs=1e-9)
