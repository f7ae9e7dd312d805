"""Drive without a viewer: inputs, adjustments, faults, saved states, and the run that reproduces the drive."""

from math import inf, nan, radians

import pytest

from agrobot_mj.core.errors import CommandError, ScenarioError
from agrobot_mj.extensions.play.adjustments import ADJUSTMENTS, NextStart, fault_kinds, restart_scenario
from agrobot_mj.extensions.play.driver import Keys, PlayDriver
from agrobot_mj.extensions.play.gamepad import Gamepad
from agrobot_mj.extensions.play.panel import Press
from agrobot_mj.extensions.play.play import Play, save
from agrobot_mj.extensions.play.session import PlaySession
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run


@pytest.fixture
def session():
    return PlaySession(load_scenario("straight_line"))


def drive(session, ticks, steer=0.0, speed=1.5):
    for _ in range(ticks):
        session.steer(steer, speed)
        session.tick()


def repeated(session, folder):
    """Return whether a run of the saved scenario is bit-identical to the session."""
    log = save(session, folder, recorded=False)
    again = run(load_scenario(folder / "scenario.toml"))
    assert again.outcome == log.outcome
    assert again.as_expected
    assert again.metrics["identity"] == log.metrics["identity"]
    return log.signals.equals(again.signals)


def test_replay_of_a_manual_session_is_bit_identical(session, tmp_path):
    drive(session, 40, 0.1)
    session.adjust("friction", 0.5)
    session.adjust("tyres", 0.4)
    drive(session, 20, -0.3, 2.5)
    session.inject("gnss_float", 0.5)
    session.hand_over(session.law_names.index("stanley") + 1)
    for _ in range(30):
        session.tick()
    session.adjust("friction", 1.0)
    session.hand_over(1, 0.7)
    for _ in range(10):
        session.tick()
    assert repeated(session, tmp_path / "drive")
    assert session.ticks == 100


def test_replay_with_a_single_law_is_bit_identical(session, tmp_path):
    session.hand_over(1)
    for _ in range(60):
        session.tick()
    assert repeated(session, tmp_path / "drive")


def test_manual_drive_far_from_the_reference_does_not_end_the_run():
    session = PlaySession(load_scenario("straight_line", {"path.speed_m_s": 3.0, "path.length_m": 200.0}))
    drive(session, 420, speed=0.0)
    reference = session.sim.reference
    assert reference.x - session.sim.truth.x > 55.0
    drive(session, 40)
    assert not session.sim.done
    assert session.sim.truth.x > 1.0


def test_tractor_at_zero_manual_speed_does_not_move_on_a_slope():
    session = PlaySession(load_scenario("side_slope_10"))
    drive(session, 60, speed=0.0)
    assert abs(session.sim.truth.x) < 0.02
    assert not session.driven


def test_fast_turn_on_a_slope_of_25_degrees_rolls_the_tractor_over(tmp_path):
    session = PlaySession(restart_scenario(load_scenario("side_slope_10"), NextStart(25.0)))
    drive(session, 20, speed=0.0)
    assert not session.sim.done
    drive(session, 120, radians(-40), 4.0)
    assert session.sim.outcome == "rolled_over"
    assert "rolled_over" in session.message
    ticks = session.ticks
    assert 30 < ticks < 120
    session.tick()
    assert session.ticks == ticks
    assert repeated(session, tmp_path / "drive")


def test_tractor_at_rest_on_a_slope_of_35_degrees_rolls_over():
    session = PlaySession(restart_scenario(load_scenario("side_slope_10"), NextStart(35.0)))
    drive(session, 2, speed=0.0)
    assert session.sim.outcome == "rolled_over"
    assert session.ticks == 1


def test_roll_angle_on_a_slope_decreases_with_increasing_tyre_pressure():
    scenario = load_scenario("side_slope_10", {"machine": "utility"})
    rolls = []
    for bar in (0.8, 1.6):
        session = PlaySession(restart_scenario(scenario, NextStart(15.0, pressure_bar=bar)))
        assert session.base.tractor.tyre_pressure("rear", 1.0) == bar
        rolls.append(abs(session.sim.truth.roll))
    assert radians(0.1) < rolls[0] - rolls[1] < radians(3.0)


def test_guidance_law_returns_the_tractor_to_its_path_after_manual_driving(session):
    drive(session, 120, 0.06)
    assert abs(session.cross_track()) > 0.3
    session.hand_over(session.law_names.index("stanley") + 1)
    for _ in range(300):
        session.tick()
    assert abs(session.cross_track()) < 0.1


def test_lower_friction_increases_the_lateral_slide_on_a_slope():
    sideways = []
    for friction in (1.0, 0.1):
        session = PlaySession(load_scenario("side_slope_15"))
        session.adjust("friction", friction)
        drive(session, 80, 0.0, 1.0)
        sideways.append(abs(session.cross_track()))
    assert sideways[1] > 2 * sideways[0] + 0.2


@pytest.mark.parametrize("name", ADJUSTMENTS)
def test_slider_adds_a_fault_until_the_slider_returns_to_neutral(session, name):
    each = ADJUSTMENTS[name]
    drive(session, 2)
    session.adjust(name, each.high if each.high != each.neutral else each.low)
    first = session.sim.scenario.fault
    assert {fault.kind for fault in first} == {each.kind}
    assert all(fault.start_s == pytest.approx(0.15) for fault in first)
    drive(session, 2)
    session.adjust(name, each.neutral)
    assert all(fault.end_s == pytest.approx(0.25) for fault in session.sim.scenario.fault)
    assert session.values[name] == each.neutral


def test_slider_moved_twice_in_one_tick_gives_one_fault(session):
    session.adjust("friction", 0.5)
    session.adjust("latency", 0.2)
    session.adjust("friction", 0.4)
    assert [fault.kind for fault in session.sim.scenario.fault] == ["gnss_latency", "friction"]
    drive(session, 1)
    session.adjust("latency", 0.0)
    session.adjust("friction", 0.3)
    assert [fault.scale for fault in session.sim.scenario.fault if fault.kind == "friction"] == [0.4, 0.3]


def test_latency_set_by_a_slider_is_rounded_to_whole_ticks(session):
    session.adjust("latency", 0.33)
    assert session.message == ""
    assert session.sim.scenario.fault[0].latency_s == pytest.approx(0.35)


def test_overlapping_fault_is_rejected_with_the_reason(session):
    session.inject("gnss_loss", 5.0)
    drive(session, 3)
    session.inject("gnss_loss", 5.0)
    assert "overlaps" in session.message
    assert len(session.sim.scenario.fault) == 1


def test_each_fault_kind_is_injected_or_rejected_with_a_message(session):
    drive(session, 1)
    injected = 0
    for kind in fault_kinds():
        session.message = ""
        before = len(session.sim.scenario.fault)
        session.inject(kind, 1.0)
        injected += len(session.sim.scenario.fault) == before + 1
        assert session.message
    assert injected > 10


def test_restoring_a_state_discards_all_later_inputs(session, tmp_path):
    drive(session, 30, 0.1)
    session.adjust("dead_band", 0.5)
    session.mark()
    x = session.sim.truth.x
    drive(session, 30, -0.3)
    session.adjust("dead_band", 0.0)
    session.recall()
    assert session.sim.truth.x == x
    assert session.values["dead_band"] == 0.5
    assert session.given.steer == 0.1
    drive(session, 10, 0.2)
    assert session.ticks == 40
    assert repeated(session, tmp_path / "drive")


def test_run_continues_after_restoring_a_state_before_its_end():
    session = PlaySession(load_scenario("off_the_field"))
    session.mark()
    session.sim.abort()
    session.recall()
    drive(session, 1)
    assert session.ticks == 1


def test_restoring_without_a_saved_state_gives_a_message(session):
    session.recall()
    assert session.message == "no state has been kept"


def test_error_in_a_guidance_law_switches_to_manual_steering(session, monkeypatch):
    drive(session, 5)
    law = session.sim.loop.guidance.members[1]

    def broken(*_):
        raise ScenarioError("needs something")

    monkeypatch.setattr(type(law), "update", broken)
    session.hand_over(2)
    session.tick()
    assert session.given.law == 0
    assert session.message == f"{session.law_names[1]}: needs something"
    ticks = session.ticks
    drive(session, 1)
    assert session.ticks == ticks + 1


def test_law_number_outside_the_list_of_laws_is_rejected(session):
    with pytest.raises(CommandError, match="law: must be from 1"):
        session.hand_over(99)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"plant.kind": "bicycle"}, "has no 3D model to show"),
        ({"guidance.kind": "cmd_vel"}, "needs `agrobot-mj ros2`"),
    ],
)
def test_scenario_unsuitable_for_manual_driving_is_rejected(keys, message):
    with pytest.raises(ScenarioError, match=message):
        PlaySession(load_scenario("straight_line", keys))


def test_steering_key_turns_the_wheels_until_its_release(session):
    driver = PlayDriver(session)
    for _ in range(20):
        driver.tick(Keys(left=True, faster=True))
    assert driver.angle == pytest.approx(radians(30))
    assert driver.speed == pytest.approx(1.0)
    for _ in range(30):
        driver.tick(Keys())
    assert driver.angle == 0.0
    assert driver.speed == pytest.approx(1.0)


def test_key_press_switches_from_the_guidance_law_to_manual_steering(session):
    driver = PlayDriver(session)
    driver.hand_over(1)
    driver.tick(Keys())
    assert session.given.law == 1
    driver.tick(Keys(right=True))
    assert session.given.law == 0


def test_stick_sets_the_steering_angle_and_triggers_change_the_speed(session):
    driver, limit = PlayDriver(session), session.base.tractor.steer_limit
    driver.hand_over(1)
    for _ in range(20):
        driver.tick(Keys(stick=-0.5, pedal=0.5))
    assert (driver.law, driver.angle, driver.speed) == (0, pytest.approx(-0.5 * limit), pytest.approx(0.5))
    for _ in range(40):
        driver.tick(Keys(faster=True, pedal=1.0))
    assert (driver.angle, driver.speed) == (0.0, pytest.approx(2.5))


def test_invalid_or_old_gamepad_state_is_ignored():
    pad = Gamepad()
    pad.receive('{"steer": 0.05, "drive": 7, "pressed": ["stop", "unknown"]}')
    seen = pad.seen
    for text in ("", "[]", "{}", b"\xff", '{"steer": NaN, "drive": 0, "pressed": []}', "[" * 5000, '{"steer": 1}'):
        pad.receive(text)
    assert (pad.steer, pad.drive, pad.new_presses(), pad.new_presses()) == (0.0, 1.0, ["stop"], [])
    assert pad.added_to(Keys(left=True, seen=seen)) == Keys(left=True, seen=seen, pedal=1.0)
    assert pad.added_to(Keys(seen=seen + 0.5)) == Keys(seen=seen + 0.5)


def test_steering_keys_are_released_when_the_browser_connection_is_lost():
    keys = Keys(left=True, seen=100.0)
    assert keys.at(100.2).left
    assert not keys.at(101.0).left


def test_steering_slider_angle_is_held_until_a_steering_key_is_pressed(session):
    driver = PlayDriver(session)
    driver.set_angle(0.2)
    driver.tick(Keys())
    assert session.given.steer == 0.2
    driver.tick(Keys(right=True))
    assert session.given.steer < 0.2


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_slider_values_that_are_not_finite_are_ignored(value):
    game = Play(load_scenario("straight_line"), lambda session: None)
    before = game.status()
    for name in ("steer", "speed", *ADJUSTMENTS):
        game.execute(Press(name, value))
    assert (game.status().wanted, game.status().angle) == (before.wanted, before.angle)
    assert game.status().values == before.values
    assert game.session.sim.scenario.fault == ()
