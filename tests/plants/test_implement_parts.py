"""Parts of an implement: its parameters, its body in the model, the soil force on it, and its reports."""

from math import degrees, radians

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.implements import Drawn, Mounted, NoImplement, Tool, TowedImplement
from agrobot_mj.machine.implements.base import box_inertia, sinking
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.implement import COLUMNS, implement_tyres
from agrobot_mj.plants.mujoco.model import DIAMETER_GYRATION_2, SPIN_GYRATION_2
from agrobot_mj.plants.mujoco.tools import (
    AHEAD,
    LEFT,
    MEMORIES,
    TRAVELLED,
    WHEEL_LOAD,
    apply_tools,
    carry_point,
    push_at,
    soil_on_tool,
    unevenness,
)
from agrobot_mj.plants.mujoco.views import CHASSIS
from agrobot_mj.terrain import Flat, Slope, height_and_gradient
from agrobot_mj.tyres import MagicFormula
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import CREEP_SPEED

TRACTOR = TractorParameters()
HITCH = np.array([-TRACTOR.hitch_behind_m, 0.0, TRACTOR.hitch_height_m])
TRAILER = Drawn(
    lowered=True,
    receiver=True,
    mass_kg=600.0,
    cg_behind_m=1.6,
    cg_height_m=0.7,
    axle_behind_m=1.9,
    tool_behind_m=2.3,
    track_m=1.3,
    wheel_mass_kg=25.0,
    slip_stiffness_scale=0.7,
    rolling_scale=1.4,
    antenna_height_m=1.8,
)
PLOUGH = Mounted(linkage="float", receiver=True, tool_left_m=0.2, antenna_height_m=1.7)


def placed(implement, yaw=0.7, pitch=0.2, roll=-0.3, terrain=Flat()):
    """Return a tractor in mid-air with attitude [rad], general motion, and an implement rotated at the hitch."""
    plant = MujocoPlant(Mujoco(settle_s=0.0), Machine(implement=implement), terrain.ground())
    plant.reset(Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll)):
        turn, product = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array(axis, dtype=float), angle)
        mujoco.mju_mulQuat(product, quat, turn)
        quat = product
    plant.data.qpos[:7] = 3.0, -2.0, 1.0, *quat
    plant.data.qvel[:6] = 1.1, -0.4, 0.2, 0.3, -0.2, 0.5
    model = plant.model
    for joint, angle, rate in (("hitch_yaw", 0.4, 0.3), ("hitch_pitch", -0.1, 0.2), ("hitch_roll", 0.15, -0.4)):
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) >= 0:
            plant.data.qpos[model.joint(joint).qposadr[0]] = angle
            plant.data.qvel[model.joint(joint).dofadr[0]] = rate
    mujoco.mj_forward(model, plant.data)
    return plant


def place_of(plant, at, step=0.0):
    """Return the world position of a point of the implement after moving for `step` [s] at the current velocity."""
    data = mujoco.MjData(plant.model)
    data.qpos[:] = plant.data.qpos
    mujoco.mj_integratePos(plant.model, data.qpos, plant.data.qvel, step)
    mujoco.mj_kinematics(plant.model, data)
    body = plant.attached.body
    return data.xpos[body] + data.xmat[body].reshape(3, 3) @ at


def velocity_of(plant, at, step=1e-6):
    return (place_of(plant, at, step) - place_of(plant, at, -step)) / (2 * step)


def sink_in(plant, at, depth):
    """Lower the tractor until a point of its implement is at a given depth below the ground."""
    x, y, z = place_of(plant, at)
    plant.data.qpos[2] += height_and_gradient(plant.ground, x, y)[0] - depth - z
    mujoco.mj_forward(plant.model, plant.data)


# --- numbers of the implement -----------------------------------------------------------------------------------------


def test_inertia_of_a_box_equals_the_inertia_of_its_combined_halves():
    """The box is divided along any axis, and the inertia of both halves refers to their common centre."""
    size, mass = (2.0, 1.2, 0.5), 90.0
    whole = box_inertia(mass, size)
    assert whole[2] == pytest.approx(mass / 12 * (2.0**2 + 1.2**2))
    for cut in range(3):
        half = [s / 2 if axis == cut else s for axis, s in enumerate(size)]
        shifted = [0.0 if axis == cut else mass * (size[cut] / 4) ** 2 for axis in range(3)]
        assert np.array(whole) == pytest.approx(2 * np.array(box_inertia(mass / 2, half)) + shifted)


@pytest.mark.parametrize("at", [0.0, 1.3, -0.5])
def test_rear_payload_compresses_tyres_according_to_their_stiffness(at):
    tractor = TractorParameters(front_tyre_stiffness_n_m=9e4, rear_tyre_stiffness_n_m=2.1e5)
    load, behind, L = 1500.0, 0.8, tractor.wheelbase_m
    front, rear = np.linalg.solve([[1.0, 1.0], [L, 0.0]], [load, -load * behind])  # sum, and moments about the rear
    front_sinks, rear_sinks = front / (2 * 9e4), rear / (2 * 2.1e5)
    assert sinking(tractor, load, behind, at) == pytest.approx(rear_sinks - at * (front_sinks - rear_sinks) / L)


def test_trailer_mass_and_cg_equal_the_sum_of_body_and_wheels():
    body = TRAILER.hitched(TRACTOR)
    axle = body.axle
    assert body.mass + 2 * axle.wheel.mass == pytest.approx(600.0)
    centre = (body.mass * np.array(body.centre) + 2 * axle.wheel.mass * np.array(axle.at)) / 600.0
    assert centre == pytest.approx([-1.6, 0.0, 0.7 - TRACTOR.hitch_height_m])
    sunk = axle.wheel.radius - (axle.at[2] + TRACTOR.hitch_height_m)
    assert 2 * axle.wheel.stiffness * sunk == pytest.approx(600.0 * GRAVITY * 1.6 / 1.9)
    assert body.inertia == box_inertia(550.0, (1.8, 1.1, 0.6))


def test_tool_working_point_and_antenna_are_at_configured_positions():
    ground = -TRACTOR.hitch_height_m
    body = TRAILER.hitched(TRACTOR)
    assert body.tool_at == pytest.approx((-2.3, 0.0, ground - 0.12))
    assert body.point == (-2.3, 0.0, ground)
    assert body.antenna == pytest.approx((-2.3, 0.0, ground + 1.8))
    assert TRAILER.receiver_behind(TRACTOR) == pytest.approx(TRACTOR.hitch_behind_m + 2.3)
    lifted = Drawn().hitched(TRACTOR)
    assert lifted.point == (-2.0, 0.0, ground)
    assert (lifted.tool, lifted.antenna, Drawn().receiver_behind(TRACTOR)) == (None, None, 0.0)
    body = PLOUGH.hitched(TRACTOR)
    carried = body.depth_wheel.stiffness * (ground - body.depth_wheel.at[2])
    assert carried * (1.0 + 0.6) == pytest.approx(110.0 * GRAVITY * (1.0 + 0.55))  # moments about the virtual hitch
    assert body.depth_wheel.at[:2] == (-0.6, 0.0)
    assert body.tool_at == pytest.approx((-0.7, 0.2, ground - 0.12))
    assert body.antenna == pytest.approx((-0.7, 0.0, ground + 1.7))
    assert body.centre == pytest.approx((-0.55, 0.0, ground + 0.45))
    assert body.inertia == box_inertia(110.0, (0.9, 0.7, 0.5))
    sunk = sinking(TRACTOR, 110.0 * GRAVITY, TRACTOR.hitch_behind_m + 0.55, TRACTOR.hitch_behind_m + 0.7)
    assert Mounted().hitched(TRACTOR).tool_at == pytest.approx((-0.7, 0.0, ground + sunk - 0.12))
    assert Mounted().hitched(TRACTOR).depth_wheel.stiffness == 0.0


def test_tool_lateral_stiffness_per_degree_is_converted_to_per_radian():
    law = Tool(cornering_stiffness_n_deg=150.0).law()
    assert law.cornering * radians(1.0) == pytest.approx(150.0)
    assert law.by_depth == 1.0
    assert Tool(type="grain_drill").law().by_depth == 0.0


def ends(hitched, name):
    """Return the minimum and maximum coordinates of a shape relative to the hitch, shape (2, 3) [m]."""
    (shape,) = (shape for shape in hitched.shapes if shape.name == name)
    return np.array([np.subtract(shape.at, shape.half), np.add(shape.at, shape.half)])


def test_displayed_parts_of_a_trailer_are_connected():
    hitched, ground = TRAILER.hitched(TRACTOR), -TRACTOR.hitch_height_m
    drawbar, frame, body = (ends(hitched, name) for name in ("drawbar", "frame", "body"))
    assert drawbar[1, 0] == pytest.approx(0.0)
    assert drawbar[0, 0] < frame[1, 0] < 0.0
    assert frame[:, 0] == pytest.approx(hitched.centre[0] + np.array([-0.9, 0.9]))
    assert body[:, :2] == pytest.approx(np.array([[frame[0, 0], -0.55], [frame[1, 0], 0.55]]))
    assert body[0, 2] >= hitched.axle.at[2] + hitched.axle.wheel.radius  # above its wheels
    beam = ends(hitched, "axle_beam_i")
    assert beam.mean(axis=0) == pytest.approx(hitched.axle.at)
    assert beam[:, 1] == pytest.approx([-0.65, 0.65])
    bar = ends(hitched, "toolbar")
    assert bar.mean(axis=0) == pytest.approx([-2.3, 0.0, ground + 0.3])
    for leg in ("leg_0", "leg_1", "leg_2"):
        found = ends(hitched, leg)
        assert found[:, 2] == pytest.approx([ground, ground + 0.3])
        assert found.mean(axis=0)[0] == -2.3
    sides = [ends(hitched, f"leg_{i}")[:, 1].mean() for i in range(3)]
    assert sides == pytest.approx([-0.44, 0.0, 0.44])
    assert not any("leg" in shape.name for shape in Drawn().hitched(TRACTOR).shapes)


def test_displayed_parts_of_a_mounted_implement_are_connected():
    hitched, ground = PLOUGH.hitched(TRACTOR), -TRACTOR.hitch_height_m
    bar = hitched.centre[2]
    assert ends(hitched, "beam")[:, 0] == pytest.approx([-0.9, 0.0])
    assert ends(hitched, "beam").mean(axis=0)[2] == bar
    assert ends(hitched, "toolbar")[:, 1] == pytest.approx([-0.35, 0.35])
    assert ends(hitched, "toolbar").mean(axis=0) == pytest.approx([-0.7, 0.0, bar])
    assert ends(hitched, "leg")[:, 2] == pytest.approx([ground, bar])
    assert ends(hitched, "share")[0, 2] == pytest.approx(ground)
    for part in ("leg", "share"):
        assert ends(hitched, part).mean(axis=0)[:2] == pytest.approx([-0.7, 0.2])
    wheel = ends(hitched, "depth_wheel")
    assert wheel.mean(axis=0)[:2] == pytest.approx([-0.6, 0.35])
    assert wheel[:, 2] == pytest.approx([ground, ground + 0.32])
    head = ends(hitched, "headstock")
    assert head[0, 2] < bar < head[1, 2]
    assert head[:, 1] == pytest.approx([-0.3, 0.3])
    assert "depth_wheel" not in {shape.name for shape in Mounted().hitched(TRACTOR).shapes}


# --- in the model -----------------------------------------------------------------------------------------------------


def test_model_has_the_masses_wheels_and_stops_of_the_trailer():
    plant, hitched = placed(TRAILER), TRAILER.hitched(TRACTOR)
    model, body = plant.model, plant.attached.body
    assert model.body_pos[body] == pytest.approx(HITCH)
    assert (model.body_mass[body], model.body_ipos[body].tolist()) == (hitched.mass, list(hitched.centre))
    assert model.body_inertia[body] == pytest.approx(hitched.inertia)
    assert model.body_subtreemass[CHASSIS] == pytest.approx(TRACTOR.mass_kg + 600.0)
    for name, limit in (("hitch_yaw", 85.0), ("hitch_pitch", 25.0), ("hitch_roll", 25.0)):
        assert np.degrees(model.joint(name).range) == pytest.approx([-limit, limit])
    for wheel, side in (("il", 1), ("ir", -1)):
        part = model.body(f"wheel_{wheel}")
        assert part.pos == pytest.approx([-1.9, side * 0.65, hitched.axle.at[2]])
        assert part.mass[0] == 25.0
        gyration = [DIAMETER_GYRATION_2, SPIN_GYRATION_2, DIAMETER_GYRATION_2]
        assert sorted(part.inertia) == pytest.approx(sorted(25.0 * 0.3**2 * np.array(gyration)))
        assert model.joint(f"spin_{wheel}").axis == pytest.approx([0.0, 1.0, 0.0])


def test_floating_implement_rotates_about_its_virtual_hitch_point():
    plant = placed(PLOUGH)
    virtual = place_of(plant, np.array([1.0, 0.0, 0.0]))
    chassis = plant.data.xpos[CHASSIS] + plant.data.xmat[CHASSIS].reshape(3, 3) @ (HITCH + [1.0, 0.0, 0.0])
    assert virtual == pytest.approx(chassis)
    assert np.degrees(plant.model.joint("hitch_pitch").range) == pytest.approx([-15.0, 15.0])


def test_trailer_tyres_have_a_separate_size_and_the_rear_tyre_model():
    axle, tyre = TRAILER.hitched(TRACTOR).axle, MagicFormula()
    two, four = implement_tyres(axle, tyre, TRACTOR), tyre_set(tyre, TRACTOR)
    assert two.radius.tolist() == [0.3, 0.3]
    load = 600.0 * GRAVITY * 1.6 / 1.9 / 2
    heavier = load / (500.0 * GRAVITY * 1.75 / 2.0 / 2)
    assert two.stiffness == pytest.approx([1.8e5 * heavier] * 2)
    assert two.damping == pytest.approx([1800.0 * heavier] * 2)
    assert two.carcass.tolist() == [[0.7, 1.4]] * 2
    assert two.springs == pytest.approx(np.array([[0.6, 0.45]] * 2) * two.stiffness[0])
    assert four.springs[2:] == pytest.approx(np.array([[0.6, 0.45]] * 2) * four.stiffness[2])
    assert two.front == two.rear == four.rear._replace(F_z0=pytest.approx(load))
    assert two.treads[0] == two.treads[1] != four.treads[1]


# --- the soil's wrench ------------------------------------------------------------------------------------------------


def test_velocity_of_an_implement_point_equals_finite_differences():
    plant, at = placed(TRAILER), (-1.5, 0.4, -0.2)
    place, velocity = carry_point(plant.views, plant.attached.body, at)
    assert place == pytest.approx(place_of(plant, at))
    assert velocity == pytest.approx(velocity_of(plant, at), abs=1e-6)


def test_forces_on_a_body_add_up_to_a_wrench_about_its_cg():
    plant = placed(TRAILER)
    body, wrench = plant.attached.body, np.zeros(6)
    plant.data.xfrc_applied[body] = 0.0
    for place, force in (((1.0, 2.0, 0.5), (10.0, -20.0, 30.0)), ((-1.0, 0.3, 0.2), (5.0, 7.0, -9.0))):
        push_at(plant.views, body, place, force)
        wrench += [*force, *np.cross(np.array(place) - plant.data.xipos[body], force)]
    assert plant.data.xfrc_applied[body] == pytest.approx(wrench)


def test_soil_force_acts_at_half_working_depth_in_implement_axes():
    plant, depth = placed(TRAILER), 0.08
    a, body = plant.attached, plant.attached.body
    tip = np.array(a.tip)
    sink_in(plant, tip, depth)
    a.memory[:] = 0.01, -0.005, 3.3, 100.0, 0.5
    memory, R = a.memory.copy(), plant.data.xmat[body].reshape(3, 3)
    v_x, v_y, _ = R.T @ velocity_of(plant, tip)
    force = soil_on_tool(a.tool, unevenness(a.uneven, a.uneven_step, 3.3), v_x, v_y, depth, 0.002, memory)
    plant.data.xfrc_applied[body] = 9.0  # of the step before
    apply_tools(plant.views, a, plant.ground, 0.002)
    place = place_of(plant, tip) + [0.0, 0.0, depth / 2]
    torque = np.cross(place - plant.data.xipos[body], R @ force)
    assert np.linalg.norm(force) > 100.0
    assert plant.data.xfrc_applied[body] == pytest.approx(np.array([*(R @ force), *torque]), rel=1e-5)
    assert a.report[:3] == pytest.approx([-force[0], force[1], depth], rel=1e-5)
    assert a.memory == pytest.approx(memory)


def test_tool_above_the_ground_has_no_force():
    plant = placed(TRAILER)
    a = plant.attached
    sink_in(plant, np.array(a.tip), -0.05)
    a.memory[:] = 0.01, -0.005, 3.3, 100.0, 0.5
    apply_tools(plant.views, a, plant.ground, 0.002)
    assert not plant.data.xfrc_applied[a.body].any()
    assert not a.report[:3].any()
    assert a.memory.tolist() == [0.0, 0.0, 3.3, 0.0, 0.0]


@pytest.mark.parametrize("rising", [0.0, -1.0, 20.0])
def test_depth_wheel_has_normal_force_and_rolling_resistance(rising):
    """The load of spring and damper follows from finite differences of the wheel height; the ground never pulls."""
    plant = placed(
        PLOUGH.model_copy(update={"lowered": False}), 0.4, 0.05, -0.1, Slope(grade_deg=8.0, direction_deg=50.0)
    )
    a, body = plant.attached, plant.attached.body
    wheel, at = a.depth_wheel, np.array(a.depth_wheel.at)
    plant.data.qvel[2] += rising
    sink_in(plant, at, 0.02)

    def sunk(step):
        x, y, z = place_of(plant, at, step)
        return height_and_gradient(plant.ground, x, y)[0] - z

    load = max(wheel.stiffness * 0.02 + wheel.damping * (sunk(1e-6) - sunk(-1e-6)) / 2e-6, 0.0)
    assert (load == 0.0) == (rising > 1.0)
    forward = plant.data.xmat[body].reshape(3, 3)[:, 0]
    place = place_of(plant, at)
    _, dx, dy = height_and_gradient(plant.ground, *place[:2])
    drag = wheel.rolling * load * np.tanh(forward @ velocity_of(plant, at) / CREEP_SPEED)
    force = load * np.array([-dx, -dy, 1.0]) - drag * forward
    apply_tools(plant.views, a, plant.ground, 0.002)
    assert plant.data.xfrc_applied[body, :3] == pytest.approx(force, rel=1e-5)
    torque = np.cross(place - plant.data.xipos[body], force)
    assert plant.data.xfrc_applied[body, 3:] == pytest.approx(torque, rel=1e-5)
    assert a.report[WHEEL_LOAD] == pytest.approx(load, rel=1e-5)
    sink_in(plant, at, -0.01)
    apply_tools(plant.views, a, plant.ground, 0.002)
    assert not plant.data.xfrc_applied[body].any()
    assert a.report[WHEEL_LOAD] == 0.0


def test_soil_unevenness_is_interpolated_and_periodic():
    uneven = np.array([1.0, 2.0, 4.0])
    for travelled, value in ((0.0, 1.0), (0.125, 1.25), (0.5, 2.0), (0.75, 3.0), (1.25, 2.5), (1.5, 1.0), (3.5, 2.0)):
        assert unevenness(uneven, 0.5, travelled) == pytest.approx(value)


def test_worked_distance_counts_motion_in_both_directions_only_in_soil():
    law, memory = Tool(depth_m=0.1).law(), np.zeros(MEMORIES)
    for v_x, depth in ((1.0, 0.1), (-2.0, 0.05), (3.0, 0.0), (3.0, -0.1)):
        soil_on_tool(law, 1.0, v_x, 0.1, depth, 0.01, memory)
    assert memory[TRAVELLED] == pytest.approx(0.03)


def test_tool_without_lateral_stiffness_has_no_lateral_force():
    memory = np.zeros(MEMORIES)
    memory[LEFT] = 0.01
    free = Tool(cornering_stiffness_n_deg=0.0).law()
    assert soil_on_tool(free, 1.0, 1.0, 0.3, 0.1, 0.002, memory)[1] == 0.0
    assert memory[LEFT] == 0.0
    assert memory[AHEAD] > 0.0


def test_lateral_force_of_a_tool_scales_with_small_lateral_stiffness():
    """The lateral force is divided by the slip angle, after many relaxation lengths."""
    for stiffness in (150.0, 1e-2, 1e-5):
        law, memory = Tool(depth_m=0.1, cornering_stiffness_n_deg=stiffness).law(), np.zeros(MEMORIES)
        for _ in range(400):
            _, f_y, _ = soil_on_tool(law, 1.0, 1.0, 0.01, 0.1, 0.02, memory)
        assert f_y == pytest.approx(-degrees(stiffness) * 0.01, rel=1e-3)


# --- what it reports --------------------------------------------------------------------------------------------------


def test_implement_reports_position_angle_and_hitch_force():
    plant = placed(TRAILER, pitch=0.0, roll=0.0)
    hung = plant.attached
    hung.pull[:] = 300.0, -50.0, 70.0
    hung.report[:] = 11.0, 12.0, 0.13, 14.0
    found = dict(zip((column.name for column in COLUMNS), plant.report(), strict=True))
    x, y, _ = place_of(plant, np.array(TRAILER.hitched(TRACTOR).point))
    assert (found["implement_x"], found["implement_y"]) == pytest.approx((x, y))
    R = plant.data.xmat[plant.attached.body].reshape(3, 3)
    assert found["implement_yaw"] == pytest.approx(np.arctan2(R[1, 0], R[0, 0]))
    assert found["hitch_angle"] == pytest.approx(found["implement_yaw"] - 0.7)
    ahead, left = np.array([np.cos(0.7), np.sin(0.7), 0.0]), np.array([-np.sin(0.7), np.cos(0.7), 0.0])
    pulled = [found[f"hitch_{name}"] for name in ("pull", "side", "lift")]
    assert pulled == pytest.approx([hung.pull @ ahead, hung.pull @ left, 70.0])
    assert [found[name] for name in ("draught", "tool_side", "tool_depth")] == [11.0, 12.0, 0.13]
    assert np.isnan(found["depth_wheel_load"])
    plant.truth()
    assert plant.motion.lean_cosine == pytest.approx(min(R[2, 2], plant.data.xmat[CHASSIS][8]))
    assert degrees(found["hitch_angle"]) > 20.0


# --- stability --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"depth_wheel_stiffness_n_m": 1e9}, "depth_wheel_stiffness_n_m"),
        ({"depth_wheel_damping_n_s_m": 1e7}, "depth_wheel_damping_n_s_m"),
    ],
)
def test_depth_wheel_too_stiff_for_its_mass_is_rejected(change, told):
    """The effective mass m at the wheel follows from its acceleration under a force: 2 c dt + k dt^2 < 4 m."""
    plant, dt = placed(PLOUGH), 0.002
    model, data = plant.model, mujoco.MjData(plant.model)
    mujoco.mj_forward(model, data)
    inertia, jacobian, push = np.zeros((model.nv,) * 2), np.zeros((3, model.nv)), np.zeros(model.nv)
    body = plant.attached.body
    place = data.xpos[body] + plant.attached.depth_wheel.at
    mujoco.mj_fullM(model, data, inertia)
    mujoco.mj_applyFT(model, data, np.array([0.0, 0.0, 1.0]), np.zeros(3), place, body, push)
    mujoco.mj_jac(model, data, jacobian, None, place, body)
    mass = 1.0 / (jacobian[2] @ np.linalg.solve(inertia, push))
    spec = PLOUGH.model_copy(update=change)
    damping = spec.depth_wheel_damping_n_s_m if "damping" in told else 0.0
    weight = 2.0 * dt * damping + dt * dt * spec.depth_wheel_stiffness_n_m
    limit = 4.0 * mass / weight * change[told]
    with pytest.raises(ValueError, match=f"implement.{told}: must be below {limit:.2g}".replace("+", "\\+")):
        MujocoPlant(Mujoco(settle_s=0.0), Machine(implement=spec), Flat().ground())


def test_guidance_receives_length_state_and_antenna_of_the_implement():
    drawn = Drawn(lowered=True, receiver=True, axle_behind_m=1.9, tool_behind_m=2.4)
    behind = TRACTOR.hitch_behind_m
    assert drawn.towed(TRACTOR) == pytest.approx((behind + 1.9, True, behind + 2.4))
    assert Drawn(axle_behind_m=1.9).towed(TRACTOR) == pytest.approx((behind + 1.9, False, 0.0))
    assert Mounted().towed(TRACTOR).length == 0.0, "rigid with the tractor"
    assert NoImplement().towed(TRACTOR) == TowedImplement()
