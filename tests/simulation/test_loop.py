"""Simulation loop: determinism, ends of a run, observers, and columns of the log."""

import ast
from importlib import import_module
from inspect import getsource

import numpy as np
import pytest
from numba import config

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.control import Controller
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.held import Reference
from agrobot_mj.core.signals import NOMINAL, Command, Estimate
from agrobot_mj.core.spec import every
from agrobot_mj.paths import Path
from agrobot_mj.plants import MujocoPlant, Plant
from agrobot_mj.simulation import loop as loop_module
from agrobot_mj.simulation.columns import COLUMNS, WHEEL_SIGNALS
from agrobot_mj.simulation.loop import Loop, build_plant
from agrobot_mj.tyres import Tyre

PROMISED = """t x_ref y_ref x y yaw speed yaw_rate roll pitch x_hat y_hat yaw_hat speed_hat e_longitudinal e_lateral
speed_ref yaw_rate_ref e_yaw_rate tau_c tau_n q steer_ref steer valve_voltage pedal gnss_quality""".split()
"""Columns that every plant must provide."""


def kind(spec):
    return spec.model_fields["kind"].default


PLANTS, CONTROLLERS, PATHS = ([kind(spec) for spec in every(union)] for union in (Plant, Controller, Path))


def short(name="straight_line", seconds=3.0, **overrides):
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return load_scenario(name, {"duration_s": seconds, **keys})


class Witness:
    """Observer that records its calls."""

    def __init__(self):
        self.heard, self.seen = [], 0

    def start(self, scenario, scene, rows):
        self.rows = rows
        self.heard.append(("start", scenario.name, len(scene.bodies) > 4, rows.filled))

    def advance(self, first):
        assert first == self.seen  # no row twice, none left out
        assert np.isfinite(self.rows.column("x", first)).all()
        self.seen = self.rows.filled
        self.heard.append(("advance", first, self.rows.filled))

    def finish(self, log):
        self.heard.append(("finish", log.outcome, "lateral_rms" in log.metrics))


# --- determinism --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("plant", PLANTS)
def test_equal_seeds_give_equal_signal_tables(plant):
    scenario = short(plant__kind=plant)
    first, again, other = run(scenario), run(scenario), run(scenario.changed({"seed": 2}))
    assert first.signals.equals(again.signals)
    assert first.poses.tobytes() == again.poses.tobytes()
    assert not first.signals.equals(other.signals)
    for column in ("gnss_x", "steer_measured", "x"):
        assert not np.array_equal(first.column(column), other.column(column))


def test_a_run_changes_neither_its_scenario_nor_global_state(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenario = short()
    before = scenario.to_toml()
    run(scenario)
    assert scenario.to_toml() == before
    assert list(tmp_path.iterdir()) == []


def test_observers_do_not_change_the_signals_of_a_run():
    assert run(short(), (Witness(),)).signals.equals(run(short()).signals)


# --- ends of a run ------------------------------------------------------------------------------------------------


def test_log_has_one_row_per_tick_starting_at_zero():
    log = run(short(seconds=3.0))
    assert log.outcome == "completed"
    assert log.column("t") == pytest.approx(0.05 * np.arange(60))
    assert log.signals.num_rows == len(log.poses) == 60


@pytest.mark.parametrize("plant", PLANTS)
def test_run_ends_where_the_tractor_leaves_the_terrain(plant):
    log = run(short(seconds=60.0, plant__kind=plant, terrain__half_size_m=4.0))
    assert log.outcome == log.metrics["outcome"] == "left_terrain"
    assert log.column("x")[-2] <= 4.0 < log.column("x")[-1] < 4.2
    assert log.signals.num_rows < 200


def test_rollover_ends_the_run():
    log = run(short(seconds=10.0, terrain={"kind": "slope", "grade_deg": 44.0}, plant={"settle_s": 0.0}))
    assert log.outcome == "rolled_over"
    assert 0 < log.column("t")[-1] < 5


def test_run_far_from_its_reference_ends_as_diverged():
    circling = {"kind": "open_loop", "steer_deg": 30.0, "at_s": 0.0}
    log = run(short(seconds=90.0, controller=circling, plant__kind="bicycle"))
    off = np.hypot(log.column("e_longitudinal"), log.column("e_lateral"))
    assert log.outcome == "diverged"
    assert off[-1] > 35
    assert (off[:-1] < 50).all()


@pytest.mark.usefixtures("single_ticks")
def test_diverging_physics_ends_the_run_before_the_sensors_are_evaluated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenario = short(seconds=2.0)
    advance, calls = MujocoPlant.advance_held, iter(range(1000))

    def exploding(plant, drive, conditions=NOMINAL):
        if next(calls) == 20:
            plant.data.qvel[0] = np.nan
        return advance(plant, drive, conditions)

    monkeypatch.setattr(MujocoPlant, "advance_held", exploding)
    log = run(scenario)
    assert log.outcome == "diverged"
    assert log.column("t")[-1] == pytest.approx(1.0)
    assert np.isfinite(log.column("x")).all()
    assert log.metrics["physics_warnings"] > 0
    assert not list(tmp_path.iterdir()), "MuJoCo's log in the working directory"


@pytest.mark.usefixtures("single_ticks")
def test_stop_request_aborts_the_run_and_keeps_its_log_rows():
    asked = iter(range(1000))
    log = run(short(seconds=30.0), should_stop=lambda: next(asked) == 17)
    assert log.outcome == "aborted"
    assert log.signals.num_rows == 18
    assert log.metrics["outcome"] == "aborted"


def test_impossible_tractor_is_rejected_as_invalid_input():
    with pytest.raises(ScenarioError, match=r"straight_line: tractor\.mass_kg: must be above"):
        build_plant(short(tractor__rear_wheel_mass_kg=400.0))


# --- watchers -----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("single_ticks")
def test_observers_receive_every_log_row_once_in_groups_of_rows(monkeypatch):
    monkeypatch.setattr(import_module("agrobot_mj.simulation.run"), "REPORT_S", 1e9)  # none earlier on a busy machine
    monkeypatch.setattr(import_module("agrobot_mj.simulation.run"), "CHUNK_TICKS", 100)
    witness = Witness()
    ticks = 230
    run(short(seconds=ticks * 0.05, plant__kind="bicycle"), (witness,))
    assert witness.heard[0] == ("start", "straight_line", True, 0)
    assert [entry[1:] for entry in witness.heard[1:-1]] == [
        (0, 100),
        (100, 200),
        (200, ticks),
    ]
    assert witness.heard[-1] == ("finish", "completed", True)


def test_observers_receive_all_log_rows_of_a_run_that_ends_early():
    witness = Witness()
    log = run(short(seconds=60.0, terrain__half_size_m=4.0, plant__kind="bicycle"), (witness,))
    assert witness.seen == log.signals.num_rows
    assert witness.heard[-1] == ("finish", "left_terrain", True)


# --- the log ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("plant", PLANTS)
def test_signal_table_has_the_documented_columns(plant):
    table = run(short(seconds=0.5, plant__kind=plant)).signals
    assert set(PROMISED) <= set(table.column_names)
    assert set(COLUMNS) <= set(table.column_names)
    assert ({column.name for column in WHEEL_SIGNALS} <= set(table.column_names)) == (plant == "mujoco")
    assert {str(field.type) for field in table.schema} == {"double"}


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("plant", PLANTS)
def test_every_controller_works_with_every_plant(plant, controller):
    log = run(short("circle", 4.0, plant__kind=plant).changed({"controller.kind": controller}))
    assert log.outcome == "completed"
    assert np.hypot(log.column("e_lateral"), log.column("e_longitudinal"))[-1] < 0.5
    assert log.column("speed")[-1] > 0.8
    absent = {name for name in log.rows.columns if np.isnan(log.column(name)).any()}
    assert absent <= {"q", "steer_bias_hat", "gnss_x", "gnss_y", "steer_pressure", "drive_torque"}
    assert ("q" in absent) == (controller in ("open_loop", "pd", "pi", "pd_isgn"))


@pytest.mark.parametrize("tyre", [kind(tyre) for tyre in every(Tyre)])
def test_speed_settles_with_every_tyre_model(tyre):
    """After a step of the speed reference from rest, tyres and oil cause no limit cycle of the speed loop."""
    log = run(short("circle", 30.0, plant={"tyre": {"kind": tyre}}, path__ramp_s=0.0))
    speed = log.column("speed")[log.column("t") > 10]
    assert speed.mean() == pytest.approx(1.2, abs=0.05)
    assert speed.std() < 0.05


@pytest.mark.parametrize("path", PATHS)
def test_every_path_can_be_simulated(path):
    log = run(short(seconds=12.0, path={"kind": path}, plant__kind="bicycle"))
    assert log.outcome == "completed"
    assert np.hypot(log.column("e_lateral"), log.column("e_longitudinal"))[-1] < 1.0


def test_logged_errors_refer_to_the_true_cg_in_the_reference_frame():
    log = run(short("circle", 8.0))
    c = log.column
    for k in (20, 159):
        ahead, left = to_heading(c("yaw_ref")[k], c("x_ref")[k] - c("x")[k], c("y_ref")[k] - c("y")[k])
        assert (c("e_longitudinal")[k], c("e_lateral")[k]) == pytest.approx((ahead, left))
    reference = log.scenario.path.at(159 * 0.05)
    assert (c("x_ref")[159], c("y_ref")[159]) == pytest.approx((reference.x, reference.y))
    assert c("e_yaw_rate") == pytest.approx(c("yaw_rate_ref") - c("yaw_rate_hat"))


def test_steering_command_equals_controller_output_limited_by_the_stops():
    log = run(short("circle", 6.0))
    c, limit = log.column, log.scenario.tractor.steer_limit
    wanted = np.clip(c("tau_c") - c("tau_n"), -limit, limit)
    assert c("steer_ref") == pytest.approx(wanted)
    assert (np.abs(c("steer_ref")) <= limit).all()
    assert ((c("valve_voltage") >= 0) & (c("valve_voltage") <= 12)).all()
    assert ((c("q") >= 0) & (c("q") <= 1)).all()


def test_true_position_is_the_integral_of_the_speed():
    log = run(short("circle", 8.0))
    c = log.column
    travelled = np.hypot(np.diff(c("x")), np.diff(c("y")))
    speed = np.hypot(c("speed"), c("lateral_speed"))
    assert travelled == pytest.approx(0.025 * (speed[1:] + speed[:-1]), abs=2e-3)
    turned = np.angle(np.exp(1j * np.diff(c("yaw"))))
    assert turned == pytest.approx(0.025 * (c("yaw_rate")[1:] + c("yaw_rate")[:-1]), abs=2e-3)


def test_estimates_follow_the_true_state():
    log = run(short("circle", 20.0))
    c = log.column
    settled = c("t") > 5
    assert np.hypot(c("x") - c("x_hat"), c("y") - c("y_hat"))[settled].max() < 0.1
    assert np.abs(c("speed") - c("speed_hat"))[settled].max() < 0.3
    assert np.abs(np.angle(np.exp(1j * (c("yaw") - c("yaw_hat")))))[settled].max() < 0.1


@pytest.mark.parametrize("plant", PLANTS)
def test_steering_step_occurs_at_the_configured_time(plant):
    changes = {"plant.kind": plant, "controller.at_s": 4.0, "duration_s": 8.0}
    log = run(load_scenario("step_steer").changed(changes))
    t, steer_ref, steer = (log.column(name) for name in ("t", "steer_ref", "steer"))
    assert (steer_ref[t < 4.0 - 1e-9] == 0).all()
    assert steer_ref[t >= 4.0 - 1e-9] == pytest.approx(0.05, abs=1e-5)
    assert (np.abs(steer[t < 4.05]) < 1e-3).all()
    assert steer[-1] == pytest.approx(0.05, abs=0.015)
    assert log.column("yaw_rate")[-1] == pytest.approx(log.column("speed")[-1] * steer[-1] / 1.4, rel=0.1)


# --- the page that shows a tick -----------------------------------------------------------------------------------


def test_tick_code_is_short_and_contains_no_checks():
    whole, names = ast.walk(ast.parse(getsource(loop_module))), ("sense", "decide", "act")
    tick = [part for part in whole if isinstance(part, ast.FunctionDef) and part.name in names]
    statements = [part for method in tick for part in ast.walk(method) if isinstance(part, ast.stmt)]
    said = sum(ast.get_docstring(method) is not None for method in tick)
    assert len(tick) == 3
    assert len(statements) - len(tick) - said <= 30
    assert not [part for part in statements if isinstance(part, ast.Try | ast.Raise | ast.Assert)]
    assert "check" not in "".join(map(ast.unparse, tick))


def test_run_equals_a_sequence_of_calls_of_tick_and_advance():
    """A simulation without commands logs the values of `tick` and `advance`."""
    scenario = short("circle", 2.0, plant__kind="bicycle")
    loop, drives = Loop(scenario), []
    for _ in range(40):
        drives.append(loop.tick().drive)
        loop.advance(drives[-1])
    assert run(scenario).column("valve_voltage").tolist() == [drive.steer_voltage for drive in drives]


# --- what the tractor's computer knows ----------------------------------------------------------------------------


def decided(change_truth=None, change_estimate=None, change_measured=None):
    """Return voltages and pedal reference of a tick two seconds into a bend, with changed messages."""
    loop = Loop(short("circle", 4.0, plant__kind="bicycle"))
    for _ in range(40):
        loop.advance(loop.tick().drive)
    measured, situation = loop.sense()
    situation = situation.fetched()
    if change_truth:
        loop.seen = loop.truth._replace(**change_truth(loop.truth))
    if change_measured:
        measured = measured._replace(**change_measured(measured))
    if change_estimate:
        situation = situation._replace(estimate=situation.estimate._replace(**change_estimate(situation.estimate)))
    tick = loop.act(measured, situation, Command(0.1, 1.2))
    return tick.pedal_ref, tick.drive.steer_voltage, tick.drive.pedal_voltage


def test_control_loops_do_not_read_the_true_state():
    """The valves get the same voltages if the true state changes after the sensors were read."""
    other = decided(lambda t: {name: getattr(t, name) + 0.3 for name in ("speed", "steer", "pedal", "yaw_rate", "x")})
    assert other == decided()


def test_control_loops_respond_to_speed_estimate_and_measured_angles():
    pedal_ref, steer_voltage, pedal_voltage = decided()
    faster = decided(change_estimate=lambda e: {"speed": e.speed + 0.5})
    assert faster[0] < pedal_ref - 0.02  # believed too fast: less pedal
    assert faster[1] == steer_voltage
    turned = decided(change_measured=lambda m: {"steer": m.steer + 0.05})
    assert turned[1] < steer_voltage - 0.5  # read too far left: steer back
    assert turned[2] == pedal_voltage
    pressed = decided(change_measured=lambda m: {"pedal": m.pedal + 0.05})
    assert pressed[2] < pedal_voltage - 0.2
    assert pressed[:2] == (pedal_ref, steer_voltage)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_only_compiled_laws_receive_the_estimate_by_reference():
    for law in ("lqr", "kinematic"):
        sim = Simulation("figure_eight", {"guidance.kind": law, "plant.kind": "bicycle", "duration_s": 1.0})
        sim.step()
        assert type(sim.loop.now()[1].estimate) is Reference
        assert type(sim.situation.estimate) is type(sim.estimate) is Estimate
        assert sim.loop.fetches == (law == "kinematic")
