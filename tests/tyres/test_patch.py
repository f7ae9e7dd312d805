"""Contact kinematics compared with hand-computed cases, bristle equation, and power of the wrench."""

from math import cos, exp, radians, sin, tan

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from wheel_steps import step_of

from agrobot_mj.core.spec import every
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat, Slope
from agrobot_mj.tyres import Linear, Soil, Tyre
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import (
    FORCE_X,
    FORCE_Y,
    LOAD,
    SLIP_ANGLE,
    SLIP_RATIO,
    WheelMotion,
    find_patch,
    relax,
    soft_sign,
)

FLAT, R, DT = Flat().ground(), 0.42, 0.002
LAWS = [law for law in every(Tyre) if law().judged]
TYRE = TractorParameters().rear_wheel
REAR = 2  # Index of the left rear tyre, whose free radius is R
UP = (0.0, 0.0, 1.0)
STILL = (0.0, 0.0, 0.0)
unhurried = settings(deadline=None)  # the first call compiles


def times(factor, vector):
    return tuple(factor * v for v in vector)


def turned(yaw, camber=0.0):
    """Return forward direction and axle (left) of a wheel on level ground, tilted to the left by -camber."""
    forward = (cos(yaw), sin(yaw), 0.0)
    axle = (-sin(yaw) * cos(camber), cos(yaw) * cos(camber), sin(camber))
    return forward, axle


class Wheel:
    """Tyre with its bristle at a constant motion."""

    def __init__(self, tyre=None, ground=FLAT, i=REAR, **changes):
        self.tyres = tyre_set(tyre or Linear(), TractorParameters())._replace(**changes)
        self.ground, self.i, self.advance = ground, i, step_of(self.tyres, ground)
        self.bristle, self.wrench, self.report = np.zeros(4), np.zeros(6), np.zeros(6)

    def step(self, centre, axle, velocity, rotation, steps=1, dt=DT):
        motion = WheelMotion(centre, axle, velocity, rotation)
        for _ in range(steps):
            self.advance(self.tyres, self.i, self.ground, motion, dt, self.bristle, self.wrench, self.report)
        return self.report.copy()


def r_e(penetration):
    """Return the effective rolling radius of the rear tyre."""
    return R - penetration / 3


# --- kinematics ---------------------------------------------------------------------------------------------------


def test_upright_wheel_at_rest_has_its_contact_patch_below_the_centre():
    patch = find_patch(FLAT, R, WheelMotion((3.0, -2.0, 0.40), (0.0, 1.0, 0.0), STILL, STILL))
    assert patch.penetration == pytest.approx(0.02)
    assert patch.n == pytest.approx(UP)
    assert patch.f == pytest.approx((1.0, 0.0, 0.0))
    assert patch.l == pytest.approx((0.0, 1.0, 0.0))
    assert patch.arm == pytest.approx((0.0, 0.0, -0.40))
    assert (patch.rate, patch.v_x, patch.v_y, patch.spin) == pytest.approx((0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("yaw_deg", [0, 35, 90, 200, -70])
def test_velocity_of_a_yawed_wheel_has_forward_and_lateral_components(yaw_deg):
    forward, axle = turned(radians(yaw_deg))
    left = (-forward[1], forward[0], 0.0)
    velocity = tuple(1.5 * f + 0.3 * s for f, s in zip(forward, left, strict=True))
    patch = find_patch(FLAT, R, WheelMotion((1.0, 2.0, 0.41), axle, (*velocity[:2], -0.05), times(3.0, axle)))
    assert patch.f == pytest.approx(forward)
    assert patch.l == pytest.approx(left)
    assert (patch.v_x, patch.v_y, patch.spin) == pytest.approx((1.5, 0.3, 3.0))
    assert patch.rate == pytest.approx(0.05)


@pytest.mark.parametrize("direction_deg", [0, 90, 160, 270])
@pytest.mark.parametrize("yaw_deg", [0, 50, 180])
def test_contact_patch_on_a_slope_is_in_the_ground_plane(direction_deg, yaw_deg):
    grade = 20.0
    ground = Slope(grade_deg=grade, direction_deg=direction_deg).ground()
    rise = radians(direction_deg)
    n = (-sin(radians(grade)) * cos(rise), -sin(radians(grade)) * sin(rise), cos(radians(grade)))
    heading = np.array([cos(radians(yaw_deg)), sin(radians(yaw_deg)), 0.0])
    f = heading - heading @ n * np.array(n)
    f /= np.linalg.norm(f)
    axle = np.cross(n, f)
    foot = np.array([5.0, -3.0, tan(radians(grade)) * (5.0 * cos(rise) - 3.0 * sin(rise))])
    centre = foot + (R - 0.03) * np.array(n)
    velocity = 1.2 * f - 0.4 * axle - 0.1 * np.array(n)
    patch = find_patch(ground, R, WheelMotion(tuple(centre), tuple(axle), tuple(velocity), times(2.0, tuple(axle))))
    assert patch.penetration == pytest.approx(0.03)
    assert patch.n == pytest.approx(n)
    assert patch.f == pytest.approx(tuple(f))
    assert centre + np.array(patch.arm) == pytest.approx(foot)
    assert (patch.v_x, patch.v_y, patch.rate, patch.spin) == pytest.approx((1.2, -0.4, 0.1, 2.0))


def test_tilted_wheel_touches_the_ground_at_its_lowest_point():
    camber = radians(12)
    _, axle = turned(0.0, camber)
    patch = find_patch(FLAT, R, WheelMotion((0.0, 0.0, 0.40), axle, STILL, STILL))
    assert patch.penetration == pytest.approx(R * cos(camber) - 0.40)
    assert patch.arm[1] == pytest.approx((R - patch.penetration) * sin(camber))


def test_wheel_carrier_rotation_moves_the_patch_but_wheel_spin_does_not():
    axle = (0.0, 1.0, 0.0)
    rolling = find_patch(FLAT, R, WheelMotion((0.0, 0.0, 0.40), axle, STILL, (0.5, 4.0, 0.7)))
    assert rolling.spin == pytest.approx(4.0)
    assert rolling.v_x == pytest.approx(0.0)
    assert rolling.v_y == pytest.approx(0.5 * 0.40)  # roll to the right carries the patch to the left


# --- bristle ------------------------------------------------------------------------------------------------------


@unhurried
@given(
    z=st.floats(-0.1, 0.1),
    slide=st.floats(-2, 2),
    roll=st.floats(0, 20),
    sigma=st.floats(0.01, 1.0),
    dt=st.sampled_from([0.001, 0.002, 0.005]),
)
def test_bristle_deflection_follows_its_differential_equation(z, slide, roll, sigma, dt):
    exact = solve_ivp(lambda t, y: slide - roll * y / sigma, (0, dt), [z], rtol=1e-10, atol=1e-13).y[0, -1]
    assert relax(z, slide, roll, sigma, dt) == pytest.approx(exact, abs=1e-8)


@unhurried
@given(z=st.floats(-0.1, 0.1), slide=st.floats(-2, 2), roll=st.floats(1e-3, 20), sigma=st.floats(0.01, 1.0))
def test_two_half_steps_of_the_bristle_model_equal_one_full_step(z, slide, roll, sigma):
    half = relax(relax(z, slide, roll, sigma, 0.005), slide, roll, sigma, 0.005)
    assert relax(z, slide, roll, sigma, 0.01) == pytest.approx(half, abs=1e-7)


@pytest.mark.parametrize("speed", [0.2, 1.2, 4.0])
@pytest.mark.parametrize("side_slip", [0.02, -0.1])
def test_steady_state_slip_is_sliding_speed_divided_by_rolling_speed(speed, side_slip):
    wheel = Wheel()
    spin = 1.1 * speed / r_e(0.02)
    steps = round(20 * 0.63 / speed / DT)
    report = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (speed, side_slip * speed, 0.0), (0.0, spin, 0.0), steps)
    assert tan(report[SLIP_ANGLE]) == pytest.approx(side_slip, rel=1e-6)
    assert report[SLIP_RATIO] == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize("speed", [0.5, 1.2, 4.0])
@pytest.mark.parametrize("radii", [0.3, 1.5])
def test_side_force_reaches_63_percent_after_one_relaxation_length(speed, radii):
    tyre = Linear(relaxation_radii=radii, bristle_damping_s=0.0)
    motion = ((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (speed, 0.05 * speed, 0.0), (0.0, speed / r_e(0.02), 0.0))
    length = radii * R / (speed * DT)
    wheel = Wheel(tyre)
    early = wheel.step(*motion, steps=round(length))[FORCE_Y]
    final = wheel.step(*motion, steps=round(20 * length))[FORCE_Y]
    assert early / final == pytest.approx(1 - exp(-round(length) / length), abs=1e-6)
    assert early / final == pytest.approx(0.632, abs=0.01)


def test_wheel_at_rest_resists_displacement_like_a_spring():
    wheel = Wheel(Linear(bristle_damping_s=0.0))
    wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (0.01, -0.02, 0.0), STILL, steps=50)
    held = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), STILL, STILL, steps=5000)
    sigma = 1.5 * R
    assert held[FORCE_X] == pytest.approx(-25_000 * 0.001 / sigma, rel=0.01)
    assert held[FORCE_Y] == pytest.approx(15_000 * 0.002 / sigma, rel=0.01)


# --- wrench -------------------------------------------------------------------------------------------------------


def test_only_the_vertical_load_acts_on_a_freely_rolling_wheel():
    wheel = Wheel()
    report = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (1.2, 0.0, 0.0), (0.0, 1.2 / r_e(0.02), 0.0), 500)
    assert report == pytest.approx(np.array([TYRE.stiffness * 0.02, 0, 0, 0, 0, 0]), abs=1e-9)
    assert wheel.wrench == pytest.approx(np.array([0, 0, TYRE.stiffness * 0.02, 0, 0, 0]), abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("height", [0.43, 0.4200001, 5.0])
def test_airborne_wheel_has_no_force_and_no_bristle_deflection(law, height):
    wheel = Wheel(law())
    wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (1.0, 0.3, 0.0), (0.0, 0.0, 0.2), 100)
    assert wheel.bristle[:2].all()
    assert not wheel.step((0.0, 0.0, height), (0.0, 1.0, 0.0), (1.0, 0.3, 0.0), (0.0, 9.0, 0.0)).any()
    assert not wheel.wrench.any()
    assert not wheel.bristle.any()


@pytest.mark.parametrize("law", LAWS)
def test_wheel_load_is_a_spring_and_damper_force_that_is_never_negative(law):
    wheel = Wheel(law())
    still = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), STILL, STILL)[LOAD]
    sinking = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (0.0, 0.0, -0.5), STILL)[LOAD]
    leaving = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (0.0, 0.0, 5.0), STILL)[LOAD]
    assert still == pytest.approx(TYRE.stiffness * 0.02)
    assert sinking - still == pytest.approx(TYRE.damping * 0.5)
    assert leaving == 0.0
    assert not wheel.wrench.any()


def test_tyre_wrench_acts_at_the_contact_patch():
    """About the patch, only the axle torque remains, on a slope with a rotated and tilted wheel."""
    ground = Slope(grade_deg=12, direction_deg=130).ground()
    _, axle = turned(radians(40), radians(5))
    centre = np.array([1.0, 2.0, 0.41 + tan(radians(12)) * (cos(radians(130)) + 2 * sin(radians(130)))])
    wheel = Wheel(ground=ground)
    wheel.step(tuple(centre), axle, (0.8, 0.9, 0.0), times(3.0, axle), 300)
    patch = find_patch(ground, R, WheelMotion(tuple(centre), axle, (0.8, 0.9, 0.0), times(3.0, axle)))
    force, torque = wheel.wrench[:3], wheel.wrench[3:]
    about_patch = torque - np.cross(patch.arm, force)
    assert np.cross(about_patch, axle) == pytest.approx(np.zeros(3), abs=1e-9)
    assert force @ patch.n == pytest.approx(wheel.report[LOAD])
    assert force @ patch.f == pytest.approx(wheel.report[FORCE_X])
    assert force @ patch.l == pytest.approx(wheel.report[FORCE_Y])
    assert abs(wheel.report[FORCE_X]) > 100
    assert abs(wheel.report[FORCE_Y]) > 100


@pytest.mark.parametrize(
    "tyre", [*(law() for law in LAWS), Linear(rolling_resistance=0.06)], ids=lambda tyre: tyre.kind
)
@settings(deadline=None, max_examples=30)
@given(
    yaw=st.floats(-3, 3),
    camber=st.floats(-0.2, 0.2),
    velocity=st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    spin=st.floats(-10, 10),
    turn=st.floats(-1, 1),
)
def test_steadily_sliding_tyre_dissipates_energy(tyre, yaw, camber, velocity, spin, turn):
    """Power is force times velocity plus torque times rotation; on level ground the load does no work.

    The wheel moves by at least 1 m, because a tilted wheel with less motion is held by its elastic side force.
    """
    assume(4000 * DT * (np.hypot(*velocity) + R * (abs(spin) + abs(turn))) > 1.0)
    _, axle = turned(yaw, camber)
    rotation = np.array(times(spin, axle)) + (0.0, 0.0, turn)
    wheel = Wheel(tyre)
    wheel.step((0.0, 0.0, 0.40), axle, (*velocity, 0.0), tuple(rotation), steps=4000)
    power = wheel.wrench[:3] @ (*velocity, 0.0) + wheel.wrench[3:] @ rotation
    scale = np.abs(wheel.wrench).max() * (abs(spin) + np.hypot(*velocity))
    assert power <= 1e-6 * scale


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("slip", [-0.02, -0.005, 0.005, 0.02])
def test_driving_and_braking_dissipate_energy_also_at_small_slip(law, slip):
    """With a lever arm other than the effective radius, a wheel could gain energy."""
    wheel, spin = Wheel(law(), rolling_resistance=0.0), 1.2 * (1 + slip) / r_e(0.02)
    f_x = wheel.step((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (1.2, 0.0, 0.0), (0.0, spin, 0.0), 4000)[FORCE_X]
    assert wheel.wrench[0] * 1.2 + wheel.wrench[4] * spin < 0
    if law is not Soil:  # which also pushes on the centre
        assert np.sign(f_x) == np.sign(slip)
        assert wheel.wrench[4] == pytest.approx(-r_e(0.02) * f_x)


def test_rolling_resistance_decelerates_a_freely_rolling_wheel():
    motion = ((0.0, 0.0, 0.40), (0.0, 1.0, 0.0), (1.2, 0.0, 0.0), (0.0, 1.2 / r_e(0.02), 0.0))
    wheel = Wheel(Linear(rolling_resistance=0.05))
    load = wheel.step(*motion, steps=200)[LOAD]
    assert wheel.wrench[4] == pytest.approx(-0.05 * load * r_e(0.02), rel=1e-6)
    backwards = Wheel(Linear(rolling_resistance=0.05))
    backwards.step(motion[0], motion[1], times(-1, motion[2]), times(-1, motion[3]), steps=200)
    assert backwards.wrench[4] == pytest.approx(0.05 * load * r_e(0.02), rel=1e-6)


@pytest.mark.parametrize("v", [-5.0, -0.05, -0.01, 0.0, 0.003, 0.03, 0.5])
def test_smooth_sign_function_equals_the_hyperbolic_tangent(v):
    assert soft_sign(v, 0.02) == pytest.approx(np.tanh(v / 0.02), abs=1e-15)
