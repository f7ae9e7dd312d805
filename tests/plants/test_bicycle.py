"""The bicycle against the matrix exponential, python-control and its own limits."""

import control
import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from agrobot_mj.core.signals import Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.hydraulics import NEUTRAL_V
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.bicycle import Bicycle, BicycleLaw, BicyclePlant, lateral_dynamics, step
from agrobot_mj.terrain import Flat

TRACTOR, SPEC = TractorParameters(), Bicycle()
LAW = BicycleLaw(
    m=TRACTOR.mass_kg,
    I_z=TRACTOR.yaw_inertia_kg_m2,
    l_f=TRACTOR.cg_to_front_axle,
    l_r=TRACTOR.cg_to_rear_axle,
    C_f=SPEC.front_cornering_stiffness_n_rad,
    C_r=SPEC.rear_cornering_stiffness_n_rad,
    steer_limit=TRACTOR.steer_limit,
    displacement=1e-4,
)


def matrices(law, u):
    """A and B written independently from the equations of motion with the tyre forces put in."""
    C_f, C_r, l_f, l_r, s = law.C_f, law.C_r, law.l_f, law.l_r, abs(u)
    force_v = -(C_f + C_r) / s
    force_g = -(C_f * l_f - C_r * l_r) / s
    moment_v = -(l_f * C_f - l_r * C_r) / s
    moment_g = -(l_f**2 * C_f + l_r**2 * C_r) / s
    A = np.array([[force_v / law.m, force_g / law.m - u], [moment_v / law.I_z, moment_g / law.I_z]])
    return A, np.sign(u) * np.array([C_f / law.m, l_f * C_f / law.I_z])


def run(law, u, delta, seconds, dt=0.002, state=(0.0, 0.0, 0.0, 0.0, 0.0)):
    state = np.array([*state, 0.0, 0.0])
    for _ in range(round(seconds / dt)):
        step(law, state, u, delta, dt)
    return state[:5]


def exact(law, u, delta, seconds):
    """(x, y, yaw, v, gamma) by matrix exponential and adaptive quadrature."""
    A, B = matrices(law, u)
    big = np.zeros((4, 4))
    big[:2, :2], big[:2, 3], big[2, 1] = A, B * delta, 1.0
    start = np.array([0.0, 0.0, 0.0, 1.0])

    def velocity(t):
        v, _, psi, _ = expm(big * t) @ start
        return np.array([u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)])

    v, gamma, psi, _ = expm(big * seconds) @ start
    (x, y), _ = quad_vec(velocity, 0.0, seconds, epsabs=1e-10, limit=2000)
    return np.array([x, y, psi, v, gamma])


@pytest.mark.parametrize("u", [0.3, 1.2, 4.0, -0.3, -3.0])
@pytest.mark.parametrize("delta", [0.05, -0.6])
def test_equals_the_matrix_exponential(u, delta):
    assert run(LAW, u, delta, 5.0) == pytest.approx(exact(LAW, u, delta, 5.0), abs=1e-6)


def test_equals_the_matrix_exponential_when_the_poles_are_complex():
    law = LAW._replace(C_r=9_000.0, C_f=4_000.0, I_z=800.0)
    A, _ = matrices(law, 6.0)
    law = law if np.iscomplex(np.linalg.eigvals(A)).any() else law._replace(C_f=2_000.0)
    A, _ = matrices(law, 6.0)
    assert np.iscomplex(np.linalg.eigvals(A)).any()
    assert run(law, 6.0, 0.02, 3.0) == pytest.approx(exact(law, 6.0, 0.02, 3.0), abs=1e-6)


@pytest.mark.parametrize("u", [0.5, 1.0, 2.0, 4.0])
def test_steady_yaw_gain_equals_python_control(u):
    a = lateral_dynamics(LAW, u)
    A, B = matrices(LAW, u)
    assert np.array([[a.A11, a.A12], [a.A21, a.A22]]) == pytest.approx(A)
    system = control.ss(A, B[:, None], [[0, 1]], [[0]])
    gain = run(LAW, u, 0.01, 30.0)[4] / 0.01
    assert gain == pytest.approx(float(control.dcgain(system)), rel=1e-6)


@pytest.mark.parametrize("u", [-0.06, -1.0, -4.0])
def test_a_steady_reverse_circle_is_tighter_for_the_understeer(u):
    """The tyre forces that hold the circle are those of u gamma; the slip angles add to the steering: L - K u^2."""
    C_f, C_r, l_f, l_r, m, L = LAW.C_f, LAW.C_r, LAW.l_f, LAW.l_r, LAW.m, LAW.l_f + LAW.l_r
    understeer = m * (l_r * C_r - l_f * C_f) / (L * C_f * C_r)
    assert understeer > 0
    gamma = run(LAW, u, 0.3, 30.0)[4]
    assert gamma == pytest.approx(u * 0.3 / (L - understeer * u**2), rel=1e-6)
    assert gamma < u * 0.3 / L < 0


@pytest.mark.parametrize("u", [0.5, 3.0])
def test_reverse_is_forward_with_the_axles_swapped(u):
    """Seen by an observer who faces backwards: the steered axle is behind and turns the other way."""
    swapped = LAW._replace(l_f=LAW.l_r, l_r=LAW.l_f, C_f=LAW.C_r, C_r=LAW.C_f)
    back, turned = lateral_dynamics(LAW, -u), lateral_dynamics(swapped, u)
    assert pytest.approx((turned.A11, turned.A22)) == (back.A11, back.A22)
    assert pytest.approx((turned.A12, turned.A21)) == (-back.A12, -back.A21)
    # the steered wheel's force and its moment, with the observer's left and a lever arm behind the CG
    assert pytest.approx((LAW.C_f / LAW.m, -LAW.l_f * LAW.C_f / LAW.I_z)) == (-back.B1, back.B2)


@pytest.mark.parametrize("u", [0.2, 1.0])
def test_at_low_speed_reverse_retraces_the_way_ahead(u):
    there = run(LAW, u, 0.3, 5.0)
    back = run(LAW, -u, 0.3, 5.0, state=(*there[:3], *run(LAW, -u, 0.3, 5.0)[3:]))
    assert back[:3] == pytest.approx([0.0, 0.0, 0.0], abs=0.02 * u**2)


def test_the_yaw_rate_is_continuous_into_reverse():
    speeds = np.linspace(-0.06, 0.06, 25)
    gammas = [run(LAW, v, 0.3, 5.0)[4] for v in speeds]
    assert gammas == pytest.approx(speeds * 0.3 / TRACTOR.wheelbase_m, rel=1e-4, abs=1e-9)


def test_crawling_is_kinematic_and_standing_still_is_still():
    slow = run(LAW, 0.02, 0.3, 10.0)
    assert slow[2] == pytest.approx(0.02 * 0.3 / TRACTOR.wheelbase_m * 10.0, rel=1e-3)
    assert run(LAW, 0.0, 0.3, 1.0) == pytest.approx(np.zeros(5), abs=1e-12)


def test_a_driven_bicycle_stops_its_steering_at_the_limit_and_leaves_the_field():
    plant = BicyclePlant(SPEC, Machine(), Flat(half_size_m=20).ground())
    truth = plant.reset(Reference(0, 0, 0, 0, 0.0, 0))
    for _ in range(100):
        truth = plant.advance(Drive(12.0, NEUTRAL_V))
    assert truth.steer == pytest.approx(TRACTOR.steer_limit)
    assert plant.trouble() is None
    for _ in range(100):
        truth = plant.advance(Drive(0.0 if truth.steer > 0.02 else NEUTRAL_V, NEUTRAL_V))
    for _ in range(400):
        truth = plant.advance(Drive(NEUTRAL_V, 12.0))
        if plant.trouble():
            break
    assert plant.trouble() == "left_terrain"
    assert truth.rear_x == pytest.approx(truth.x - LAW.l_r * np.cos(truth.yaw))
