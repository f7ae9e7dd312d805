"""Soil tyre on the rig: an independent implementation of the published formulas, trends, and combined slip."""

from itertools import product
from math import exp, hypot, radians, sqrt, tan

import numpy as np
import pytest
from wheel_steps import step_of

from agrobot_mj.extensions.bench.rig import FRONT, REAR, Rig, Setting
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import Soil
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, LOAD, WheelMotion

TRACTOR = TractorParameters()
SIZES = {
    FRONT: (0.16, 0.56, 0.28, TRACTOR.front_wheel.stiffness),
    REAR: (0.24, 0.84, 0.42, TRACTOR.rear_wheel.stiffness),
}
"""Section width, diameter, radius [m] and stiffness [N/m] of the default tyres."""
STATIC = {FRONT: TRACTOR.front_axle_load / 2, REAR: TRACTOR.rear_axle_load / 2}


def numbers(soil, wheel, W):
    """Return the mobility numbers of [Brixius1987] and [GeeCloughSommer1981]: CI b d / W with tyre factors."""
    b, d, _, k = SIZES[wheel]
    h, delta, CI = soil.section_height_share * b, W / k, 1e3 * soil.cone_index_kpa
    B_n = (CI * b * d / W) * (1 + 5 * delta / h) / (1 + 3 * b / d)
    M = (CI * b * d / W) * sqrt(delta / h) / (1 + b / (2 * d))
    return B_n, M


def longitudinal(soil, wheel, W, kappa):
    """Return gross traction minus motion resistance [N]. The tyre loss, 0.04 in both terms, acts as a moment."""
    B_n, _ = numbers(soil, wheel, W)
    s = kappa / (1 + kappa) if kappa > 0 else kappa
    gross = np.sign(s) * 0.88 * (1 - exp(-0.1 * B_n)) * (1 - exp(-7.5 * abs(s)))
    if soil.ply == "bias":
        return W * (gross - (1 / B_n + 0.5 * abs(s) / sqrt(B_n)))
    return W * (gross - (0.9 / B_n + 0.0325 - 0.04 + 0.5 * abs(s) / sqrt(B_n)))


def lateral_shape(soil, wheel, W):
    """Return the coefficients mu and B of the lateral force mu W (1 - exp(-B alpha)) [-, 1/rad]."""
    _, M = numbers(soil, wheel, W)
    if soil.ply == "bias":
        mu = 0.61 + 0.69 / M
        return mu, (2.34 + 0.088 * M) / mu
    return 0.8, (2.79 + 0.16 * M) / 0.8


def lateral(soil, wheel, W, alpha):
    mu, B = lateral_shape(soil, wheel, W)
    return -np.sign(alpha) * mu * W * (1 - exp(-B * abs(alpha)))


@pytest.mark.parametrize("ply", ["bias", "radial"])
@pytest.mark.parametrize("cone_index_kpa", [300.0, 1200.0, 2000.0])
@pytest.mark.parametrize("wheel", [FRONT, REAR])
def test_steady_pure_slip_force_equals_the_published_formula(ply, cone_index_kpa, wheel):
    soil = Soil(cone_index_kpa=cone_index_kpa, ply=ply)
    rig = Rig(soil, TRACTOR, wheel)
    for load, speed in product((0.5 * STATIC[wheel], 1.6 * STATIC[wheel]), (1.0, 4.0)):
        for kappa in (-0.9, -0.2, -0.01, 0.0, 0.03, 0.3, 0.9):
            fx = rig.steady(Setting(speed, 0.0, kappa, load)).fx
            assert fx == pytest.approx(longitudinal(soil, wheel, load, kappa), rel=1e-9, abs=1e-9)
        for alpha in np.radians([-60, -8, -0.5, 0.5, 3, 20, 60]):
            reading = rig.steady(Setting(speed, alpha, 0.0, load))
            assert reading.fy == pytest.approx(lateral(soil, wheel, load, alpha), rel=1e-9)
            assert reading.fx == pytest.approx(longitudinal(soil, wheel, load, 0.0), rel=1e-9)


@pytest.mark.parametrize("ply", ["bias", "radial"])
@pytest.mark.parametrize("wheel", [FRONT, REAR])
@pytest.mark.parametrize("load", [800.0, 3000.0])
def test_soil_force_law_evaluated_alone_equals_the_published_formula(ply, wheel, load):
    soil = Soil(cone_index_kpa=700.0, ply=ply)
    law, (*_, k) = soil.coefficients(TRACTOR)[wheel == REAR], SIZES[wheel]
    for kappa in (-0.9, -0.2, 0.03, 0.9):
        slip = Slip(-kappa, 0.0, load, load / k, 1.0, Footing(1.0, 7e5))
        assert law.force(slip).x + law.drag(slip, 1.0) == pytest.approx(longitudinal(soil, wheel, load, kappa))
    for alpha in (-0.5, 0.01, 1.0):
        force = law.force(Slip(0.0, tan(alpha), load, load / k, 1.0, Footing(1.0, 7e5)))
        assert (force.x, force.y) == pytest.approx((0.0, lateral(soil, wheel, load, alpha)))


@pytest.mark.parametrize(
    ("cone_index_kpa", "front", "rear"), [(450.0, 5.0, 8.9), (1200.0, 7.4, 15.0), (1800.0, 9.3, 20.0)]
)
def test_cornering_stiffness_at_each_cone_index_equals_documentation(cone_index_kpa, front, rear):
    """Values [kN/rad] in docs/reference/models.md are for deflections of a quarter of the section height."""
    soil = Soil(cone_index_kpa=cone_index_kpa)
    stiffnesses = [STATIC[wheel] / (0.25 * 0.75 * SIZES[wheel][0]) for wheel in (FRONT, REAR)]
    names = ("front_tyre_stiffness_n_m", "rear_tyre_stiffness_n_m")
    soft = TRACTOR.model_copy(update=dict(zip(names, stiffnesses, strict=True)))
    for wheel, expected in ((FRONT, front), (REAR, rear)):
        fy = Rig(soil, soft, wheel).steady(Setting(1.0, 1e-5, 0.0, STATIC[wheel])).fy
        assert -1e-3 * fy / 1e-5 == pytest.approx(expected, rel=0.05)


def test_cornering_force_increases_with_tyre_deflection():
    stiff, soft = (TRACTOR.model_copy(update={"front_tyre_stiffness_n_m": k}) for k in (2.4e5, 6e4))
    setting = Setting(1.0, radians(2), 0.0, STATIC[FRONT])
    assert Rig(Soil(), soft).steady(setting).fy < 1.2 * Rig(Soil(), stiff).steady(setting).fy < 0


def test_firmer_ground_gives_more_traction_and_less_motion_resistance():
    rigs = [Rig(Soil(cone_index_kpa=c), TRACTOR, REAR) for c in (300, 600, 1200, 2400)]
    pull = [rig.steady(Setting(1.0, 0.0, 0.2, 2300.0)).fx for rig in rigs]
    towed = [rig.steady(Setting(1.0, 0.0, 0.0, 2300.0)).fx for rig in rigs]
    assert (np.diff(pull) > 0).all()
    assert (np.diff(towed) > 0).all()
    assert max(towed) < 0


def test_motion_resistance_opposes_motion_in_both_directions():
    tyres, ground = tyre_set(Soil(), TRACTOR), Flat().ground()
    wheel_step = step_of(tyres, ground)
    pushes = []
    for v in (1.0, -1.0):
        bristle, wrench, report = np.zeros(4), np.zeros(6), np.zeros(6)
        motion = WheelMotion((0.0, 0.0, 0.27), (0.0, 1.0, 0.0), (v, 0.0, 0.0), (0.0, v / (0.28 - 0.01 / 3), 0.0))
        for _ in range(10):
            wheel_step(tyres, 0, ground, motion, 1.0, bristle, wrench, report)
        pushes.append(wrench[0])
    assert pushes[0] == pytest.approx(longitudinal(Soil(), FRONT, 0.01 * TRACTOR.front_wheel.stiffness, 0.0), rel=1e-6)
    assert pushes[1] == pytest.approx(-pushes[0])


def test_force_at_combined_slip_is_dissipative_and_within_the_ellipse():
    soil, v, W = Soil(), 1.0, 1400.0
    rig, reached = Rig(soil, TRACTOR), 0.0
    B_n, _ = numbers(soil, FRONT, W)
    D_x, D_y = 0.88 * (1 - exp(-0.1 * B_n)) * W, lateral_shape(soil, FRONT, W)[0] * W
    for alpha, kappa in product(np.radians([-60, -25, -6, -1, 1, 6, 25, 60]), [-0.9, -0.3, -0.05, 0.05, 0.3, 0.9]):
        fx, fy, *_ = rig.steady(Setting(v, alpha, kappa, W))
        s = kappa / (1 + kappa) if kappa > 0 else kappa
        # no rut is rolled sideways: by the slip the resistance counts as the cosine squared of motion and heading
        gross = fx + W * (1 / B_n + 0.5 * abs(s) / sqrt(B_n)) / (1 + (s * tan(alpha)) ** 2)
        used = hypot(gross / D_x, fy / D_y)
        assert used <= 1 + 1e-9
        assert gross * -kappa * v + fy * v * tan(alpha) < 0
        assert abs(fy) <= abs(lateral(soil, FRONT, W, alpha)) * (1 + 1e-9)
        reached = max(reached, used)
    assert reached > 0.9995


def test_forces_at_small_combined_slip_are_independent():
    """Both curves are nearly linear at small slip; the interaction is at most of second order in the slip."""
    rig, W = Rig(Soil(), TRACTOR), 1400.0
    alpha, s = radians(0.2), 0.002
    fx, fy, *_ = rig.steady(Setting(1.0, alpha, s / (1 - s), W))
    bend = 7.5 * s + lateral_shape(Soil(), FRONT, W)[1] * alpha
    rolling = longitudinal(Soil(), FRONT, W, 0.0)
    assert fx - rolling == pytest.approx(longitudinal(Soil(), FRONT, W, s / (1 - s)) - rolling, rel=bend)
    assert fy == pytest.approx(lateral(Soil(), FRONT, W, alpha), rel=bend)


def test_braking_force_mirrors_driving_force_at_equal_slip():
    soil, W = Soil(), 1400.0
    rig = Rig(soil, TRACTOR)
    driving = rig.steady(Setting(1.0, 0.0, 1.0, W)).fx  # s = 0.5 of the rim
    braking = rig.steady(Setting(1.0, 0.0, -0.5, W)).fx  # s = 0.5 of the ground
    lost = rig.steady(Setting(1.0, 0.0, 0.0, W)).fx - 0.5 * 0.5 / sqrt(numbers(soil, FRONT, W)[0]) * W
    assert driving - lost == pytest.approx(-(braking - lost), rel=1e-9)


def test_dragged_wheel_without_rotation_slides_at_its_friction_limit():
    tyres, ground = tyre_set(Soil(), TRACTOR), Flat().ground()
    wheel_step = step_of(tyres, ground)
    centre = (0.0, 0.0, 0.28 - TRACTOR.front_wheel.deflection)
    dragged = WheelMotion(centre, (0.0, 1.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.0))
    bristle, wrench, report, forces = np.zeros(4), np.zeros(6), np.zeros(6), []
    for _ in range(5000):
        wheel_step(tyres, 0, ground, dragged, 0.002, bristle, wrench, report)
        forces.append(report[FORCE_Y])
    mu, _ = lateral_shape(Soil(), FRONT, report[LOAD])
    grip = mu * report[LOAD] * (1 - exp(-3))  # breaks away where 95 % of the grip is used
    assert min(forces) >= -grip * 1.001
    assert np.ptp(forces[3500:]) < 1e-6 * grip
    assert forces[-1] == pytest.approx(-grip, rel=0.05)
    assert report[FORCE_X] == pytest.approx(0.0, abs=1e-6)
