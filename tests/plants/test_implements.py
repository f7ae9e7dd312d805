"""Implements at the hitch of the MuJoCo tractor: statics, soil forces, geometry, and force balance."""

from math import atan2, degrees, radians

import numpy as np
import pytest
from numba import config
from numba.core.runtime import _nrt_python, rtsys

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.implements import Drawn, Mounted, Tool
from agrobot_mj.machine.implements.base import Unevenness
from agrobot_mj.machine.implements.draught import TOOLS, ToolLaw, draught
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.plants.driver import Driver
from agrobot_mj.plants.mujoco.implement import COLUMNS, draught_pattern
from agrobot_mj.plants.mujoco.loads import SIDE
from agrobot_mj.plants.mujoco.tools import GIVE, MEMORIES, carry_point, soil_on_tool
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.terrain import Flat, Rough, Slope
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Soil
from agrobot_mj.tyres.patch import LOAD

TRACTOR, REST = TractorParameters(), Drive(NEUTRAL_V, NEUTRAL_V)
L, B = TRACTOR.wheelbase_m, TRACTOR.hitch_behind_m
ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
STILL = Tool(noise_share=0.0)
EVERY = [Mounted(), Mounted(linkage="float"), Drawn(), Drawn(lowered=True), Mounted(lowered=False)]
NAMES = ["rigid", "floating", "trailer", "drawn tool", "lifted"]


def plant_with(implement, tyre=None, terrain=Flat(), tractor=TRACTOR, seed=1, dt=0.002):
    machine = Machine(tractor=tractor, implement=implement)
    plant = MujocoPlant(Mujoco(tyre=tyre or MagicFormula()), machine, terrain.ground(), Clock.of(dt), seed)
    return plant, plant.reset(ORIGIN)


def said(plant):
    return dict(zip((column.name for column in COLUMNS), plant.report(), strict=True))


def loads_of(plant):
    return plant.wheels().reshape(6, 4)[LOAD]


@pytest.mark.parametrize("implement", EVERY, ids=NAMES)
def test_loads_of_tractor_wheels_and_depth_wheel_add_up_to_the_weight(implement):
    plant, _ = plant_with(implement)
    found = said(plant)
    carried = loads_of(plant).sum() + np.nansum([found[k] for k in ("load_il", "load_ir", "depth_wheel_load")])
    assert carried == pytest.approx((TRACTOR.mass_kg + implement.mass_kg) * GRAVITY, rel=2e-3)


def test_load_shift_by_a_mounted_implement_agrees_with_statics():
    plant, _ = plant_with(Mounted(lowered=False))
    weight, behind = Mounted().mass_kg * GRAVITY, B + Mounted().cg_behind_m
    raised = weight * behind / L
    # the tyres yield, and the pitch moves the weights backwards by their heights above the rear axle
    axle = TRACTOR.rear_wheel.radius - TRACTOR.rear_wheel.deflection
    pitch = (raised / TRACTOR.front_wheel.stiffness + (weight + raised) / TRACTOR.rear_wheel.stiffness) / 2 / L
    heights = TRACTOR.cg_height_m - axle, Mounted().cg_height_m - axle
    moved = pitch * (TRACTOR.mass_kg * GRAVITY * heights[0] + weight * heights[1]) / L
    assert loads_of(plant)[:2].sum() == pytest.approx(TRACTOR.front_axle_load - raised - moved, rel=5e-3)


def test_trailer_weight_is_divided_between_hitch_and_axle_by_leverage():
    plant, _ = plant_with(Drawn())
    weight, share, found = Drawn().mass_kg * GRAVITY, Drawn().cg_behind_m / Drawn().axle_behind_m, said(plant)
    assert found["load_il"] + found["load_ir"] == pytest.approx(share * weight, rel=5e-3)
    assert found["hitch_lift"] == pytest.approx((1 - share) * weight, rel=2e-2)
    assert loads_of(plant)[:2].sum() == pytest.approx(TRACTOR.front_axle_load - (1 - share) * weight * B / L, rel=5e-3)


def test_depth_wheel_load_follows_from_moments_about_the_virtual_hitch():
    implement = Mounted(linkage="float", lowered=False)
    plant, _ = plant_with(implement)
    assert said(plant)["depth_wheel_load"] == pytest.approx(
        implement._static_load(implement.mass_kg * GRAVITY), rel=1e-2
    )


@pytest.mark.parametrize("implement", [Mounted(), Mounted(linkage="float"), Drawn(lowered=True)], ids=str)
def test_tool_works_at_its_configured_depth(implement):
    plant, _ = plant_with(implement)
    assert said(plant)["tool_depth"] == pytest.approx(implement.tool.depth_m, abs=0.003)


@pytest.mark.parametrize("tyre", [MagicFormula(), Soil(), Linear()], ids=lambda tyre: tyre.kind)
@pytest.mark.parametrize("implement", EVERY[:4], ids=NAMES[:4])
def test_parked_tractor_with_implement_does_not_creep_on_a_slope(implement, tyre):
    plant, _ = plant_with(implement, tyre, Slope(grade_deg=10.0, direction_deg=50.0))
    start = np.array([*plant.truth()[1:4], said(plant)["implement_x"], said(plant)["implement_y"]])
    for _ in range(200):
        truth = plant.advance(REST)
    end = np.array([*truth[1:4], said(plant)["implement_x"], said(plant)["implement_y"]])
    assert np.abs(end - start).max() < 2e-3
    assert plant.warnings() == 0


@pytest.mark.parametrize("kind", TOOLS)
@pytest.mark.parametrize("texture", ["fine", "medium", "coarse"])
def test_draught_equals_the_published_standard(kind, texture):
    row, tool = TOOLS[kind], Tool(type=kind, size=2.0, texture=texture, depth_m=0.1)
    F = row.textures[("fine", "medium", "coarse").index(texture)]
    D = F * (row.a + row.b * 7.2 + row.c * 7.2**2) * 2.0 * (10.0 if row.by_depth else 1.0)
    assert draught(tool.law(), 2.0, 0.1) == pytest.approx(D)
    assert draught(tool.law(), 2.0, 0.05) == pytest.approx(D / 2)
    assert draught(tool.law(), 2.0, -0.1) == 0.0


def worked(law, v_x, v_y, seconds=5.0, depth=0.1, dt=0.002):
    """Return the force on a tool at the end of a steady motion, and its internal state."""
    memory, force = np.zeros(MEMORIES), (0.0, 0.0, 0.0)
    for _ in range(round(seconds / dt)):
        force = soil_on_tool(law, 1.0, v_x, v_y, depth, dt, memory)
    return force, memory


LAW: ToolLaw = Tool(depth_m=0.1, cornering_stiffness_n_deg=120.0, side_limit_n=900.0, suction_share=0.3).law()


@pytest.mark.parametrize("v_x", [0.5, -0.5, 2.0])
def test_draught_opposes_motion_and_suction_acts_only_in_forward_motion(v_x):
    (f_x, f_y, f_z), _ = worked(LAW, v_x, 0.0)
    D = draught(LAW, v_x, 0.1)
    assert f_x == pytest.approx(-D if v_x > 0 else D)
    assert f_y == 0.0
    assert f_z == pytest.approx(-0.3 * D if v_x > 0 else 0.0)


@pytest.mark.parametrize("slip_deg", [-3.0, 1.0, 3.0])
def test_lateral_tool_force_opposes_the_slip_with_its_stiffness(slip_deg):
    v_y = 1.5 * np.tan(radians(slip_deg))
    (_, f_y, _), _ = worked(LAW, 1.5, v_y)
    assert f_y == pytest.approx(-120.0 * slip_deg, rel=2e-3)
    assert worked(LAW, 1.5, v_y, depth=0.05)[0][1] == pytest.approx(f_y / 2)


def test_lateral_tool_force_builds_up_over_the_relaxation_length():
    (_, f_y, _), _ = worked(LAW, 1.0, 0.05, seconds=LAW.relaxation)
    assert f_y / worked(LAW, 1.0, 0.05)[0][1] == pytest.approx(1 - np.exp(-1), abs=0.005)


def test_lateral_tool_force_is_limited_by_the_soil_and_reset_by_lifting():
    (_, f_y, _), memory = worked(LAW, 0.5, -0.4)
    assert f_y == pytest.approx(900.0)
    assert soil_on_tool(LAW, 1.0, 0.5, -0.4, -0.01, 0.002, memory) == (0.0, 0.0, 0.0)
    assert memory[:2].tolist() == [0.0, 0.0]


def test_tool_at_rest_acts_as_a_spring_with_its_draught_as_force_limit():
    memory, k = np.zeros(MEMORIES), LAW.cornering / LAW.relaxation
    for _ in range(100):
        _, f_y, _ = soil_on_tool(LAW, 1.0, 0.0, 0.01, 0.1, 0.002, memory)
    assert f_y == pytest.approx(-k * 0.01 * 0.2)
    memory[0] = 10 * GIVE
    assert soil_on_tool(LAW, 1.0, 0.0, 0.0, 0.1, 0.002, memory)[0] == pytest.approx(-draught(LAW, 0.0, 0.1))


def test_soil_unevenness_has_configured_spread_and_correlation_length():
    uneven, step = draught_pattern(Unevenness(0.2, 0.5), 3)
    assert uneven.mean() == pytest.approx(1.0, abs=0.02)
    assert uneven.std() == pytest.approx(0.2, abs=0.02)
    assert uneven.min() > 0.0
    lag = round(0.5 / step)
    assert np.corrcoef(uneven[:-lag], uneven[lag:])[0, 1] == pytest.approx(np.exp(-1), abs=0.08)
    assert not np.array_equal(uneven, draught_pattern(Unevenness(0.2, 0.5), 4)[0])


def test_off_centre_draught_yaws_the_tractor_towards_the_tool():
    plant, truth = plant_with(Mounted(tool_left_m=-0.2, tool=STILL))
    yaw_rate = Driver(plant, truth, 1.0).go(8.0, 0.0).mean("yaw_rate", 2.0)
    assert yaw_rate < -0.005


def test_reversing_a_trailer_into_jackknife_causes_no_physics_warnings():
    plant, truth = plant_with(Drawn())
    driver = Driver(plant, truth, -1.0)
    driver.go(12.0, 0.1)
    assert abs(degrees(said(plant)["hitch_angle"])) > 30.0  # reversing a trailer is unstable
    assert np.isfinite(plant.data.qpos).all()
    assert plant.warnings() == 0


def test_friction_fault_but_not_side_force_fault_acts_on_the_trailer():
    plant, _ = plant_with(Drawn())
    plant.advance(REST, NOMINAL._replace(grip=0.4, side_force=100.0))
    assert plant.attached.tyres.grip.tolist() == [0.4, 0.4]
    assert plant.loads[SIDE] == 100.0
    R, q = plant.data.xmat[1].reshape(3, 3), plant.data.qpos[:3]
    wrench, ipos = plant.data.xfrc_applied[1], plant.data.xipos[1]
    arm = R.T @ (np.array([-wrench[5], 0.0, wrench[3]]) / wrench[1] * -1 + (ipos - q))
    assert arm[0] == pytest.approx(TRACTOR.cg_to_rear_axle, abs=2e-3)


def test_draught_pattern_depends_only_on_the_seed():
    pulls = {}
    for seed in (1, 1, 2):
        plant, truth = plant_with(Mounted(), seed=seed)
        Driver(plant, truth, 1.0).go(3.0)
        pulls.setdefault(seed, []).append(said(plant)["draught"])
    assert pulls[1][0] == pulls[1][1] != pulls[2][0]


def test_trailer_can_use_native_mujoco_contact():
    plant, truth = plant_with(Drawn(), Contact())
    Driver(plant, truth, 1.0).go(4.0)
    place, _ = carry_point(plant.views, plant.attached.body, (-2.0, 0.0, -0.35))
    assert place[2] == pytest.approx(0.0, abs=0.03)
    assert plant.warnings() == 0


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
@pytest.mark.parametrize("implement", [Mounted(linkage="float"), Drawn(lowered=True)], ids=["floating", "drawn tool"])
def test_compiled_kernels_with_an_implement_do_not_leak_arrays(implement):
    plant = plant_with(implement, terrain=Rough(half_size_m=20.0))[0]
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for _ in range(20):
            plant.advance_held(Drive(7.0, 8.0))
        after = rtsys.get_allocation_stats()
        assert after.alloc - before.alloc == after.free - before.free > 0
    finally:
        _nrt_python.memsys_disable_stats()


def test_antenna_on_the_implement_moves_with_the_implement():
    plant, truth = plant_with(Drawn(receiver=True))
    driver = Driver(plant, truth, 1.0)
    trace = driver.go(10.0, 0.2)
    places = np.array([t.antenna for t in trace.truths])
    found = said(plant)
    assert places[-1][:2] == pytest.approx([found["implement_x"], found["implement_y"]], abs=0.05)
    assert places[-1][2] == pytest.approx(2.0, abs=0.03)
    measured = (places[-1] - places[-3]) / 0.1
    assert trace.truths[-2].antenna_velocity == pytest.approx(measured.tolist(), abs=0.01)
    course = atan2(measured[1], measured[0])
    assert course == pytest.approx(found["implement_yaw"], abs=0.08)


@pytest.mark.parametrize("estimator", ["ekf", "ekf_full"])
def test_antenna_on_a_rigid_implement_gives_the_rear_axle_position(estimator):
    sensors = {f"sensors.{name}.enabled": True for name in ("gyro", "wheel_speed")}
    still = {"sensors.gnss.sigma_m": 0.001, "duration_s": 15.0, "estimator.kind": estimator, **sensors}
    lifted = {"implement.kind": "mounted", "implement.lowered": False, "implement.receiver": True}
    log = run(load_scenario("straight_line", {**still, **lifted}))
    off = np.hypot(log.column("rear_x_hat") - log.column("rear_x"), log.column("rear_y_hat") - log.column("rear_y"))
    assert off[100:].max() < 0.1


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ({"implement.receiver": True}, "implement.receiver: the scenario has no implement"),
        ({"plant.kind": "bicycle", "implement.kind": "drawn"}, "implement.kind: the bicycle plant has no body"),
        ({"implement.kind": "drawn", "implement.tool.type": "rake"}, "implement.tool.type"),
        ({"implement.kind": "mounted", "implement.axle_behind_m": 2.0}, "implement.axle_behind_m"),
    ],
)
def test_error_for_a_physically_impossible_implement_names_the_key(overrides, told):
    with pytest.raises(ScenarioError, match=told):
        load_scenario("straight_line", overrides)


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (
            {"implement.kind": "drawn", "implement.mass_kg": 30.0},
            "implement.mass_kg: must be above the wheel mass, 40 kg",
        ),
        ({"implement.kind": "mounted", "implement.tool.cornering_stiffness_n_deg": 4e6}, "implement.tool.relaxation_m"),
        (
            {"implement.kind": "mounted", "implement.linkage": "float", "implement.depth_wheel_stiffness_n_m": 1e9},
            "implement.depth_wheel_stiffness_n_m: must be below",
        ),
    ],
)
def test_error_for_an_unstable_implement_names_the_key(overrides, told):
    with pytest.raises(ScenarioError, match=told):
        run(load_scenario("straight_line", overrides))


def test_implement_metrics_exist_only_with_an_implement():
    bare = run(load_scenario("straight_line", {"duration_s": 1.0}))
    assert not {name for name in bare.metrics if name.startswith(("implement", "hitch"))}
    assert "implement_x" not in bare.rows.columns
    log = run(load_scenario("straight_line", {"duration_s": 10.0, "implement.kind": "drawn"}))
    assert log.metrics["implement_xte_rms"] < 0.1
    assert log.metrics["hitch_pull_mean"] > 50.0
    x, y = (log.column(f"implement_{axis}") - log.column(f"rear_{axis}") for axis in "xy")
    assert np.hypot(x, y)[-1] == pytest.approx(B + Drawn().axle_behind_m, abs=0.01)


def test_rollover_of_the_trailer_ends_the_run():
    tall = {"implement.kind": "drawn", "implement.cg_height_m": 1.8, "implement.mass_kg": 300}
    log = run(load_scenario("side_slope", {"terrain.grade_deg": 22, **tall}))
    assert log.outcome == "rolled_over"


def test_drawbar_near_its_stop_ends_the_run_as_jackknifed():
    """A trailer pushed backwards from 1.5 deg folds, and the run ends 2 deg before the stop at 85 deg."""
    plant, _ = plant_with(Drawn())
    hinge = plant.model.joint("hitch_yaw").qposadr[0]
    plant.data.qpos[hinge] = radians(1.5)
    angles = [0.0]
    while plant.trouble() is None and len(angles) < 600:
        plant.advance(Drive(NEUTRAL_V, NEUTRAL_V - (0.6 if plant.truth().pedal > -0.25 else 0.0)))
        angles.append(abs(float(plant.data.qpos[hinge])))
    assert plant.trouble() == "jackknifed"
    assert angles[-2] <= radians(83.0) < angles[-1]
