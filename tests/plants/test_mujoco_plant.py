"""MuJoCo tractor: weight, parking, straight lines, steering with its stops, comparison with the bicycle, rollover, and
numerics (step size, determinism, compiled code against plain Python).
"""

import json
from math import atan, degrees, radians

import numpy as np
import pytest
from processes import bare

from agrobot_mj.core.signals import Drive, Reference
from agrobot_mj.core.spec import every
from agrobot_mj.machine import Machine
from agrobot_mj.machine.hydraulics import NEUTRAL_V, Cylinder, Valve, valve_law, valve_step
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import Bicycle, BicyclePlant, Clock, Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.model import SPIN_GYRATION_2
from agrobot_mj.terrain import Flat, Slope
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Tyre

TRACTOR, CYLINDER = TractorParameters(), Cylinder()
COLUMN = CYLINDER.column(TRACTOR)
REST = Drive(NEUTRAL_V, NEUTRAL_V)
ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
TYRES = every(Tyre)
FORCE_TYRES = [tyre for tyre in TYRES if tyre().judged]
SHORT = Linear(relaxation_radii=0.05)
"""Tyre with the shortest stable relaxation length at 2 ms, which responds almost immediately, as in the bicycle."""


def build(spec, terrain=Flat(), dt=0.002, start=ORIGIN, cylinder=CYLINDER):
    """Return a plant at rest on its terrain, and its first true state."""
    kind = BicyclePlant if isinstance(spec, Bicycle) else MujocoPlant
    plant = kind(spec, Machine(cylinder=cylinder), terrain.ground(), Clock.of(dt))
    return plant, plant.reset(start)


def linear(terrain=Flat(), **changes):
    return build(Mujoco(tyre=Linear()), terrain, **changes)


class Driver:
    """Driver with a PI speed controller, who steers by voltage or towards an angle."""

    def __init__(self, plant, truth, speed=2.0):
        self.plant, self.truth, self.speed, self.integral = plant, truth, speed, 0.0

    def go(self, seconds, steer_voltage=NEUTRAL_V, angle=None):
        """Return the true state of every tick."""
        seen = []
        for _ in range(round(seconds / 0.05)):
            error = self.speed - self.truth.speed
            wanted = self.speed / 5 + 0.1 * error + self.integral
            self.integral += 0.005 * error
            push = 10 * (wanted - self.truth.pedal)
            pedal = NEUTRAL_V + push + 0.3 * np.sign(push)
            if angle is not None:
                off = angle - self.truth.steer
                steer_voltage = NEUTRAL_V + 20 * off + (0.4 * np.sign(off) if abs(off) > 2e-5 else 0.0)
            self.truth = self.plant.advance(Drive(steer_voltage, pedal))
            seen.append(self.truth)
        return seen


def rest(plant, seconds):
    for _ in range(round(seconds / 0.05)):
        truth = plant.advance(REST)
    return truth


def warnings(plant):
    return [i for i, warning in enumerate(plant.data.warning) if warning.number]


def loads(plant):
    return plant.wheels()[:4]


def rigid_angle(voltages, dt=0.002):
    """Return the angle of a rigid cylinder after each tick of 50 ms [rad]."""
    law, memory = valve_law(Valve(), dt)
    angle, seen = 0.0, []
    for voltage in voltages:
        for _ in range(round(0.05 / dt)):
            angle += valve_step(law, memory, voltage) / CYLINDER.displacement * dt
            angle = min(max(angle, -TRACTOR.steer_limit), TRACTOR.steer_limit)
        seen.append(angle)
    return np.array(seen)


# --- standing -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tyre", TYRES)
def test_static_wheel_loads_match_the_parameters(tyre):
    plant, _ = build(Mujoco(tyre=tyre()))
    rest(plant, 5.0)
    carried = loads(plant)
    assert carried.sum() == pytest.approx(TRACTOR.mass_kg * GRAVITY, rel=1e-3)
    assert carried[:2].sum() == pytest.approx(TRACTOR.front_axle_load, rel=5e-3)
    assert carried[2:].sum() == pytest.approx(TRACTOR.rear_axle_load, rel=5e-3)
    assert carried[::2] == pytest.approx(carried[1::2], rel=5e-3)
    assert not warnings(plant)


@pytest.mark.parametrize("tyre", FORCE_TYRES)
def test_machine_starts_at_its_static_height_above_the_path(tyre):
    plant, truth = build(Mujoco(tyre=tyre()), start=Reference(3.0, -4.0, 0.0, 0.0, 2.0, 0.0))
    assert (truth.x, truth.y, truth.yaw) == pytest.approx((3.0, -4.0, 2.0), abs=1e-4)
    assert truth.z == pytest.approx(TRACTOR.cg_height_m, abs=5e-4)
    assert truth.antenna[2] == pytest.approx(TRACTOR.antenna_height_m, abs=5e-4)
    assert (truth.speed, truth.yaw_rate, truth.roll, truth.pitch) == pytest.approx((0, 0, 0, 0), abs=1e-3)


@pytest.mark.parametrize("direction_deg", [0, 60, 90, 180])
@pytest.mark.parametrize("tyre", FORCE_TYRES)
def test_parked_tractor_stays_on_a_slope(tyre, direction_deg):
    plant, _ = build(Mujoco(tyre=tyre()), Slope(grade_deg=10, direction_deg=direction_deg))
    early = rest(plant, 10.0)
    late = rest(plant, 20.0)
    moved = np.array([late.x - early.x, late.y - early.y, late.z - early.z])
    assert np.linalg.norm(moved) < 1e-3
    assert abs(late.yaw - early.yaw) < radians(0.05)
    assert abs(late.speed) < 1e-4


def test_wheel_load_shifts_downhill_on_a_slope():
    """The moment about the lower wheels is m g sin(grade) h / track, increased by the roll on the tyres."""
    plant, _ = linear(Slope(grade_deg=10, direction_deg=90))
    truth = rest(plant, 10.0)
    carried = loads(plant)
    across = np.sin(radians(10)) + np.cos(radians(10)) * (truth.roll - radians(10))
    moment = TRACTOR.mass_kg * GRAVITY * across * TRACTOR.cg_height_m / TRACTOR.track_m
    assert carried.sum() == pytest.approx(TRACTOR.mass_kg * GRAVITY * np.cos(radians(10)), rel=2e-3)
    assert (carried[1::2].sum() - carried[::2].sum()) / 2 == pytest.approx(moment, rel=0.02)
    assert degrees(truth.roll) == pytest.approx(10.0, abs=1.0)


def test_falling_tractor_has_no_wheel_loads():
    plant, _ = build(Mujoco(tyre=Linear(), settle_s=0.0))
    plant.data.qpos[2] += 1.0
    for k in range(1, 9):
        truth = plant.advance(REST)
        assert truth.z == pytest.approx(TRACTOR.cg_height_m + 1.0 - GRAVITY * (0.05 * k) ** 2 / 2, abs=0.005)
        assert not loads(plant).any()


@pytest.mark.parametrize("spec", [Bicycle(), Mujoco(tyre=Linear())], ids=lambda spec: spec.kind)
def test_reset_removes_all_effects_of_the_previous_run(spec):
    plant, fresh = build(spec)
    Driver(plant, fresh).go(3.0, steer_voltage=9.0)
    again = plant.reset(ORIGIN)
    assert (again.x, again.y, again.speed, again.steer, again.pedal) == pytest.approx(
        (fresh.x, fresh.y, fresh.speed, fresh.steer, fresh.pedal), abs=1e-9
    )


# --- driving ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tyre", TYRES)
@pytest.mark.parametrize("speed", [1.2, -1.0, 4.0])
def test_tractor_stays_straight_with_centred_steering(tyre, speed):
    driver = Driver(*build(Mujoco(tyre=tyre())), speed=speed)
    end = driver.go(15.0)[-1]
    assert end.speed == pytest.approx(speed, rel=0.02)
    assert abs(end.y) < 1e-3
    assert abs(end.yaw) < 1e-4
    assert abs(end.steer) < 1e-3
    assert not warnings(driver.plant)


@pytest.mark.parametrize("yaw", [0.6, 2.4, -1.6])
def test_run_is_independent_of_the_compass_direction_of_the_path(yaw):
    seen = []
    for heading in (0.0, yaw):
        driver = Driver(*linear(start=ORIGIN._replace(yaw=heading)))
        end = driver.go(6.0, angle=0.2)[-1]
        turned = np.exp(-1j * heading) * (end.x + 1j * end.y)
        seen.append((turned.real, turned.imag, end.speed, end.yaw_rate, end.lateral_speed))
    assert seen[0] == pytest.approx(seen[1], rel=1e-4, abs=1e-5)


def test_left_and_right_turns_are_mirror_images():
    left, right = (Driver(*linear()).go(6.0, angle=side * 0.3)[-1] for side in (1, -1))
    assert (left.y, left.yaw_rate, left.roll) == pytest.approx((-right.y, -right.yaw_rate, -right.roll), rel=0.01)
    assert left.yaw_rate > 0


def test_forces_balance_the_acceleration_on_a_steady_circle():
    """Lateral tyre forces sum to m u gamma. The outer wheels carry its moment, and the moments of gyroscopic forces and
    of the tilted weight."""
    driver = Driver(*linear())
    end = driver.go(20.0, angle=0.2)[-1]
    report = driver.plant.wheels().reshape(6, 4)
    steer = np.array([end.steer, end.steer, 0.0, 0.0])
    lateral = (report[4] * np.cos(steer) + report[3] * np.sin(steer)).sum()
    wanted = TRACTOR.mass_kg * end.speed * end.yaw_rate
    assert lateral == pytest.approx(wanted, rel=0.03)
    radii = np.array([TRACTOR.front_wheel_radius_m] * 2 + [TRACTOR.rear_wheel_radius_m] * 2)
    masses = np.array([TRACTOR.front_wheel_mass_kg] * 2 + [TRACTOR.rear_wheel_mass_kg] * 2)
    gyroscopes = (SPIN_GYRATION_2 * masses * radii).sum() * end.speed * end.yaw_rate
    leaning = TRACTOR.mass_kg * GRAVITY * TRACTOR.cg_height_m * np.sin(end.roll)
    moment = wanted * TRACTOR.cg_height_m + gyroscopes + leaning
    assert gyroscopes > 10
    assert leaning > 5
    assert (report[0, 1::2].sum() - report[0, ::2].sum()) * TRACTOR.track_m / 2 == pytest.approx(moment, rel=0.02)


@pytest.mark.parametrize(
    ("speed", "steady_rel", "rms_rel"), [(1.0, 0.02, 0.04), (2.0, 0.02, 0.04), (4.0, 0.02, 0.04)], ids=["1", "2", "4"]
)
def test_yaw_rate_in_a_steady_turn_equals_the_bicycle_model(speed, steady_rel, rms_rel):
    """Differences are due to wheel spin, pitch, relaxation over 2 cm, Ackermann geometry and longitudinal slip."""
    answers = []
    for spec in (Bicycle(), Mujoco(tyre=SHORT)):
        driver = Driver(*build(spec), speed=speed)
        driver.go(15.0, angle=0.0)
        answers.append(np.array([truth.yaw_rate for truth in driver.go(8.0, angle=0.05)]))
        assert driver.truth.steer == pytest.approx(0.05, abs=2e-4)
        assert driver.truth.speed == pytest.approx(speed, rel=5e-3)
    bicycle, mujoco = answers
    steady = bicycle[-20:].mean()
    assert mujoco[-20:].mean() == pytest.approx(steady, rel=steady_rel)
    assert np.sqrt(np.mean((mujoco[:100] - bicycle[:100]) ** 2)) < rms_rel * steady


@pytest.mark.parametrize("tyre", [MagicFormula(), Contact()], ids=lambda tyre: tyre.kind)
def test_slip_is_positive_when_driving_and_negative_when_braking(tyre):
    driver, slips = Driver(*build(Mujoco(tyre=tyre), Slope(grade_deg=8, direction_deg=0)), speed=-1.0), {}
    for way in (-1.0, 1.0):
        driver.speed = way
        driver.go(6.0, angle=0.0)
        reports = []
        for _ in range(60):
            driver.go(0.05, angle=0.0)
            reports.append(driver.plant.wheels().reshape(6, 4)[2].copy())
        slips[way] = np.mean(reports, axis=0)[2:]
    assert slips[-1.0].max() < -1e-4  # the slope falls behind it, and pulls it along
    assert slips[1.0].min() > 1e-4


def test_tractor_on_contact_tyres_drives_and_turns():
    driver = Driver(*build(Mujoco(tyre=Contact())))
    driver.go(6.0)
    end = driver.go(6.0, angle=0.2)[-1]
    assert end.speed == pytest.approx(2.0, rel=0.05)
    assert end.yaw_rate == pytest.approx(2.0 * np.tan(0.2) / TRACTOR.wheelbase_m, rel=0.1)
    reports = []
    for _ in range(200):  # the contacts of rolling cylinders flicker: forces count in the mean
        driver.go(0.05, angle=0.2)
        reports.append(driver.plant.wheels().reshape(6, 4).copy())
    load, _, slip, _, lateral, _ = np.mean(reports, axis=0)
    assert load.sum() == pytest.approx(TRACTOR.mass_kg * GRAVITY, rel=0.05)
    assert lateral.sum() == pytest.approx(TRACTOR.mass_kg * end.speed * end.yaw_rate, rel=0.25)
    assert np.abs(slip).max() < 0.05
    assert not warnings(driver.plant)


# --- steering -----------------------------------------------------------------------------------------------------


def test_wheels_follow_an_ideal_cylinder_to_within_the_oil_compliance():
    times = 0.05 * np.arange(200)
    voltages = NEUTRAL_V + 2.5 * np.sin(times) - 1.0 * (times > 3)
    rigid = rigid_angle(voltages)
    assert np.abs(rigid).max() < 0.75  # off the stops
    driver = Driver(*linear())
    angles = np.array([driver.go(0.05, steer_voltage=v)[-1].steer for v in voltages])
    assert np.ptp(angles) > 0.5
    assert np.abs(angles - rigid).max() < radians(0.4)


@pytest.mark.parametrize("side", [1, -1])
def test_steering_stops_at_its_limit_and_does_not_wind_up(side):
    plant, _ = linear()
    full = Drive(NEUTRAL_V + 6 * side, NEUTRAL_V)
    held = [plant.advance(full) for _ in range(round(5.0 / 0.05))]
    angles = np.array([truth.steer for truth in held])
    assert side * angles[-1] == pytest.approx(TRACTOR.steer_limit, abs=radians(0.2))
    assert np.abs(angles).max() < TRACTOR.steer_limit + radians(0.5)
    assert side * angles[40] > radians(40)
    back = [plant.advance(Drive(NEUTRAL_V - 6 * side, NEUTRAL_V)) for _ in range(8)]
    voltages = [full.steer_voltage] * 100 + [NEUTRAL_V - 6 * side] * 8
    away = TRACTOR.steer_limit - side * back[-1].steer
    assert away > radians(2)
    assert side * back[-1].steer == pytest.approx(side * rigid_angle(voltages)[-1], abs=radians(0.5))


@pytest.mark.parametrize("torque", [100.0, -170.0])
def test_oil_column_acts_as_a_spring_below_the_relief_pressure(torque):
    plant, _ = linear()
    plant.data.qfrc_applied[plant.model.joint("steer").dofadr[0]] = torque
    assert rest(plant, 3.0).steer == pytest.approx(torque / COLUMN.stiffness, rel=0.05)


def test_wheels_are_turned_by_loads_above_the_relief_pressure():
    plant, _ = linear()
    dof = plant.model.joint("steer").dofadr[0]
    plant.data.qfrc_applied[dof] = 1.3 * COLUMN.relief_torque
    pushed = rest(plant, 0.05).steer
    assert pushed > 1.5 * COLUMN.relief_torque / COLUMN.stiffness
    assert abs(plant.data.actuator("steering").force[0]) == pytest.approx(COLUMN.relief_torque, rel=0.01)
    plant.data.qfrc_applied[dof] = 0.0
    left = rest(plant, 2.0).steer
    assert left > pushed / 2  # the oil is gone: nothing drives the wheels back to where they were


def test_steering_with_low_relief_pressure_cannot_turn_stuck_wheels():
    weak = Cylinder(relief_pressure_bar=10)
    plant, _ = build(Mujoco(tyre=Linear()), cylinder=weak)
    dof, relief = plant.model.joint("steer").dofadr[0], weak.column(TRACTOR).relief_torque
    plant.data.qfrc_applied[dof] = -0.9 * relief
    for _ in range(40):
        truth = plant.advance(Drive(12.0, NEUTRAL_V))
    assert truth.steer > radians(5)
    plant.data.qfrc_applied[dof] = -1.1 * relief
    for _ in range(40):
        truth = plant.advance(Drive(12.0, NEUTRAL_V))
    assert truth.steer < 0


# --- troubles -----------------------------------------------------------------------------------------------------


def test_tractor_rolls_over_downhill_on_a_steep_side_slope():
    plant, truth = build(Mujoco(tyre=Linear(), settle_s=0.0), Slope(grade_deg=44, direction_deg=90))
    assert plant.trouble() is None
    assert degrees(truth.roll) == pytest.approx(44, abs=1)
    for _ in range(100):
        truth = plant.advance(REST)
        if plant.trouble():
            break
    assert plant.trouble() == "rolled_over"
    assert degrees(truth.roll) > 55
    assert not warnings(plant)


@pytest.mark.parametrize("direction_deg", [90, 270])
def test_tractor_stays_upright_on_a_side_slope_of_25_degrees(direction_deg):
    plant, _ = build(Mujoco(tyre=Linear(), settle_s=0.0), Slope(grade_deg=25, direction_deg=direction_deg))
    truth = rest(plant, 10.0)
    assert plant.trouble() is None
    assert abs(degrees(truth.roll)) == pytest.approx(25, abs=2.5)


def test_leaving_the_terrain_is_detected():
    driver = Driver(*linear(Flat(half_size_m=6.0)))
    while driver.plant.trouble() is None and driver.truth.t < 20:
        driver.go(0.05)
    assert driver.plant.trouble() == "left_terrain"
    assert driver.truth.x == pytest.approx(6.0, abs=0.15)


@pytest.mark.parametrize("wrong", [1e12, np.nan])
def test_numerical_divergence_ends_the_run(wrong, tmp_path, monkeypatch):
    """On divergence, MuJoCo resets the model to its initial state, which must not count as continued motion."""
    monkeypatch.chdir(tmp_path)
    plant, _ = linear()
    plant.data.qvel[0] = wrong
    plant.advance(REST)
    assert plant.trouble() == "diverged"
    assert plant.warnings() > 0
    assert not list(tmp_path.iterdir()), "MuJoCo's log in the working directory"


# --- numerics -----------------------------------------------------------------------------------------------------


def manoeuvre(tyre, dt):
    """Return the true states of 8 s with a start, a curve and an opposite curve."""
    driver = Driver(*build(Mujoco(tyre=tyre), dt=dt))
    seen = driver.go(3.0) + driver.go(1.5, steer_voltage=8.0) + driver.go(3.5, steer_voltage=4.6)
    assert not warnings(driver.plant)
    return np.array([(t.x, t.y, t.yaw, t.speed, t.yaw_rate, t.steer) for t in seen])


@pytest.mark.parametrize("tyre", FORCE_TYRES)
def test_halving_the_physics_time_step_changes_results_little(tyre):
    coarse, fine = manoeuvre(tyre(), 0.002), manoeuvre(tyre(), 0.001)
    assert np.abs(coarse[:, :2] - fine[:, :2]).max() < 0.03
    assert coarse[:, 2:] == pytest.approx(fine[:, 2:], abs=0.02)


@pytest.mark.parametrize("tyre", FORCE_TYRES)
def test_simulation_is_stable_with_a_time_step_of_5_ms(tyre):
    coarse, fine = manoeuvre(tyre(), 0.005), manoeuvre(tyre(), 0.002)
    assert np.abs(coarse[:60, 1]).max() < 1e-3
    assert np.abs(coarse[:, :2] - fine[:, :2]).max() < 0.1
    assert coarse[:, 2:] == pytest.approx(fine[:, 2:], abs=0.05)


@pytest.mark.parametrize("tyre", TYRES)
def test_equal_inputs_give_bit_identical_results(tyre):
    ends = []
    for _ in range(2):
        plant, _ = build(Mujoco(tyre=tyre()))
        for k in range(40):
            truth = plant.advance(Drive(NEUTRAL_V + 2 * np.sin(k), 8.0))
        state = (
            plant.data.qpos.tobytes(),
            plant.data.qvel.tobytes(),
            plant.wheels().tobytes(),
            plant.poses().tobytes(),
        )
        arrays = dict.fromkeys(("steer_samples", "pedal_samples", "knuckle_samples", "implement"))
        ends.append((truth._replace(**arrays), truth.steer_samples.tobytes(), state))
    assert ends[0] == ends[1]


def test_true_velocities_are_the_derivatives_of_true_positions():
    """The antenna is above R, and the samples of a tick end at the current time."""
    driver = Driver(*linear(Slope(grade_deg=8, direction_deg=30)))
    seen = driver.go(6.0, angle=0.3)
    before, now, after = seen[-3:]
    for quantity in ("antenna", "x", "y"):
        there, here = (np.array(getattr(t, quantity)) for t in (after, before))
        slope = (there - here) / 0.1
        if quantity == "antenna":
            assert slope == pytest.approx(np.array(now.antenna_velocity), abs=0.01)
    vx, vy = (after.x - before.x) / 0.1, (after.y - before.y) / 0.1
    assert now.speed == pytest.approx(np.cos(now.yaw) * vx + np.sin(now.yaw) * vy, abs=0.01)
    assert now.lateral_speed == pytest.approx(-np.sin(now.yaw) * vx + np.cos(now.yaw) * vy, abs=0.01)
    assert (after.yaw - before.yaw) / 0.1 == pytest.approx(now.yaw_rate, abs=0.01)
    assert after.steer_samples[-1] == after.steer
    assert after.pedal_samples[-1] == after.pedal
    assert np.hypot(now.antenna[0] - now.rear_x, now.antenna[1] - now.rear_y) == pytest.approx(
        TRACTOR.antenna_height_m * np.sin(radians(8)), rel=0.15
    )
    assert now.t == pytest.approx(before.t + 0.05)


UNCOMPILED = """
import json
import numba
from agrobot_mj.machine import Machine, Valve
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.core.signals import NOMINAL, Drive, PointMass, Reference
from agrobot_mj.core.spec import every
from agrobot_mj.terrain import Slope
from agrobot_mj.terrain.patches import CirclePatch
from agrobot_mj.tyres import Tyre

def run(tyre):
    wet = CirclePatch(x_m=0.2, y_m=0.5, radius_m=1.0, friction=0.6, cone_index_kpa=700.0)
    ground = Slope(grade_deg=7, direction_deg=20, patch=(wet,)).ground()
    rough = NOMINAL._replace(
        payload=(PointMass(90.0, -0.5, 0.2, 0.8),), drawbar=800.0, side_force=-300.0, grip=0.9,
        tyre_stiffness=(1.0, 0.5, 1.0, 1.0), tyre_rolling=(1.0, 1.4, 1.0, 1.0),
    )
    spec = Mujoco(tyre=tyre, settle_s=0.1)
    plant = MujocoPlant(spec, Machine(valve=Valve(delay_s=0.02)), ground)
    plant.reset(Reference(0, 0, 0, 0, 0.3, 0))
    for k in range(3):
        truth = plant.advance(Drive(9.0, 11.0), rough)
    return [*truth[:14], *truth.antenna, *plant.wheels().tolist(), *plant.data.qvel.tolist()]

answers = [run(tyre()) for tyre in every(Tyre) if tyre().judged]
"""


def test_tick_in_plain_python_equals_the_compiled_kernel(tmp_path):
    here = {}
    exec(UNCOMPILED, here)
    script = UNCOMPILED + "print(json.dumps([numba.config.DISABLE_JIT, answers]))"
    there = bare(tmp_path, "-c", script)
    assert there.returncode == 0, there.stderr
    disabled, answers = json.loads(there.stdout)
    assert disabled
    assert np.array(answers) == pytest.approx(np.array(here["answers"]), rel=1e-9, abs=1e-9)


def test_recorded_body_poses_match_the_scene():
    plant, truth = linear(start=Reference(1.0, 2.0, 0.0, 0.0, 0.5, 0.0))
    poses = dict(zip(plant.scene.bodies, plant.poses(), strict=True))
    assert {"chassis", "wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr"} <= set(poses)
    assert poses["chassis"][:2] == pytest.approx((truth.rear_x, truth.rear_y))
    assert np.linalg.norm(plant.poses()[:, 3:], axis=1) == pytest.approx(1.0)
    gap = poses["wheel_fl"][:3] - poses["wheel_fr"][:3]
    assert gap[:2] == pytest.approx(TRACTOR.track_m * np.array([-np.sin(0.5), np.cos(0.5)]), abs=1e-4)
    assert atan(gap[2]) == pytest.approx(0.0, abs=1e-4)
