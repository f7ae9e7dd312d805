"""Parts of the physics step: relief valves, power limit, loads on a tilted chassis, pressure, and masses."""

from math import cos, hypot, radians, sin

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, Drive, PointMass, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.hydraulics import Cylinder, Valve
from agrobot_mj.machine.implements import Mounted
from agrobot_mj.machine.linkage import Linkage
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.loads import AHEAD, CENTRE, HUNG, LEFT, PULL, SIDE, apply_loads, no_loads
from agrobot_mj.plants.mujoco.payload import Chassis, Inertial, with_payload
from agrobot_mj.plants.mujoco.stepping import DRIVE, STEERING, apply_tyres, open_relief_valves, take_up_play
from agrobot_mj.plants.mujoco.views import CHASSIS
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import Linear

ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
TRACTOR, STRONG = TractorParameters(), Cylinder(relief_pressure_bar=100.0)


def placed(yaw=0.0, pitch=0.0, roll=0.0, **machine):
    """Return a tractor at rest in mid-air with the given attitude [rad], before the first step."""
    plant = MujocoPlant(Mujoco(tyre=Linear(), settle_s=0.0), Machine(**machine), Flat().ground())
    plant.reset(ORIGIN)
    turns = [((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll)]
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in turns:
        turn, product = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array(axis, dtype=float), angle)
        mujoco.mju_mulQuat(product, quat, turn)
        quat = product
    plant.data.qpos[:7] = 3.0, -2.0, 1.0, *quat
    mujoco.mj_forward(plant.model, plant.data)
    return plant


# --- relief valves ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.0, 0.3])
@pytest.mark.parametrize("side", [1, -1])
def test_oil_column_deflection_is_limited_by_the_relief_pressure(side, rate):
    """The torque is the stiffness times the deflection from the wheels, minus the damping times the wheel rate."""
    plant = placed()
    v, oil = plant.views, plant.oil
    v.qpos[v.steer_q], v.qvel[v.steer_v] = 0.1, rate
    v.act[STEERING] = 0.1 + side * 0.5
    open_relief_valves(v, oil)
    column = Cylinder().column(TRACTOR)
    k, c = column.stiffness, column.damping
    torque = k * (v.act[STEERING] - 0.1) - c * rate
    assert torque == pytest.approx(side * column.relief_torque)


@pytest.mark.parametrize("side", [1, -1])
def test_oil_column_deflection_is_limited_at_the_steering_stops(side):
    plant = placed()
    v = plant.views
    v.qpos[v.steer_q] = side * (TRACTOR.steer_limit - 0.001)
    v.act[STEERING] = side * (TRACTOR.steer_limit + 0.02)
    open_relief_valves(v, plant.oil)
    assert v.act[STEERING] == pytest.approx(side * TRACTOR.steer_limit)


@pytest.mark.parametrize("play_deg", [0.0, 3.0])
@pytest.mark.parametrize("side", [1, -1])
def test_cylinder_at_its_stop_responds_immediately_when_steered_back(side, play_deg):
    """After ten seconds of full flow into the stop, the first reverse flow moves the oil column, without wind-up."""
    plant = placed(cylinder=STRONG, linkage=Linkage(backlash_deg=play_deg))
    v, oil, dt = plant.views, plant.oil, 0.002
    v.qpos[v.steer_q] = side * TRACTOR.steer_limit
    v.act[STEERING] = side * TRACTOR.steer_limit
    flow = side * 0.4

    def push(rate):
        v.ctrl[STEERING] = rate
        if oil.steer_play > 0.0:
            take_up_play(v, oil, plant.cylinder, dt)
        open_relief_valves(v, oil)
        v.act[STEERING] += dt * v.ctrl[STEERING]

    for _ in range(5000):
        push(flow)
    stop = TRACTOR.steer_limit + oil.steer_play
    column = plant.cylinder[0] if play_deg else v.act[STEERING]
    assert abs(column) <= stop + abs(flow) * dt + 1e-12
    for _ in range(50):
        push(-flow)
    column = plant.cylinder[0] if play_deg else v.act[STEERING]
    assert side * column == pytest.approx(stop - 0.4 * 49 * dt, abs=0.4 * 2 * dt)


@pytest.mark.parametrize(("cylinder", "column"), [(0.10, 0.10), (0.12, 0.10), (0.15, 0.12), (0.05, 0.08)])
def test_cylinder_exerts_no_torque_on_the_wheels_inside_the_backlash(cylinder, column):
    """Wheels are at 0.10 rad with a play of 0.03 rad to each side. A deflection beyond the play stretches the oil."""
    plant = placed(cylinder=STRONG, linkage=Linkage(backlash_deg=2 * np.degrees(0.03)))
    v = plant.views
    v.qpos[v.steer_q], plant.cylinder[0] = 0.10, cylinder
    take_up_play(v, plant.oil, plant.cylinder, 0.002)
    assert v.act[STEERING] == pytest.approx(column)


def driving(speed, stretch):
    """Return the torque of the hydrostat after its relief valves, for an oil column stretched by `stretch` [rad]."""
    plant = placed()
    v, oil = plant.views, plant.oil
    v.qvel[v.spins_v] = speed
    v.act[DRIVE] = stretch
    open_relief_valves(v, oil)
    return oil.drive_stiffness * (v.act[DRIVE] - oil.drive_lead * speed)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("speed", [0.0, 3.0, 12.0])
def test_driving_torque_is_limited_by_engine_power(way, speed):
    torque = driving(way * speed, way * 5.0)
    limit = 3000.0 if speed * 3000.0 < 14e3 else 14e3 / speed
    assert torque == pytest.approx(way * limit)


@pytest.mark.parametrize("way", [1, -1])
def test_braking_torque_is_limited_only_by_the_relief_valve(way):
    assert driving(way * 12.0, -way * 5.0) == pytest.approx(-way * 3000.0)


def test_drive_torque_depends_on_the_mean_speed_of_both_driven_wheels():
    plant = placed()
    v, oil = plant.views, plant.oil
    v.qpos[v.spins_q], v.qvel[v.spins_v] = (0.3, 0.5), (2.0, 4.0)
    v.act[DRIVE] = 9.0
    open_relief_valves(v, oil)
    torque = oil.drive_stiffness * (v.act[DRIVE] - 0.4) - oil.drive_stiffness * oil.drive_lead * 3.0
    assert torque == pytest.approx(3000.0)


HELD = Linkage(friction_n_m=2e4)  # Kingpins that no steering cylinder moves


def pushed_against_held_wheels(valve, seconds=2.0, volts=12.0, back_s=0.0):
    """Return the final flow [l/min] and pressure [bar], `back_s` after reversal of the valve."""
    machine = Machine(valve=valve, cylinder=STRONG, linkage=HELD)
    plant = MujocoPlant(Mujoco(tyre=Linear()), machine, Flat().ground())
    plant.reset(ORIGIN)
    for _ in range(round(seconds / 0.05)):
        truth = plant.advance(Drive(volts, NEUTRAL_V))
    for _ in range(round(back_s / 0.05)):
        plant.advance(Drive(12.0 - volts, NEUTRAL_V))
    assert abs(truth.steer) < radians(1.0)
    flow, pressure, _ = plant.actuation()
    return flow * 60e3, pressure / 1e5


@pytest.mark.parametrize(("volts", "side"), [(12.0, 1), (0.0, -1)])
def test_blocked_steered_wheels_raise_the_pressure_to_relief_pressure(volts, side):
    flow, pressure = pushed_against_held_wheels(Valve(), volts=volts)
    assert pressure == pytest.approx(side * 100.0, rel=0.01)
    assert flow == pytest.approx(side * 12.0)


def test_oil_column_torque_reverses_soon_after_a_long_pressure_relief():
    """The relief valve limits the oil column to 100 bar, or 0.09 rad, which takes 0.4 s including the valve's lag."""
    assert pushed_against_held_wheels(Valve(), back_s=0.6)[1] < 0.0


def test_uncompensated_valve_stalls_at_its_supply_pressure():
    """The pressure stays below the pressure of the relief valve, and the flow ends."""
    flow, pressure = pushed_against_held_wheels(Valve(supply_pressure_bar=60.0))
    assert pressure == pytest.approx(60.0, rel=0.01)
    assert flow == pytest.approx(0.0, abs=0.5)


def test_bristles_of_each_tyre_follow_the_velocity_of_its_own_contact():
    """In one step from rest, bristles move with the wheel centres, minus the motion of the rims.

    Roll of the chassis moves no patch. Pitch moves a wheel centre as much as it rotates its rim.
    """
    plant = MujocoPlant(Mujoco(tyre=Linear(rolling_resistance=0.0)), Machine(), Flat().ground())
    plant.reset(ORIGIN)
    v_x, v_y, omega, spin, dt = 0.4, 0.1, 0.3, 2.0, 0.002
    plant.data.qvel[:] = 0.0
    plant.data.qvel[:6] = v_x, v_y, 0.0, 0.15, -0.1, omega
    plant.data.qvel[plant.views.spins_v] = spin
    mujoco.mj_forward(plant.model, plant.data)
    tyred = plant.tyred
    tyred.bristles[:] = 0.0
    apply_tyres(plant.views, plant.views.wheels, tyred, dt, True)
    half, r_e = TRACTOR.track_m / 2, TRACTOR.rear_wheel_radius_m - 0.007
    for i, (ahead, left) in enumerate(
        [(TRACTOR.wheelbase_m, half), (TRACTOR.wheelbase_m, -half), (0, half), (0, -half)]
    ):
        rim = spin * r_e if i > 1 else 0.0
        slide = v_x - omega * left - rim, v_y + omega * ahead
        assert tyred.bristles[i, :2] / dt == pytest.approx(slide, abs=0.02), i


# --- loads --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.35, 0.0), (0.0, 0.4), (-0.3, -0.5)])
def test_external_side_force_on_a_tilted_chassis_is_horizontal(side, pitch, roll):
    yaw, force = 0.7, 500.0
    plant = placed(yaw, pitch, roll)
    loads = no_loads(0.5, 0.4)
    loads[SIDE], loads[CENTRE:HUNG] = side * force, plant.model.body_ipos[CHASSIS]
    apply_loads(plant.views, loads, 0.002)
    found = plant.data.xfrc_applied[CHASSIS]
    assert found[:3] == pytest.approx([-side * force * sin(yaw), side * force * cos(yaw), 0.0], abs=1e-9)
    # it acts on the whole tractor's centre of mass: from the chassis' own, where the wrench is given
    arm = plant.data.subtree_com[CHASSIS] - plant.data.xipos[CHASSIS]
    assert np.abs(arm).max() > 0.01
    assert found[3:] == pytest.approx(np.cross(arm, found[:3]), abs=1e-6)


def test_external_side_force_does_not_rotate_an_airborne_tractor():
    plant = placed(0.4, 0.2, -0.3)
    plant._apply_conditions(NOMINAL._replace(side_force=800.0))
    plant.loads[CENTRE:HUNG] = plant.model.body_ipos[CHASSIS]
    apply_loads(plant.views, plant.loads, 0.002)
    before = plant.data.qacc.copy()
    mujoco.mj_forward(plant.model, plant.data)
    gained = plant.data.subtree_com[CHASSIS] * 0.0
    M = np.zeros((plant.model.nv, plant.model.nv))
    mujoco.mj_fullM(plant.model, plant.data, M)
    gained = (M @ (plant.data.qacc - before))[:3]
    assert gained == pytest.approx(800.0 * np.array([-sin(0.4), cos(0.4), 0.0]), abs=1.0)


def test_external_side_force_acts_on_the_tractor_but_not_its_implement():
    plant = placed(0.7, 0.2, -0.3, implement=Mounted())
    model, data, loads = plant.model, plant.data, no_loads(0.5, 0.4)
    body = plant.attached.body
    hung = model.body_subtreemass[body]
    own = model.body_subtreemass[CHASSIS] - hung
    loads[SIDE], loads[CENTRE:HUNG], loads[HUNG] = 500.0, model.body_ipos[CHASSIS], hung / own
    apply_loads(plant.views, loads, 0.002)
    alone = (model.body_subtreemass[CHASSIS] * data.subtree_com[CHASSIS] - hung * data.subtree_com[body]) / own
    found = data.xfrc_applied[CHASSIS]
    assert found[3:] == pytest.approx(np.cross(alone - data.xipos[CHASSIS], found[:3]), abs=1e-6)


@pytest.mark.parametrize("way", [1, -1])
def test_implement_pull_opposes_hitch_velocity_in_the_chassis_plane(way):
    """The hitch velocity is computed by finite differences, for a tilted chassis with general motion."""
    plant, behind, height, pull = placed(0.7, 0.2, -0.3), 0.6, 0.45, 1500.0
    plant.data.qvel[:6] = way * np.array([1.1, 0.8, 0.1, 0.15, -0.1, 0.25])
    mujoco.mj_forward(plant.model, plant.data)

    def hitch(step):
        qpos = plant.data.qpos.copy()
        mujoco.mj_integratePos(plant.model, qpos, plant.data.qvel, step)
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, qpos[3:7])
        return qpos[:3] + R.reshape(3, 3) @ [-behind, 0.0, height]

    R = plant.data.xmat[CHASSIS].reshape(3, 3)
    velocity = R.T @ (hitch(1e-6) - hitch(-1e-6)) / 2e-6
    along = R @ [*velocity[:2], 0.0]
    loads = no_loads(behind, height)
    loads[PULL], loads[CENTRE:HUNG] = pull, plant.model.body_ipos[CHASSIS]
    for _ in range(400):
        apply_loads(plant.views, loads, 0.002)
    found = plant.data.xfrc_applied[CHASSIS]
    assert found[:3] == pytest.approx(-pull * along / np.linalg.norm(along), rel=0.01, abs=2.0)
    assert np.linalg.norm(found[:3]) == pytest.approx(pull, rel=0.01)
    arm = hitch(0.0) - plant.data.xipos[CHASSIS]
    assert found[3:] == pytest.approx(np.cross(arm, found[:3]))
    loads[PULL] = 0.0
    apply_loads(plant.views, loads, 0.002)
    assert not plant.data.xfrc_applied[CHASSIS].any()
    assert not loads[AHEAD : LEFT + 1].any()  # lifted, it forgets


# --- masses -------------------------------------------------------------------------------------------------------

LEANING = """<mujoco><worldbody><body name="chassis"><freejoint/>
<inertial pos="0.5 0.1 0.6" mass="400" fullinertia="60 180 200 -12 -25 8"/></body></worldbody></mujoco>"""
FULL = np.array([[60.0, -12.0, -25.0], [-12.0, 180.0, 8.0], [-25.0, 8.0, 200.0]])


def tensor(model):
    """Return the inertia of the chassis about its centre of mass, in chassis axes."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.body_iquat[CHASSIS])
    axes = R.reshape(3, 3)
    return axes @ np.diag(model.body_inertia[CHASSIS]) @ axes.T


def test_rotated_principal_inertia_axes_are_preserved_in_the_model():
    model = mujoco.MjModel.from_xml_string(LEANING)
    chassis = Chassis(model)
    assert chassis.bare.inertia == pytest.approx(FULL)
    load = PointMass(120.0, 1.5, -0.4, 1.1)
    chassis.carry((load,))
    mass = 400.0 + 120.0
    d = np.array(load[1:]) - np.array([0.5, 0.1, 0.6])
    assert model.body_mass[CHASSIS] == pytest.approx(mass)
    assert model.body_ipos[CHASSIS] == pytest.approx(np.array([0.5, 0.1, 0.6]) + 120 / mass * d)
    # two bodies about their common centre: the reduced mass at the distance between them
    reduced = 400.0 * 120.0 / mass
    assert tensor(model) == pytest.approx(FULL + reduced * (d @ d * np.eye(3) - np.outer(d, d)))
    chassis.carry(())
    assert tensor(model) == pytest.approx(FULL)


def test_off_centre_payload_rotates_the_principal_inertia_axes():
    """MuJoCo assumes body axes as principal axes if they coincided when the model was compiled."""
    text = LEANING.replace('fullinertia="60 180 200 -12 -25 8"', 'diaginertia="60 180 200"')
    model = mujoco.MjModel.from_xml_string(text)
    Chassis(model).carry((PointMass(100.0, 1.5, -0.4, 1.1),))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.xipos[CHASSIS] == pytest.approx([0.7, 0.0, 0.7])
    axes = data.ximat[CHASSIS].reshape(3, 3)
    found = axes @ np.diag(model.body_inertia[CHASSIS]) @ axes.T
    assert found == pytest.approx(tensor(model))
    assert abs(found[0, 1]) > 10.0


def test_removal_of_mass_from_the_chassis_reduces_its_inertia():
    bare = Inertial(400.0, np.array([0.5, 0.0, 0.6]), np.diag([60.0, 180.0, 200.0]))
    less = with_payload(bare, (PointMass(-30.0, 1.2, 0.0, 0.5),))
    assert less.mass == pytest.approx(370.0)
    assert less.centre[0] < 0.5
    assert less.inertia[2, 2] < 200.0


# --- what the sensors see -----------------------------------------------------------------------------------------


def test_true_attitude_and_velocities_agree_with_finite_differences():
    """The finite differences are computed from positions of sites of the model during a short free fall."""
    yaw, pitch, roll = 0.7, 0.2, -0.3
    plant = placed(yaw, pitch, roll)
    plant.data.qvel[:6] = 1.1, -0.4, 0.2, 0.3, -0.2, 0.5
    mujoco.mj_forward(plant.model, plant.data)
    plant._look()
    now = plant.motion
    assert now.attitude == pytest.approx((yaw, pitch, roll))
    qpos, h = plant.data.qpos.copy(), 1e-6
    places = []
    for step in (-h, h):
        moved = qpos.copy()
        mujoco.mj_integratePos(plant.model, moved, plant.data.qvel, step)
        plant.data.qpos[:] = moved
        mujoco.mj_kinematics(plant.model, plant.data)
        places.append([plant.data.site(name).xpos.copy() for name in ("cg", "antenna")])
        heading = np.arctan2(plant.data.xmat[CHASSIS, 3], plant.data.xmat[CHASSIS, 0])
        places[-1].append(heading)
    rates = [(after - before) / (2 * h) for before, after in zip(*places, strict=True)]
    assert now.cg.velocity == pytest.approx(rates[0], abs=1e-6)
    assert now.antenna.velocity == pytest.approx(rates[1], abs=1e-6)
    along = np.array([cos(yaw), sin(yaw)])
    assert now.speed == pytest.approx(rates[0][:2] @ along, abs=1e-6)
    assert now.lateral_speed == pytest.approx(rates[0][:2] @ np.array([-along[1], along[0]]), abs=1e-6)
    assert hypot(*now.cg.velocity[:2]) == pytest.approx(hypot(now.speed, now.lateral_speed))
