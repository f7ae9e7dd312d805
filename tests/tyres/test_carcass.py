"""Tyre carcass: stiffness from its keys, and relaxation length as slip stiffness divided by carcass stiffness."""

import numpy as np
import pytest
from wheel_steps import step_of

from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import Linear, MagicFormula, Ruts, Soil
from agrobot_mj.tyres.bearing import FIRM
from agrobot_mj.tyres.laws import carry, treads, tyre_set
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, WheelMotion, find_patch

TRACTOR, GROUND, DT = TractorParameters(), Flat().ground(), 0.002
REAR, VERTICAL, RADIUS = 2, TRACTOR.rear_wheel.stiffness, 0.42
KEYS = {"carcass_lateral": 0.45, "carcass_longitudinal": 0.6, "bristle_damping_s": 0.0}
TYRES = [MagicFormula(**KEYS), Soil(**KEYS), Ruts(**KEYS)]


def forces(tyre, v_x, v_y, rim, steps, load=2300.0, share=1.0):
    """Return forward and left forces after each step of a constant motion, shape (steps, 2) [N]."""
    tyres = tyre_set(tyre, TRACTOR)
    tyres.carcass[:, 0], tyres.stiffness[:] = share, tyres.stiffness * share
    sunk = load / tyres.stiffness[REAR]
    motion = WheelMotion(
        (0.0, 0.0, RADIUS - sunk), (0.0, 1.0, 0.0), (v_x, v_y, 0.0), (0.0, rim / (RADIUS - sunk / 3), 0.0)
    )
    bristle, wrench, report, out = np.zeros(4), np.zeros(6), np.zeros(6), []
    wheel_step = step_of(tyres, GROUND)
    for _ in range(steps):
        wheel_step(tyres, REAR, GROUND, motion, DT, bristle, wrench, report)
        out.append((report[FORCE_X], report[FORCE_Y]))
    return np.array(out)


@pytest.mark.parametrize("tyre", TYRES, ids=lambda tyre: tyre.kind)
@pytest.mark.parametrize("load", [800.0, 2300.0, 4000.0])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_carcass_stiffness_at_rest_is_a_fraction_of_vertical_stiffness(tyre, load, share):
    """A softer tyre loses the same fraction of stiffness in all directions."""
    pushed = forces(tyre, 0.0, 0.01, 0.0, 5, load, share)[-1, 1] / (5 * DT * 0.01)
    dragged = forces(tyre, 0.0, 0.0, 0.01, 5, load, share)[-1, 0] / (5 * DT * 0.01)
    assert -pushed == pytest.approx(0.45 * share * VERTICAL, rel=0.02)
    assert dragged == pytest.approx(0.6 * share * VERTICAL, rel=0.02)


@pytest.mark.parametrize("tyre", TYRES, ids=lambda tyre: tyre.kind)
def test_relaxation_length_is_slip_stiffness_divided_by_carcass_stiffness(tyre):
    slip, v, lengths = 0.003, 1.0, []
    for load in (800.0, 2300.0, 4000.0):
        F = forces(tyre, v, slip * v, v, 1500, load)[:, 1]
        lengths.append(np.argmax(F[-1] * (1 - np.exp(-1)) >= F) * DT * v)
        assert lengths[-1] == pytest.approx(-F[-1] / slip / (0.45 * VERTICAL), rel=0.05, abs=DT * v)
    assert (np.diff(lengths) > 0).all()


@pytest.mark.parametrize("tyre", TYRES, ids=lambda tyre: tyre.kind)
def test_steady_state_tyre_force_is_independent_of_carcass_stiffness(tyre):
    plain = tyre.model_copy(update={"carcass_lateral": 0.2, "carcass_longitudinal": 0.3})
    for motion in ((1.0, 0.1, 1.0), (1.0, 0.0, 1.2), (1.0, 0.4, 0.3), (0.5, 0.1, 2.0)):
        stiff, soft = (forces(each, *motion, 12_000)[-1] for each in (tyre, plain))
        assert stiff == pytest.approx(soft, abs=0.5)


@pytest.mark.parametrize("end", [0, 1], ids=["front", "rear"])
def test_carcass_stiffness_per_area_reproduces_the_static_load(end):
    """A plane cuts pi/2 times depth and half axes off a paraboloid, and 4/3 of depth and half length off a cylinder."""
    R, b, k = np.array(
        [
            (TRACTOR.front_wheel_radius_m, TRACTOR.front_wheel_width_m, TRACTOR.front_wheel.stiffness),
            (TRACTOR.rear_wheel_radius_m, TRACTOR.rear_wheel_width_m, TRACTOR.rear_wheel.stiffness),
        ]
    )[end]
    load = (TRACTOR.front_axle_load, TRACTOR.rear_axle_load)[end] / 2
    sunk = load / k
    half = np.sqrt(2 * R * sunk)
    narrow, flat = 0.4 * b, 1e6 * b
    assert np.sqrt(2 * narrow * sunk) < b / 2
    volumes = {narrow: np.pi / 2 * sunk * half * np.sqrt(2 * narrow * sunk), flat: 4 / 3 * sunk * half * b}
    for crown, volume in volumes.items():
        tread = treads(FIRM._replace(crown_share=crown / b), TRACTOR)[end]
        assert tread[:3] == pytest.approx((R, b, crown))
        assert tread.stiffness * volume == pytest.approx(load, rel=0.015)


@pytest.mark.parametrize("wheel", range(4))
def test_wheel_load_on_firm_ground_is_the_tyre_spring_force(wheel):
    tyres, sunk = tyre_set(MagicFormula(), TRACTOR), 0.02
    R = float(tyres.radius[wheel])
    motion = WheelMotion((1.0, -2.0, R - sunk), (0.0, 1.0, 0.0), (1.0, 0.2, 0.0), (0.0, 1.0 / R, 0.0))
    patch = find_patch(GROUND, R, motion)
    assert carry(tyres, wheel, GROUND, patch, motion.centre, 0.1) == pytest.approx(
        (tyres.stiffness[wheel] * sunk, 0.0, 0.0, 0.0, 0.0, sunk)
    )


@pytest.mark.parametrize("tyre", TYRES, ids=lambda tyre: tyre.kind)
def test_carcass_moved_from_rest_acts_as_a_spring_and_damper(tyre):
    """After one step, the force is stiffness times distance plus damping time times speed, in both directions."""
    tau, v = 0.02, 0.001
    damped = tyre.model_copy(update={"bristle_damping_s": tau})
    pushed, dragged = forces(damped, 0.0, v, 0.0, 1)[0, 1], forces(damped, 0.0, 0.0, v, 1)[0, 0]
    assert -pushed == pytest.approx(0.45 * VERTICAL * v * (DT + tau), rel=0.02)
    assert dragged == pytest.approx(0.6 * VERTICAL * v * (DT + tau), rel=0.02)


def test_specified_relaxation_length_applies_at_every_load():
    """The tyre of the paper has a relaxation length instead of a stiffness, independent of the load."""
    tyre = Linear(relaxation_radii=1.5, bristle_damping_s=0.0)
    assert tyre_set(tyre, TRACTOR).relaxation[REAR] == pytest.approx((0.63, 0.63))
    for load in (800.0, 4000.0):
        F = forces(tyre, 1.0, 0.003, 1.0, 3000, load)[:, 1]
        assert np.argmax(F[-1] * (1 - np.exp(-1)) >= F) * DT == pytest.approx(0.63, rel=0.02)
