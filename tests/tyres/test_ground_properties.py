"""Friction and soil properties of the ground below a wheel, with every tyre law."""

import numpy as np
import pytest
from turns import by_turns
from wheel_steps import step_of

from agrobot_mj.core.spec import every
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.terrain.grid import Surface, plane
from agrobot_mj.terrain.patches import RectanglePatch
from agrobot_mj.tyres import Linear, MagicFormula, Soil, Tyre
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, FRICTION_USE, LOAD, WheelMotion, find_patch

LAWS = [law for law in every(Tyre) if law().judged]
REAR, SPEED = 2, 1.5
RADIUS, SUNK = TractorParameters().rear_wheel_radius_m, TractorParameters().rear_wheel.deflection


def ground(**properties):
    """Return level ground with a patch of 4 m about the origin."""
    return Flat(patch=(RectanglePatch(length_m=4.0, width_m=4.0, **properties),)).ground()


def steady(tyre, on, slip_x=0.0, slip_y=0.0, x=0.0, grip=1.0, share=1.0):
    """Return the steady report of a rear wheel, for slips as ratio (positive when driving) and tangent."""
    tyres = tyre_set(tyre, TractorParameters())
    tyres.grip[:], tyres.carcass[:, 0] = grip, share
    bristle, wrench, report = np.zeros(4), np.zeros(6), np.zeros(6)
    centre, velocity = (x, 0.0, RADIUS - SUNK), (SPEED, SPEED * slip_y, 0.0)
    rotation = (0.0, SPEED * (1 + slip_x) / (RADIUS - SUNK / 3), 0.0)
    motion = WheelMotion(centre, (0.0, 1.0, 0.0), velocity, rotation)
    wheel_step = step_of(tyres, on)
    for _ in range(3000):
        wheel_step(tyres, REAR, on, motion, 0.002, bristle, wrench, report)
    return report


@pytest.mark.parametrize(
    ("tyre", "where"),
    by_turns([pytest.param(tyre, id=tyre.kind) for tyre in (MagicFormula(), Soil())], ["patch", "fault"]),
)
def test_ground_friction_scales_peak_force_but_not_slip_stiffness(tyre, where):
    dry, grip = Flat().ground(), 0.5
    wet = ground(friction=grip) if where == "patch" else dry
    scale = 1.0 if where == "patch" else grip
    for slips, force in (((1.0, 0.0), FORCE_X), ((0.0, 1.0), FORCE_Y)):
        push = resisting(tyre) if force == FORCE_X else 0.0
        x, y = slips
        peaks = [
            max(abs(steady(tyre, on, s * x, s * y, grip=g)[force] + push) for s in (0.05, 0.1, 0.2, 0.4, 0.8, 1.2))
            for on, g in ((dry, 1.0), (wet, scale))
        ]
        assert peaks[1] / peaks[0] == pytest.approx(grip, rel=0.1)
        small = [steady(tyre, on, 0.002 * x, 0.002 * y, grip=g)[force] + push for on, g in ((dry, 1.0), (wet, scale))]
        assert small[1] == pytest.approx(small[0], rel=0.03)


def resisting(tyre):
    """Return the motion resistance of the soil at zero slip [N]."""
    return -steady(tyre, Flat().ground())[FORCE_X] if isinstance(tyre, Soil) else 0.0


@pytest.mark.parametrize("law", [MagicFormula, Soil])
def test_lower_ground_friction_increases_the_used_friction_fraction(law):
    dry, wet = (steady(law(), on, slip_x=0.03) for on in (Flat().ground(), ground(friction=0.5)))
    assert wet[FRICTION_USE] > 1.5 * dry[FRICTION_USE]
    assert dry[FRICTION_USE] > 0.1


@pytest.mark.parametrize("slips", [(0.1, 0.0), (0.0, -0.15), (-0.3, 0.2)])
def test_tyre_on_a_soil_patch_equals_a_tyre_configured_for_that_soil(slips):
    on_patch = steady(Soil(cone_index_kpa=1500), ground(cone_index_kpa=500.0), *slips)
    own = steady(Soil(cone_index_kpa=500), Flat().ground(), *slips)
    beside = steady(Soil(cone_index_kpa=1500), ground(cone_index_kpa=500.0), *slips, x=5.0)
    firm = steady(Soil(cone_index_kpa=1500), Flat().ground(), *slips)
    assert on_patch.tobytes() == own.tobytes()
    assert beside.tobytes() == firm.tobytes()
    assert np.abs(own - firm).max() > 50


def test_a_friction_patch_leaves_the_soil_unchanged():
    alone = steady(Soil(), ground(friction=1.0), 0.1, 0.1)
    assert alone.tobytes() == steady(Soil(), Flat().ground(), 0.1, 0.1).tobytes()


@pytest.mark.parametrize("slips", [(0.02, 0.0), (0.3, 0.3)])
def test_linear_tyre_ignores_friction_and_soil(slips):
    special = steady(Linear(), ground(friction=0.2, cone_index_kpa=300.0), *slips, grip=0.5)
    assert special.tobytes() == steady(Linear(), Flat().ground(), *slips).tobytes()


@pytest.mark.parametrize("slips", [(0.3, 0.3)])
def test_magic_formula_tyre_ignores_soil(slips):
    special = steady(MagicFormula(), ground(cone_index_kpa=300.0), *slips)
    assert special.tobytes() == steady(MagicFormula(), Flat().ground(), *slips).tobytes()


@pytest.mark.parametrize("law", LAWS)
def test_soft_carcass_reduces_slip_stiffness_but_not_peak_force(law):
    firm, soft = (steady(law(), Flat().ground(), slip_y=0.004, share=share)[FORCE_Y] for share in (1.0, 0.4))
    assert soft == pytest.approx(0.4 * firm, rel=0.03)
    if law is not Linear:
        slips = (0.2, 0.5, 1.0, 3.0)
        peaks = [
            max(-steady(law(), Flat().ground(), slip_y=s, share=share)[FORCE_Y] for s in slips) for share in (1, 0.4)
        ]
        assert peaks[1] == pytest.approx(peaks[0], rel=0.05)
    assert steady(law(), Flat().ground(), share=0.4)[LOAD] == steady(law(), Flat().ground())[LOAD]


def test_friction_on_a_slope_is_evaluated_at_the_contact_point():
    """The contact is uphill of the point below the wheel centre, where half the friction halves the sliding force."""
    slope, tyres = plane(0.5, -0.2, 4.0), tyre_set(MagicFormula(), TractorParameters())
    n = np.array([-0.5, 0.2, 1.0]) / np.sqrt(1.29)
    axle = np.array([-np.sin(-0.6), np.cos(-0.6), 0.0])
    aside = SPEED * (axle - (axle @ n) * n)
    motion = WheelMotion(tuple((RADIUS - SUNK) * n), tuple(axle), tuple(aside), (0.0, 0.0, 0.0))
    arm = find_patch(slope, RADIUS, motion).arm
    x, y, _ = np.add(motion.centre, arm)
    assert min(abs(arm[0]), abs(arm[1]), abs(arm[0] - arm[1])) > 0.02
    forces = []
    for west in (x - 0.02, x + 10.0):
        wet = slope._replace(surface=Surface(west, y - 0.02, 0.04, np.array([[0.5]]), np.array([[0.0]])))
        bristle, wrench, report = np.zeros(4), np.zeros(6), np.zeros(6)
        wheel_step = step_of(tyres, wet)
        for _ in range(1000):
            wheel_step(tyres, REAR, wet, motion, 0.002, bristle, wrench, report)
        forces.append(report[FORCE_Y] / report[LOAD])
    assert forces[0] / forces[1] == pytest.approx(0.5, rel=0.01)
