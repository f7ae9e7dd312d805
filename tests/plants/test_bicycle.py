"""Bicycle plant compared with the matrix exponential, python-control, and limiting cases."""

import control
import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from agrobot_mj.core.signals import NOMINAL, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.hydraulics import NEUTRAL_V
from agrobot_mj.machine.linkage import Linkage
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
    """Return A and B, derived independently from the equations of motion with the tyre forces inserted."""
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
    """Return x, y, yaw, v and gamma by the matrix exponential and adaptive quadrature."""
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
def test_bicycle_step_equals_the_matrix_exponential(u, delta):
    assert run(LAW, u, delta, 5.0) == pytest.approx(exact(LAW, u, delta, 5.0), abs=1e-6)


def test_bicycle_step_with_complex_poles_equals_the_matrix_exponential():
    law = LAW._replace(C_r=9_000.0, C_f=4_000.0, I_z=800.0)
    A, _ = matrices(law, 6.0)
    law = law if np.iscomplex(np.linalg.eigvals(A)).any() else law._replace(C_f=2_000.0)
    A, _ = matrices(law, 6.0)
    assert np.iscomplex(np.linalg.eigvals(A)).any()
    assert run(law, 6.0, 0.02, 3.0) == pytest.approx(exact(law, 6.0, 0.02, 3.0), abs=1e-6)


@pytest.mark.parametrize("u", [0.5, 1.0, 2.0, 4.0])
def test_steady_state_yaw_gain_agrees_with_the_python_control_library(u):
    a = lateral_dynamics(LAW, u)
    A, B = matrices(LAW, u)
    assert np.array([[a.A11, a.A12], [a.A21, a.A22]]) == pytest.approx(A)
    system = control.ss(A, B[:, None], [[0, 1]], [[0]])
    gain = run(LAW, u, 0.01, 30.0)[4] / 0.01
    assert gain == pytest.approx(float(control.dcgain(system)), rel=1e-6)


@pytest.mark.parametrize("u", [-0.06, -1.0, -4.0])
def test_understeering_tractor_turns_tighter_in_reverse(u):
    """In reverse, the slip angles increase the effect of the steering, so that L is replaced by L - K u^2."""
    C_f, C_r, l_f, l_r, m, L = LAW.C_f, LAW.C_r, LAW.l_f, LAW.l_r, LAW.m, LAW.l_f + LAW.l_r
    understeer = m * (l_r * C_r - l_f * C_f) / (L * C_f * C_r)
    assert understeer > 0
    gamma = run(LAW, u, 0.3, 30.0)[4]
    assert gamma == pytest.approx(u * 0.3 / (L - understeer * u**2), rel=1e-6)
    assert gamma < u * 0.3 / L < 0


@pytest.mark.parametrize("u", [0.5, 3.0])
def test_driving_in_reverse_equals_driving_forward_with_swapped_axles(u):
    """For an observer facing backwards, the steered axle is behind and turns in the opposite direction."""
    swapped = LAW._replace(l_f=LAW.l_r, l_r=LAW.l_f, C_f=LAW.C_r, C_r=LAW.C_f)
    back, turned = lateral_dynamics(LAW, -u), lateral_dynamics(swapped, u)
    assert pytest.approx((turned.A11, turned.A22)) == (back.A11, back.A22)
    assert pytest.approx((turned.A12, turned.A21)) == (-back.A12, -back.A21)
    # the steered wheel's force and its moment, with the observer's left and a lever arm behind the CG
    assert pytest.approx((LAW.C_f / LAW.m, -LAW.l_f * LAW.C_f / LAW.I_z)) == (-back.B1, back.B2)


@pytest.mark.parametrize("u", [0.2, 1.0])
def test_slow_reverse_driving_retraces_the_forward_path(u):
    there = run(LAW, u, 0.3, 5.0)
    back = run(LAW, -u, 0.3, 5.0, state=(*there[:3], *run(LAW, -u, 0.3, 5.0)[3:]))
    assert back[:3] == pytest.approx([0.0, 0.0, 0.0], abs=0.02 * u**2)


def test_yaw_rate_is_continuous_through_standstill():
    speeds = np.linspace(-0.06, 0.06, 25)
    gammas = [run(LAW, v, 0.3, 5.0)[4] for v in speeds]
    assert gammas == pytest.approx(speeds * 0.3 / TRACTOR.wheelbase_m, rel=1e-4, abs=1e-9)


def test_model_is_kinematic_at_low_speed_and_does_not_move_at_standstill():
    slow = run(LAW, 0.02, 0.3, 10.0)
    assert slow[2] == pytest.approx(0.02 * 0.3 / TRACTOR.wheelbase_m * 10.0, rel=1e-3)
    assert run(LAW, 0.0, 0.3, 1.0) == pytest.approx(np.zeros(5), abs=1e-12)


def test_bicycle_respects_its_steering_limit_and_detects_leaving_terrain():
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


def driven(voltages, seconds, machine=Machine(), start=Reference(4.0, -3.0, 0, 0, 0.8, 0)):
    """Return a bicycle and its true states from rest with constant voltages."""
    plant = BicyclePlant(SPEC, machine, Flat(half_size_m=200).ground())
    plant.reset(start)
    return plant, [plant.advance(Drive(*voltages)) for _ in range(round(seconds / 0.05))]


@pytest.mark.parametrize("pedal_v", [8.0, 4.0])
def test_antenna_position_is_the_integral_of_its_velocity(pedal_v):
    """In a bend, the antenna above the rear axle is slower than the CG and moves in another direction."""
    _, truths = driven((7.5, pedal_v), 6.0)
    before, now, after = truths[-3:]
    rate = (np.array(after.antenna) - np.array(before.antenna)) / 0.1
    assert abs(now.yaw_rate) > 0.1
    assert now.antenna_velocity == pytest.approx(rate, abs=0.01 * abs(now.speed))
    assert now.antenna[:2] == pytest.approx((now.rear_x, now.rear_y))
    assert now.antenna[2] == TRACTOR.antenna_height_m
    heading = np.array([np.cos(now.yaw), np.sin(now.yaw)])
    assert np.array([now.x, now.y]) - [now.rear_x, now.rear_y] == pytest.approx(LAW.l_r * heading)


def test_truth_values_equal_the_bicycle_state():
    plant, truths = driven((7.5, 8.0), 4.0)
    last = truths[-1]
    x, y, yaw, v, gamma, delta = plant.state[:6]
    assert (last.x, last.y, last.lateral_speed, last.yaw_rate, last.steer) == (x, y, v, gamma, delta)
    assert last.t == pytest.approx(4.0)
    assert np.cos(last.yaw - yaw) == pytest.approx(1.0)
    assert last.body_rates == (0.0, 0.0, gamma)
    assert last.wheel_speed == last.speed > 0.5
    assert last.steer_samples[-1] == delta
    assert (last.steer_samples > 0).all()
    assert last.pedal_samples[-1] == last.pedal > 0
    assert not np.array_equal(last.steer_samples, last.pedal_samples)
    assert (last.z, last.roll, last.pitch) == (TRACTOR.cg_height_m, 0.0, 0.0)


@pytest.mark.parametrize("volts", [8.5, 3.5])
def test_steered_wheels_follow_ackermann_geometry(volts):
    """All wheel axes meet at the turning centre: cot(outer) - cot(inner) = track / wheelbase."""
    _, truths = driven((volts, NEUTRAL_V), 1.5)
    left, right = truths[-1].knuckle_samples[:, -1]
    assert abs(left) > 0.2
    assert 1 / np.tan(right) - 1 / np.tan(left) == pytest.approx(TRACTOR.track_m / TRACTOR.wheelbase_m)


def test_steering_rate_equals_oil_flow_divided_by_displacement():
    machine = Machine()
    _, truths = driven((9.0, NEUTRAL_V), 2.0)
    rate = (truths[-1].steer - truths[-11].steer) / 0.5
    flow = 3.2e-3 / 60 * (3.0 - 0.4)  # left gain over the dead band
    assert rate == pytest.approx(flow / machine.cylinder.displacement, rel=1e-3)


@pytest.mark.parametrize("side", [1, -1])
def test_wheels_do_not_move_until_the_cylinder_has_crossed_the_backlash(side):
    machine = Machine(linkage=Linkage(backlash_deg=4.0))
    plant, truths = driven((NEUTRAL_V + 3 * side, NEUTRAL_V), 1.5, machine)
    there = truths[-1].steer
    play = np.radians(2.0)
    assert side * (plant.state[7] - there) == pytest.approx(play)
    back = [plant.advance(Drive(NEUTRAL_V - 3 * side, NEUTRAL_V)) for _ in range(40)]
    assert side * (plant.state[7] - back[-1].steer) == pytest.approx(-play)
    waited = [truth.steer for truth in back if truth.steer == max(t.steer * side for t in back) * side]
    assert len(waited) >= 2
    for _ in range(200):
        end = plant.advance(Drive(NEUTRAL_V + 6 * side, NEUTRAL_V))
    assert end.steer == pytest.approx(side * TRACTOR.steer_limit)  # the play does not take from the lock


def test_wheels_rotate_with_distance_and_worn_valve_reduces_oil_flow():
    plant, truths = driven((NEUTRAL_V, 8.0), 3.0)
    way = np.hypot(truths[-1].x - 4.0, truths[-1].y + 3.0)
    assert plant.state[6] == pytest.approx(way, rel=1e-6)
    sound, worn = (
        BicyclePlant(SPEC, Machine(), Flat().ground()),
        BicyclePlant(SPEC, Machine(), Flat().ground()),
    )
    for plant in (sound, worn):
        plant.reset(Reference(0, 0, 0, 0, 0.0, 0))
    tired = NOMINAL._replace(valve_gain=0.5, valve_dead_band=0.3)
    for _ in range(20):
        fresh, less = sound.advance(Drive(9.0, NEUTRAL_V)), worn.advance(Drive(9.0, NEUTRAL_V), tired)
    assert less.steer / fresh.steer == pytest.approx(0.5 * (3.0 - 0.7) / (3.0 - 0.4), rel=0.03)
    assert worn.actuation()[0] == pytest.approx(0.5 * 3.2e-3 / 60 * (3.0 - 0.7), rel=1e-3)


def test_restored_bicycle_repeats_its_motion_and_nan_state_diverges():
    plant, _ = driven((8.0, 8.0), 2.0)
    kept = plant.save()
    ahead = [plant.advance(Drive(5.0, 7.0)) for _ in range(10)][-1]
    plant.restore(kept)
    again = [plant.advance(Drive(5.0, 7.0)) for _ in range(10)][-1]
    assert again[:14] == ahead[:14]
    plant.state[3] = np.nan
    plant.advance(Drive(5.0, 7.0))
    assert plant.trouble() == "diverged"


def test_drawn_body_has_the_pose_of_the_bicycle():
    plant, truths = driven((8.0, 8.0), 2.0)
    poses = dict(zip(plant.scene.bodies, plant.poses(), strict=True))
    assert {"chassis", "wheel_fl", "wheel_rr"} <= set(poses)
    assert poses["chassis"][:2] == pytest.approx((truths[-1].rear_x, truths[-1].rear_y), abs=1e-9)
    assert plant.configuration()[:2] == pytest.approx(poses["chassis"][:2])
