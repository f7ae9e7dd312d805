"""Simulation by single steps: equality with `run`, units of commands, and messages for invalid arguments."""

from math import atan, inf, nan, radians

import numpy as np
import pytest

from agrobot_mj import Simulation, load_scenario, register, run
from agrobot_mj.core.errors import CommandError, ScenarioError

SHORT = {"duration_s": 3.0, "plant.kind": "bicycle"}


def test_stepping_with_scenario_guidance_equals_a_run():
    scenario = load_scenario("figure_eight", {"duration_s": 6.0})
    sim = Simulation(scenario)
    sim.reset()
    while not sim.done:
        sim.step()
    assert sim.outcome == "completed"
    assert sim.log().signals.equals(run(scenario).signals)


def test_reset_starts_the_same_run_again():
    sim = Simulation("circle", SHORT)
    first = [sim.reset()] + [sim.step() for _ in range(20)]
    again = [sim.reset()] + [sim.step() for _ in range(20)]
    assert [m.steer for m in first] == [m.steer for m in again]
    assert [m.fix for m in first] == [m.fix for m in again]


def test_time_advances_one_tick_per_step_until_the_end():
    sim = Simulation("circle", SHORT)
    sim.reset()
    steps = 0
    while not sim.done:
        assert sim.truth.t == pytest.approx(0.05 * steps)
        sim.step()
        steps += 1
    assert steps == 60
    with pytest.raises(CommandError, match=r"ended \(completed\); call reset"):
        sim.step()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_constant_steering_angle_drives_the_tractor_on_the_expected_circle(plant, sign):
    sim = Simulation("circle", {"duration_s": 25.0, "plant.kind": plant, "supervisor.enabled": False})
    sim.reset()
    while not sim.done:
        sim.step(steer=sign * radians(10), speed=1.0)
    assert sim.truth.steer == pytest.approx(sign * radians(10), abs=radians(1))
    assert sim.truth.yaw_rate / sim.truth.speed == pytest.approx(sign * np.tan(radians(10)) / 1.4, rel=0.08)


def test_curvature_and_yaw_rate_commands_give_correct_steering_angles():
    sim = Simulation("circle", SHORT)
    sim.reset()
    sim.step(curvature=0.1, speed=1.0)
    assert sim.log().column("steer_ref")[0] == pytest.approx(atan(1.4 * 0.1))
    for _ in range(50):
        sim.step(yaw_rate=0.1, speed=1.0)
    wanted = atan(1.4 * 0.1 / sim.log().column("speed_hat")[50])
    assert sim.log().column("steer_ref")[50] == pytest.approx(wanted)


def test_valve_voltage_command_is_limited_to_the_valve_range():
    sim = Simulation("circle", SHORT)
    sim.reset()
    for volts in (7.5, 99.0):
        sim.step(steer_voltage=volts)
    assert sim.log().column("valve_voltage") == pytest.approx([7.5, 12.0])


def test_reference_speed_is_used_if_a_command_has_no_speed():
    sim = Simulation("circle", SHORT | {"path.ramp_s": 0.0})
    sim.reset()
    for _ in range(3):
        sim.step(steer=0.1)
    assert sim.log().column("speed_ref") == pytest.approx([1.2, 1.2, 1.2])


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("name", ["steer", "speed", "curvature", "yaw_rate", "steer_voltage"])
def test_error_names_the_non_finite_command(name, value):
    sim = Simulation("circle", SHORT)
    sim.reset()
    with pytest.raises(CommandError, match=name):
        sim.step(**{name: value})
    sim.step()  # and the run goes on


@pytest.mark.parametrize("command", [{"steer": "1"}, {"speed": [1.0]}, {"curvature": {}}])
def test_error_names_the_command_of_the_wrong_type(command):
    sim = Simulation("circle", SHORT)
    sim.reset()
    (name,) = command
    with pytest.raises(TypeError, match=f"^{name}: must be a number, got "):
        sim.step(**command)
    sim.step(steer=np.float32(0.1), speed=np.int64(1))


def test_error_names_the_argument_of_the_wrong_type():
    sim = Simulation("circle", SHORT)
    with pytest.raises(TypeError, match=r"^state: must be a return value of save\(\), got None"):
        sim.restore(None)
    for overrides in ([1], {3: 4}, "seed=3"):
        with pytest.raises(TypeError, match=r"^overrides: must be a mapping of dotted keys"):
            Simulation("circle", overrides)
        with pytest.raises(TypeError, match=r"^overrides: must be a mapping of dotted keys"):
            Simulation(sim.scenario, overrides)
    with pytest.raises(TypeError, match=r"^scenario: must be a name or a path, got 3"):
        Simulation(3)
    for odd in ("x", None, 1.5):
        with pytest.raises(TypeError, match=r"^number: must be a whole number, got "):
            sim.branch(odd)
    for odd in ("x", None):
        with pytest.raises(TypeError, match=r"^wall_s: must be a number, got "):
            sim.log(odd)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((5,), r"^scenario: must be a name or a path, got 5"),
        (("circle", 3), r"^watchers: must be a tuple of watchers \(start, advance, finish, fail\), got 3"),
        (("circle", ("x",)), r"^watchers: must be a tuple of watchers"),
        (("circle", (), 3), r"^should_stop: must be a function without arguments, got 3"),
    ],
)
def test_type_error_names_the_invalid_run_argument(arguments, message):
    with pytest.raises(TypeError, match=message):
        run(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((5,), "^member: must be a class, got 5"), ((Simulation, 3), "^name: must be a string, got 3")],
)
def test_type_error_names_the_invalid_register_argument(arguments, message):
    with pytest.raises(TypeError, match=message):
        register(*arguments)


def test_error_names_the_missing_log_column():
    log = Simulation("circle", SHORT).log()
    with pytest.raises(TypeError, match=r"^name: must be the name of a column, got 3"):
        log.column(3)
    with pytest.raises(ValueError, match=r"^name: there is no column 'sped'; did you mean 'speed'"):
        log.column("sped")


def test_numpy_values_are_accepted_as_overrides():
    given = {"seed": np.int64(7), "path.speed_m_s": np.float32(1.5), "sensors.gyro.enabled": np.True_}
    scenario = load_scenario("straight_line", {**given, "terrain": {"kind": "flat", "half_size_m": np.float64(90)}})
    assert (scenario.seed, scenario.path.speed_m_s, scenario.sensors.gyro.enabled) == (7, 1.5, True)
    assert scenario.changed({"seed": np.int64(8)}).seed == 8


def test_run_function_accepts_a_scenario_name_or_path(tmp_path):
    (tmp_path / "mine.toml").write_text('duration_s = 0.5\n[plant]\nkind = "bicycle"\n')
    assert run(tmp_path / "mine.toml").signals.equals(run(load_scenario(tmp_path / "mine.toml")).signals)
    with pytest.raises(ScenarioError, match="unknown scenario 'circel'"):
        run("circel")


def test_action_with_two_steering_commands_is_rejected():
    sim = Simulation("circle", SHORT)
    sim.reset()
    with pytest.raises(CommandError, match="steer and curvature: specify only one of them"):
        sim.step(steer=0.1, curvature=0.1)


def test_simulation_rejects_an_invalid_scenario_with_its_load_error():
    with pytest.raises(ScenarioError, match="unknown scenario 'circel'; did you mean 'circle'"):
        Simulation("circel")
    with pytest.raises(ScenarioError, match=r"terrain\.grade_deg"):
        Simulation("side_slope", {"terrain.grade_deg": 80})


def test_externally_commanded_run_may_leave_the_path_without_a_stop():
    sim = Simulation("straight_line", {"duration_s": 12.0, "plant.kind": "bicycle"})
    sim.reset()
    while not sim.done:
        sim.step(steer=0.4, speed=1.0)
    assert sim.outcome == "unfinished"
    assert abs(sim.log().column("e_lateral")[-1]) > 2.0
