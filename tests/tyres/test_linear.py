"""Linear tyre law: slope, symmetry, unlimited force, and the cornering stiffness of the bicycle."""

from math import radians, tan

import numpy as np
import pytest
from wheel_steps import step_of

from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Bicycle
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import Linear
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.linear import LinearLaw
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, WheelMotion

TRACTOR, FLAT = TractorParameters(), Flat().ground()


def steady(wheel, side_slip=0.0, slip_ratio=0.0, speed=1.0, tyre=Linear()):
    """Return the steady forward and lateral force of wheel 0..3 at a deflection of 1 cm."""
    tyres = tyre_set(tyre, TRACTOR)
    radius = float(tyres.radius[wheel])
    spin = speed * (1 + slip_ratio) / (radius - 0.01 / 3)
    velocity, rotation = (speed, side_slip * speed, 0.0), (0.0, spin, 0.0)
    motion = WheelMotion((0.0, 0.0, radius - 0.01), (0.0, 1.0, 0.0), velocity, rotation)
    bristle, wrench, report = np.zeros(4), np.zeros(6), np.zeros(6)
    wheel_step = step_of(tyres, FLAT)
    for _ in range(5):
        wheel_step(tyres, wheel, FLAT, motion, 100.0, bristle, wrench, report)
    return report[FORCE_X], report[FORCE_Y]


@pytest.mark.parametrize(("wheel", "stiffness"), [(0, 7_400.0), (1, 7_400.0), (2, 15_000.0), (3, 15_000.0)])
@pytest.mark.parametrize("angle_deg", [-8.0, -0.1, 0.1, 2.0, 8.0])
@pytest.mark.parametrize("speed", [0.5, 4.0])
def test_side_force_is_cornering_stiffness_times_slip_angle(wheel, stiffness, angle_deg, speed):
    slip = tan(radians(angle_deg))
    f_x, f_y = steady(wheel, side_slip=slip, speed=speed)
    assert f_y == pytest.approx(-stiffness * slip, rel=1e-9)
    assert f_x == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("wheel", "stiffness"), [(0, 15_000.0), (2, 25_000.0)])
@pytest.mark.parametrize("slip", [-0.2, -0.01, 0.01, 0.2, 0.8])
def test_wheel_turning_faster_than_rolling_pushes_forward(wheel, stiffness, slip):
    assert steady(wheel, slip_ratio=slip)[0] == pytest.approx(stiffness * slip, rel=1e-9)


def test_linear_tyre_forces_are_unlimited_and_independent_per_axis():
    law, rest = LinearLaw(2.0, 3.0), (1000.0, 0.01, 1.0, Footing(1.0, 0.0))
    assert law.force(Slip(0.5, -4.0, *rest))[:3] == (-1.0, 12.0, 1.0)
    big, small = (law.force(Slip(s, s, *rest)) for s in (1e6, 1.0))
    assert big[:2] == pytest.approx(tuple(1e6 * f for f in small[:2]))


def test_four_linear_tyres_equal_the_two_axles_of_the_bicycle_model():
    front, rear = Linear().coefficients(TRACTOR)
    bicycle = Bicycle()
    assert 2 * front.C_alpha == pytest.approx(bicycle.front_cornering_stiffness_n_rad)
    assert 2 * rear.C_alpha == pytest.approx(bicycle.rear_cornering_stiffness_n_rad)


def test_tyre_dimensions_are_taken_from_the_tractor():
    tyres = tyre_set(Linear(relaxation_radii=2.0), TRACTOR)
    assert tyres.radius.tolist() == [0.28, 0.28, 0.42, 0.42]
    assert tyres.relaxation == pytest.approx(2.0 * np.array([[0.28] * 2, [0.28] * 2, [0.42] * 2, [0.42] * 2]))
    assert tyres.stiffness.tolist() == [TRACTOR.front_wheel.stiffness] * 2 + [TRACTOR.rear_wheel.stiffness] * 2
