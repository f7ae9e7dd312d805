"""Outcomes of runs, each in a separate run, and similar cases with other outcomes."""

from types import SimpleNamespace

import numpy as np
import pytest
from turns import by_turns

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.control.cascade import Cascade
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S, Command, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.driver import Driver
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.outcomes import LEFT_M, LOST_M, STUCK_PEDAL, STUCK_S, Watch
from agrobot_mj.terrain import Ground


def ends(seconds=40.0, source="straight_line", **overrides):
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return run(load_scenario(source, {"duration_s": seconds, **keys}))


def field(kind="flat", **patch):
    """Return a terrain with a patch of 20 m length that begins 10 m ahead."""
    return {"kind": kind, "patch": [{"kind": "rectangle", "x_m": 20.0, "length_m": 20.0, **patch}]}


# --- stuck --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "least_x", "most_x"),
    [
        ({"plant": {"tyre": {"kind": "soil", "cone_index_kpa": 60.0}}}, 0.0, 0.5),
        ({"plant__tyre__kind": "soil", "terrain": field(cone_index_kpa=70.0)}, 9.0, 14.0),
        ({"terrain": {**field("slope", friction=0.1), "grade_deg": 12.0, "direction_deg": 0.0}}, 8.0, 14.0),
        ({"fault": [{"kind": "drawbar", "pull_n": 8000.0, "start_s": 8.0}]}, 5.0, 9.0),
        ({"fault": [{"kind": "drawbar", "pull_n": 8000.0}]}, 0.0, 0.5),
    ],
    ids=["deep soil", "a soft hole", "uphill on ice", "an implement too many", "from the start"],
)
def test_tractor_with_spinning_wheels_and_no_progress_is_stuck(overrides, least_x, most_x):
    log = ends(**overrides)
    assert log.outcome == log.metrics["outcome"] == "stuck"
    assert least_x < log.column("x")[-1] < most_x
    last = log.column("t") > log.column("t")[-1] - STUCK_S
    assert np.ptp(log.column("x")[last]) < 0.7
    trying = last & (log.column("t") > 2.0)  # its reference leaves it from the first tick, before the pedal goes down
    assert log.column("pedal")[trying].min() > 0.9 * STUCK_PEDAL
    assert log.metrics["physics_warnings"] == 0


@pytest.mark.parametrize(
    "overrides",
    [
        {"path__speed_m_s": 0.1},
        {"path__speed_m_s": 0.05, "path__ramp_s": 20.0},
        {"path__ramp_s": 60.0},
        {"path__speed_m_s": 0.001, "controller": {"kind": "open_loop"}},
        {"fault": [{"kind": "drawbar", "pull_n": 2500.0}]},
        {"plant": {"tyre": {"kind": "soil", "cone_index_kpa": 120.0}}},
    ],
    ids=["0.1 m/s", "0.05 m/s", "slow start", "pedal released", "implement", "soft soil"],
)
def test_slow_or_waiting_tractors_are_not_stuck(overrides):
    assert ends(25.0, **overrides).outcome == "completed"


def watched(truths):
    """Return the outcome detected in each tick for true states of an intact plant."""
    plant = SimpleNamespace(trouble=lambda: None)
    watch = Watch(plant)
    return [watch.trouble(truth, 0.0) for truth in truths]


def still(pedal, x=0.0):
    return SimpleNamespace(x=x, y=0.0, pedal=pedal)


def test_tractor_is_stuck_after_ten_seconds_without_motion():
    seen = watched([still(0.3)] * 300)
    assert seen.index("stuck") == pytest.approx(STUCK_S / TICK_S, abs=1)


def test_stuck_tractor_is_also_detected_in_reverse():
    assert watched([still(-0.3)] * 300)[-1] == "stuck"


def test_stuck_timer_restarts_on_motion_or_pedal_release():
    held = [still(0.3)] * 190
    assert set(watched([*held, still(0.3, x=0.4), *[still(0.3, x=0.4)] * 190])) == {None}
    assert set(watched([*held, still(0.0), *held])) == {None}
    assert set(watched([still(0.04)] * 1000)) == {None}


@pytest.mark.parametrize(("gained", "outcome"), [(LEFT_M - 0.1, {None}), (LEFT_M + 0.1, {None, "stuck"})])
def test_tractor_without_pedal_is_stuck_once_its_reference_has_moved_away(gained, outcome):
    watch = Watch(SimpleNamespace(trouble=lambda: None))
    ticks = round(1.2 * STUCK_S / TICK_S)
    seen = [watch.trouble(still(0.0), 3.0 + gained * k / ticks) for k in range(ticks + 1)]
    assert set(seen) == outcome
    watch = Watch(SimpleNamespace(trouble=lambda: None))
    assert {watch.trouble(still(0.0), 3.0 + 0.06 * k, led=False) for k in range(300)} == {None}


def test_tractor_waiting_for_its_reference_is_not_stuck():
    watch = Watch(SimpleNamespace(trouble=lambda: None))
    assert {watch.trouble(still(0.0), abs(30.0 - 0.06 * k)) for k in range(900)} == {None}


def test_stuck_detection_ignores_distance_while_not_following_the_path():
    watch = Watch(SimpleNamespace(trouble=lambda: None))
    assert {watch.trouble(still(0.0), 0.06 * k, led=False) for k in range(300)} == {None}
    assert {watch.trouble(still(0.0), 18.0) for _ in range(300)} == {None}


# --- unfinished -----------------------------------------------------------------------------------------------------


def slowed(monkeypatch, factor):
    """Let the kinematic law command a fraction of its speed."""
    update = Cascade.update

    def changed(law, state, situation, dt):
        state, command = update(law, state, situation, dt)
        return state, command._replace(speed=factor * command.speed)

    monkeypatch.setattr(Cascade, "update", changed)


BRIEF = {"plant__kind": "bicycle"}
COURSES = (
    "figure_eight",
    "circle",
    "straight_line",
    "lane_change",
    "one_hectare",
    "headland_k_turn",
    "reverse_into_row",
)


STANDING = [pytest.param(speed, seconds) for seconds in (4.5, 8.0, 11.0, 40.0) for speed in (0.0, 1e-9)]


@pytest.mark.parametrize(("source", "speed", "seconds"), by_turns(COURSES, STANDING))
def test_run_of_a_stationary_tractor_is_stuck_or_unfinished(monkeypatch, source, speed, seconds):
    monkeypatch.setattr(Loop, "decide", lambda loop, measured, situation: Command(0.0, speed))
    log = ends(seconds, source, **BRIEF)
    assert log.outcome == log.metrics["outcome"] == ("stuck" if seconds > STUCK_S + 0.5 else "unfinished")
    assert log.metrics["progress"] == 0.0
    assert not log.as_expected


@pytest.mark.usefixtures("single_ticks")
@pytest.mark.parametrize(("factor", "outcome"), [(0.5, "unfinished"), (0.85, "unfinished"), (1.0, "completed")])
def test_run_of_a_tractor_that_is_too_slow_is_unfinished(monkeypatch, factor, outcome):
    slowed(monkeypatch, factor)
    log = ends(60.0, "straight_line", guidance__saturation_m_s=1e-6, **BRIEF)
    assert log.outcome == outcome
    assert log.metrics["progress"] == pytest.approx(factor, abs=0.04)
    said = log.metrics.get("stop_reason", "")
    assert said == "" if outcome == "completed" else said.startswith("drove ")


def test_run_of_a_tractor_that_leaves_the_path_is_unfinished():
    sim = Simulation("straight_line", {"plant.kind": "bicycle", "duration_s": 30.0})
    sim.reset()
    while not sim.done:
        sim.step(steer=0.3, speed=1.2)
    assert sim.outcome == sim.log().outcome == sim.log().metrics["outcome"] == "unfinished"
    assert sim.log().metrics["progress"] < 0.5


def test_tractor_kept_at_rest_by_external_commands_is_not_stuck():
    sim = Simulation("straight_line", {"plant.kind": "bicycle", "duration_s": 20.0})
    sim.reset()
    while not sim.done:
        sim.step(steer=0.3, speed=0.0)
    assert sim.outcome == "unfinished"


def test_run_ends_when_the_tractor_reaches_the_end_of_a_line_path():
    log = ends(60.0, path__length_m=23.0, path__speed_m_s=1.4)
    assert log.outcome == "completed"
    assert 23.0 <= log.column("x")[-1] < 23.0 + 2 * 1.4 * TICK_S
    assert log.column("t")[-1] < log.scenario.path.duration_s + 2.0


def test_tractor_behind_schedule_may_finish_its_path_before_the_end():
    slow = {"path__length_m": 20.0, "path__speed_m_s": 1.5, "driveline__power_limit_kw": 0.45, "guidance__kind": "lqr"}
    log = ends(60.0, **slow)
    assert log.outcome == "completed"
    assert log.column("x")[-1] >= 20.0
    assert log.column("t")[-1] > log.scenario.path.duration_s + 2.0


def test_run_on_a_circle_continues_until_the_end_of_its_duration():
    scenario = load_scenario("circle", {"path.turns": 1, "path.radius_m": 4.0, "plant": {"kind": "bicycle"}})
    seconds = round(scenario.path.duration_s) + 6.0
    assert run(scenario.changed({"duration_s": seconds})).signals.num_rows == round(seconds / TICK_S)


def test_run_with_external_commands_continues_beyond_the_end_of_the_line():
    overrides = {"path.length_m": 3.0, "duration_s": 8.0, "plant": {"kind": "bicycle"}}
    sim = Simulation("straight_line", overrides)
    sim.reset()
    while not sim.done:
        sim.step(steer=0.0, speed=1.2)
    assert sim.rows.filled == round(8.0 / TICK_S)


@pytest.mark.parametrize(("resistance", "outcome"), [(0.06, "completed"), (1.3, "unfinished")])
def test_run_without_path_completes_if_its_commands_are_followed(resistance, outcome):
    log = ends(9.0, "step_steer", plant__tyre__rolling_resistance=resistance)
    assert log.outcome == outcome
    assert ("stop_reason" in log.metrics) == (outcome == "unfinished")


def test_open_loop_run_completes_without_following_a_path():
    assert ends(30.0, controller={"kind": "open_loop", "steer_deg": 15.0, "at_s": 5.0}, **BRIEF).outcome == "completed"


def test_tractor_stopped_by_the_supervisor_is_not_stuck():
    log = run(load_scenario("gnss_gone", {"plant.kind": "bicycle", "supervisor.settle_s": 14.0}))
    assert log.outcome == "stopped"
    assert log.as_expected


def test_tractor_at_rest_for_long_at_a_cusp_is_not_stuck():
    log = ends(60.0, "reverse_into_row", path__cusp_pause_s=20.0)
    assert log.outcome == "completed"


def test_stop_reason_of_a_run_is_compared_with_the_expected_reason():
    scenario = load_scenario("gnss_gone")
    assert scenario.expects("stopped", "no GNSS fix for 8.1 s")
    assert not scenario.expects("stopped", "wheels 232 deg off the steering command")
    assert not scenario.expects("completed", "")
    log = run(scenario.changed({"plant.kind": "bicycle", "supervisor.max_cross_track_m": 0.012}))
    assert log.outcome == "stopped"
    assert "off the path" in log.metrics["stop_reason"]
    assert not log.as_expected
    assert scenario.changed({"expected_reason": "position known"}).hash8 == scenario.hash8
    with pytest.raises(ScenarioError, match="expected_reason: only stopped, unfinished, diverged have a reason"):
        load_scenario("circle", {"expected_reason": "no GNSS fix"})


def test_abort_after_the_end_of_a_run_has_no_effect():
    sim = Simulation("circle", {"plant.kind": "bicycle", "duration_s": 0.1})
    sim.reset()
    while not sim.done:
        sim.step()
    sim.abort()
    assert sim.outcome == "completed"


# --- the others ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settle_s", [0.0, 3.0])
def test_tractor_on_a_side_slope_of_37_degrees_rolls_over(settle_s):
    """If the tractor rolls over while settling, the log has one row."""
    log = ends(20.0, terrain={"kind": "slope", "grade_deg": 37.0, "direction_deg": 90.0}, plant={"settle_s": settle_s})
    assert log.outcome == "rolled_over"
    assert log.column("t")[-1] < 10
    assert (log.signals.num_rows == 1) == (settle_s > 0)
    assert abs(log.column("y")[-1]) < 3


@pytest.mark.parametrize(("height", "outcome"), [(0.0, None), (0.3, "rolled_over")])
def test_bump_below_upper_wheels_causes_rollover_on_a_safe_slope(height, outcome):
    nodes = 0.1 * np.arange(-150, 151)
    x, y = np.meshgrid(nodes, nodes)
    bump = height * np.exp(-(((x - 4.0) / 0.4) ** 2)) * (y > 0.1)
    ground = Ground(-15.0, -15.0, 0.1, np.tan(np.radians(24)) * y + bump)
    plant = MujocoPlant(Mujoco(), Machine(driveline=Driveline(differential_lock=True)), ground)
    driver = Driver(plant, plant.reset(Reference(0, 0, 0, 0, 0, 0)), 2.5)  # at 2 m/s it is held at the foot of the bump
    for _ in range(200):
        if plant.trouble() is not None or driver.truth.x > 7.0:
            break
        driver.go(TICK_S, lambda truth: 0.25 - 1.5 * truth.yaw)
    assert plant.trouble() == outcome
    assert driver.truth.x > 2.5
    assert plant.warnings() == 0


def test_run_too_far_from_the_reference_ends_as_diverged():
    plant, truth = SimpleNamespace(trouble=lambda: None), still(0.0)
    watch = Watch(plant)
    assert watch.trouble(truth, LOST_M - 1e-6) is None
    assert watch.trouble(truth, LOST_M) == "diverged"
    assert watch.trouble(truth, float("nan")) == "diverged"


def test_removing_a_payload_or_wind_does_not_end_the_run():
    faults = [
        {"kind": "payload", "mass_kg": 250.0, "left_m": 0.2, "end_s": 5.0},
        {"kind": "payload", "mass_kg": -30.0, "ahead_m": 1.3, "start_s": 3.0},
        {"kind": "side_force", "force_n": 800.0, "gust_share": 0.3, "start_s": 2.0, "end_s": 6.0},
        {"kind": "drawbar", "noise_share": 0.3, "start_s": 4.0},
        {"kind": "soft_tyre", "wheel": "fr", "start_s": 1.0},
        {"kind": "soft_tyre", "wheel": "rl", "start_s": 7.0},
    ]
    log = ends(10.0, fault=faults)
    assert log.outcome == "completed"
    assert log.metrics["physics_warnings"] == 0
    loads = sum(log.column(f"load_{wheel}") for wheel in ("fl", "fr", "rl", "rr"))
    for t, mass in ((2.9, 1000.0), (4.8, 970.0), (9.5, 720.0)):
        near = np.abs(log.column("t") - t) < 0.25
        assert loads[near].mean() == pytest.approx(mass * 9.81, rel=0.03)
