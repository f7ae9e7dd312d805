"""Magic Formula on the tyre rig: published values, an independent implementation, and limits at any slip."""

from itertools import product
from math import atan, hypot, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wheel_steps import step_of

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.bench.rig import FRONT, REAR, Rig, Setting, load_specimen
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import MagicFormula
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.magic_formula import AxleTyre, Curve
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, LOAD, WheelMotion

TRACTOR, DEFAULT, DRY = TractorParameters(), MagicFormula(), Footing(1.0, 0.0)
PUBLISHED = """
[plant.tyre]
kind = "magic_formula"
[plant.tyre.front]
reference_load_n = 4000
[plant.tyre.front.lateral]
mu = 1.0489
mu_load = 0
stiffness_per_load = 21.92
stiffness_load = 0
shape = 1.3507
curvature = -0.0074722
"""
"""Parameters for pure lateral slip of commonroad-vehicle-models 3.0.2, at 4000 N and zero camber."""
ANGLES = np.radians([-55, -20, -9, -3, -0.4, 0.4, 3, 9, 20, 55])
RATIOS = [-0.95, -0.5, -0.15, -0.04, -0.003, 0.003, 0.04, 0.15, 0.5, 0.9]
LOADS = np.geomspace(60, 12_000, 10)
STATIC = 750 * 9.81 * 0.38 / 2, 750 * 9.81 * 0.62 / 2
"""Static loads of a front and a rear wheel, which are the reference loads of the tyre law [N]."""


def force(alpha, kappa, load, tyre=DEFAULT, wheel=FRONT):
    """Return the forward and lateral force of the tyre law for a rolling wheel [N]."""
    return tyre.coefficients(TRACTOR)[wheel // 2].force(Slip(-kappa, tan(alpha), load, 0.01, 1.0, DRY))[:2]


def written_out(s, load, reference, mu, mu_load, k, k_load, C, E):
    """Return the force in one direction by the published formula, and its maximum D."""
    df = (load - reference) / reference
    D = mu * max(1 + mu_load * df, 0.2) * load
    K = k * max(1 + k_load * df, 0.2) * load
    B = K / (C * D)
    return D * sin(C * atan(B * s - E * (B * s - atan(B * s)))), D


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    file = tmp_path_factory.mktemp("tyre") / "published.toml"
    file.write_text(PUBLISHED)
    return load_specimen(str(file)).tyre


@pytest.mark.parametrize(
    ("angle_deg", "newtons"), [(1, -1463.47), (2, -2602.80), (4, -3765.52), (8, -4193.33), (12, -4149.55)]
)
def test_published_lateral_force_curve_is_reproduced(published, angle_deg, newtons):
    rig = Rig(published, TRACTOR)
    assert rig.steady(Setting(2.0, radians(angle_deg), 0.0, 4000.0)).fy == pytest.approx(newtons, abs=0.5)
    assert rig.steady(Setting(2.0, -radians(angle_deg), 0.0, 4000.0)).fy == pytest.approx(-newtons, abs=0.5)


def test_published_tyre_coefficients_are_read_from_a_file(published):
    lateral = Curve(
        mu=1.0489, mu_load=0, stiffness_per_load=21.92, stiffness_load=0, shape=1.3507, curvature=-0.0074722
    )
    assert published.front == AxleTyre(reference_load_n=4000, lateral=lateral)
    assert published.rear == DEFAULT.rear


def test_tyre_file_overrides_only_the_keys_that_it_contains(tmp_path):
    (tmp_path / "t.toml").write_text('[plant.tyre]\nkind = "magic_formula"\n[plant.tyre.rear.longitudinal]\nmu = 0.5\n')
    tyre = load_specimen(str(tmp_path / "t.toml")).tyre
    assert tyre.rear.longitudinal == DEFAULT.rear.longitudinal.model_copy(update={"mu": 0.5})
    assert (tyre.front, tyre.rear.lateral) == (DEFAULT.front, DEFAULT.rear.lateral)


def test_invalid_tyre_coefficients_are_rejected_with_all_errors_listed(tmp_path):
    (tmp_path / "t.toml").write_text(
        '[plant.tyre]\nkind = "magic_formula"\n[plant.tyre.front.lateral]\nshape = 3\nmuu = 1\n'
    )
    with pytest.raises(ScenarioError, match=r"front\.lateral\.shape: must be at most 1\.9[^$]*did you mean 'mu'"):
        load_specimen(str(tmp_path / "t.toml"))


@pytest.mark.parametrize("wheel", [FRONT, REAR])
@pytest.mark.parametrize("load", [300.0, 1400.0, 2300.0, 5000.0])
@pytest.mark.parametrize("slip", [-0.6, -0.05, 0.01, 0.2, 1.2])
def test_pure_slip_force_equals_the_explicit_formula(wheel, load, slip):
    axle, static = (DEFAULT.front, STATIC[0]) if wheel == FRONT else (DEFAULT.rear, STATIC[1])
    across, along = axle.lateral, axle.longitudinal
    for curve, found in (
        (across, -force(slip, 0.0, load, wheel=wheel)[1]),
        (along, force(0.0, slip, load, wheel=wheel)[0]),
    ):
        numbers = (
            curve.mu,
            curve.mu_load,
            curve.stiffness_per_load,
            curve.stiffness_load,
            curve.shape,
            curve.curvature,
        )
        assert found == pytest.approx(written_out(slip, load, static, *numbers)[0], rel=1e-12)


def test_cornering_stiffness_at_static_load_equals_the_bicycle_model():
    for wheel, axle_load, stiffness in ((FRONT, TRACTOR.front_axle_load, 7400), (REAR, TRACTOR.rear_axle_load, 15000)):
        assert -force(1e-6, 0.0, axle_load / 2, wheel=wheel)[1] / 1e-6 == pytest.approx(stiffness, rel=0.02)


def test_tyre_force_is_bounded_odd_and_dissipative_at_1000_points():
    """The forces come from the kernel of the simulation."""
    rig, axle, v = Rig(DEFAULT, TRACTOR), DEFAULT.front, 1.0
    for alpha, kappa, load in product(ANGLES, RATIOS, LOADS):
        fx, fy, *_ = rig.steady(Setting(v, alpha, kappa, load))
        df = (load - STATIC[0]) / STATIC[0]
        D_x, D_y = (c.mu * max(1 + c.mu_load * df, 0.2) * load for c in (axle.longitudinal, axle.lateral))
        assert hypot(fx / D_x, fy / D_y) <= 1 + 1e-9
        assert (fx * kappa > 0, fy * alpha < 0) == (True, True)
        assert fx * -kappa * v + fy * v * tan(alpha) < 0
        assert force(-alpha, -kappa, load) == pytest.approx((-fx, -fy), rel=1e-8)


def test_maximum_force_of_all_test_points_reaches_the_friction_ellipse():
    """Without points on the ellipse, the test of the limit would be weak."""
    used = [hypot(*force(alpha, kappa, 1400.0)) / 1400.0 for alpha, kappa in product(ANGLES, RATIOS)]
    assert max(used) == pytest.approx(0.8, rel=0.03)
    assert min(used) < 0.05


@settings(deadline=None, max_examples=300)
@given(alpha=st.floats(-1.2, 1.2), kappa=st.floats(-0.99, 3), load=st.floats(10, 1e4), way=st.floats(0, 2 * pi))
def test_tyre_force_is_continuous(alpha, kappa, load, way):
    """A slip change h changes the force by at most twice the maximum stiffness times h."""
    h, stiffest = 1e-5, 10.0 * 1.25 * load
    near, far = force(alpha, kappa, load), force(alpha + h * np.cos(way), kappa + h * np.sin(way), load)
    assert hypot(far[0] - near[0], far[1] - near[1]) <= 2 * stiffest * h


def test_tyre_force_is_zero_without_slip():
    assert force(0.0, 0.0, 1400.0) == (0.0, 0.0)
    assert DEFAULT.coefficients(TRACTOR)[0].force(Slip(0.0, 0.0, 1400.0, 0.01, 0.0, DRY)).held == 1.0


def test_driving_slip_reduces_the_lateral_force():
    free = force(radians(4), 0.0, 1400.0)[1]
    driven = [force(radians(4), kappa, 1400.0)[1] for kappa in (0.02, 0.05, 0.1, 0.3, 1.0)]
    assert all(np.diff([free, *driven]) > 0)
    assert driven[-1] > 0.2 * free


def test_grip_and_stiffness_per_load_decrease_with_load_to_a_minimum():
    loads = np.geomspace(200, 2e5, 40)
    grip = [-min(force(a, 0.0, load)[1] for a in np.linspace(0, 1, 200)) / load for load in loads]
    stiffness = [-force(1e-6, 0.0, load)[1] / load for load in loads]
    assert (np.diff(grip) <= 1e-9).all()
    assert (np.diff(stiffness) <= 1e-9).all()
    assert min(grip) == pytest.approx(0.2 * 0.75, rel=1e-3)


@pytest.mark.parametrize("direction_deg", [0, 40, 90, 200])
def test_dragged_wheel_without_rotation_slides_at_its_friction_limit(direction_deg):
    """The bristles slide at the peak force: the force rises to the ellipse and stays constant."""
    tyres = tyre_set(DEFAULT, TRACTOR)
    penetration = 1440.0 / tyres.stiffness[0]
    way = radians(direction_deg)
    velocity = (0.05 * np.cos(way), 0.05 * np.sin(way), 0.0)
    bristle, wrench, report, used = np.zeros(4), np.zeros(6), np.zeros(6), []
    ground = Flat().ground()
    wheel_step = step_of(tyres, ground)
    for _ in range(5000):
        centre = (0.0, 0.0, tyres.radius[0] - penetration)
        still = (0.0, 0.0, 0.0)
        motion = WheelMotion(centre, (0.0, 1.0, 0.0), velocity, still)
        wheel_step(tyres, 0, ground, motion, 0.002, bristle, wrench, report)
        load = report[LOAD]
        used.append(hypot(report[FORCE_X] / (0.8 * load), report[FORCE_Y] / (0.75 * load)))
    assert max(used) <= 1.003  # the grip is a little higher at 1440 N than at the reference
    assert min(used[2500:]) > 0.95
    assert report[FORCE_X] * velocity[0] + report[FORCE_Y] * velocity[1] < 0


@pytest.mark.parametrize("mass", [400.0, 3600.0, 12_000.0])
@pytest.mark.parametrize("wheel", [FRONT, REAR])
def test_default_grip_and_stiffness_refer_to_the_static_wheel_load(mass, wheel):
    tractor = TractorParameters(mass_kg=mass, front_load_fraction=0.41)
    load = mass * 9.81 * (0.41 if wheel == FRONT else 0.59) / 2
    law = DEFAULT.coefficients(tractor)[wheel // 2]
    grip = max(law.force(Slip(0.0, -tan(a), load, 0.01, 1.0, DRY)).y for a in np.linspace(0, 1, 400)) / load
    stiffness = -law.force(Slip(0.0, 1e-6, load, 0.01, 1.0, DRY)).y / 1e-6 / load
    assert grip == pytest.approx(0.75, rel=1e-3)
    assert stiffness == pytest.approx(5.3 if wheel == FRONT else 6.6)


def test_specified_reference_load_applies_to_the_tractor_only():
    tyre = MagicFormula(rear=AxleTyre(reference_load_n=9000.0))
    assert tyre.coefficients(TRACTOR)[1].F_z0 == 9000.0
    assert tyre.of_implement().coefficients(TRACTOR)[1].F_z0 == TRACTOR.rear_wheel.load
