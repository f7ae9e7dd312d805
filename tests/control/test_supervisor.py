"""The supervisor: passes commands while all is well, and ends a run in a controlled stop where it is not."""

from math import cos, degrees, nan, sin

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.control.base import Situation
from agrobot_mj.control.evidence import TurnEvidence
from agrobot_mj.control.supervisor import Mode, Supervisor
from agrobot_mj.core.signals import Command, Estimate, Fix, Measurement, Quality, Reference
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths import Circle, Line
from agrobot_mj.paths.route import SampledRoute

TICK = 0.05
ROUTE = SampledRoute(Line())
FIX = Fix(0.0, 0.0, 1.2, 0.0)


def seen(y=0.0, steer=0.0, aligned=True, age=0.0, sigma=0.02, nis=2.0, speed=1.2, yaw=0.0):
    health = {"aligned": aligned, "fix_age": age, "position_sigma": sigma, "nis_mean": nis}
    rate = speed * np.tan(steer) / TractorParameters().wheelbase_m
    estimate = Estimate(1.0, y, yaw, speed, rate, 0.5, y, np.eye(3), **health)
    return Situation(1.0, estimate, Reference(1.0, 0.0, 1.2, 0.0, 0.0, 0.0), ROUTE, TractorParameters(), steer)


def drive(supervisor, situations, fix=FIX, pedal=0.24, command=None):
    """State and commands after these situations, the pedal following its reference at once."""
    state, commands = supervisor.init(), []
    for situation in situations:
        measured = Measurement(situation.t, fix, Quality.FIX if fix else Quality.NONE, situation.steer, pedal, nan)
        state, out = supervisor.update(state, situation, measured, command or Command(0.0, 1.2), pedal, TICK)
        pedal = pedal if out.pedal is None else out.pedal
        commands.append(out)
    return state, commands


def test_healthy_commands_pass_unchanged():
    state, commands = drive(Supervisor(), [seen(y=0.5)] * 100)
    assert state.mode is Mode.TRACKING
    assert set(commands) == {Command(0.0, 1.2)}


@pytest.mark.parametrize(
    ("bad", "fix", "word"),
    [
        ({"y": 2.5}, FIX, "off the path"),
        ({"sigma": 1.5}, FIX, "position uncertain"),
        ({"nis": 1e4}, FIX, "contradict"),
        ({"steer": 0.5}, FIX, "steering command"),
        ({"age": 8.5}, None, "no GNSS fix"),
        ({"aligned": False}, FIX, "heading unknown"),
    ],
)
def test_each_limit_stops_with_its_reason_and_ends_after_settling(bad, fix, word):
    supervisor = Supervisor()
    turning = [seen(steer=bad.get("steer", 0.0) * k / 12) for k in range(12)]
    state, commands = drive(supervisor, turning + [seen(**bad)] * 800, fix)
    assert state.mode is Mode.STOPPING
    assert word in state.reason
    pedals = [c.pedal for c in commands if c.pedal is not None]
    assert (np.abs(np.diff(pedals)) <= supervisor.stopping_pedal_rate_per_s * TICK + 1e-12).all()
    assert pedals[-1] == 0.0
    assert supervisor.stopped(state)


def watched(ticks, frozen=10**9, claimed=Quality.FIX, **readings):
    """State after so many ticks straight on at 1.2 m/s in which one reading or more is as given, a number or a list.

    The position follows the speed of the fixes, with a centimetre of noise, up to the tick from which it is `frozen`
    and of the `claimed` quality.
    """
    sound = {"fix": 1.2, "north": 0.0, "gyro": 0.0, "wheel": 1.2, "pedal": 0.24, "steer": 0.0, "speed": 1.2} | readings
    supervisor, noise = Supervisor(), np.random.default_rng(3)
    state, way, x = supervisor.init(), 0.0, 0.0
    for k in range(ticks):
        now = {key: value[min(k, len(value) - 1)] if isinstance(value, list) else value for key, value in sound.items()}
        way += now["fix"] * TICK
        x = way + 0.01 * noise.standard_normal() if k < frozen else x
        fix = Fix(x, now["north"], now["fix"], 0.0, TICK * k)
        given = (now["steer"], now["pedal"], now["gyro"])
        quality = claimed if k >= frozen else Quality.FIX
        measured = Measurement(TICK * k, fix, quality, *given, wheel_speed=now["wheel"])
        situation = seen(steer=now["steer"], speed=now["speed"])
        state, _ = supervisor.update(state, situation, measured, Command(0.0, 1.2), 0.24, TICK)
    return state


def test_healthy_evidence_stops_nothing():
    noise = np.random.default_rng(3).normal(0.0, 1.0, 400)
    state = watched(400, wheel=(1.24 + 0.02 * noise).tolist(), gyro=(0.002 * noise).tolist())
    assert state.mode is Mode.TRACKING


@pytest.mark.parametrize(
    ("readings", "within_s", "word"),
    [
        ({"frozen": 40, "fix": [1.2] * 40 + [0.0]}, 0.5, "repeat one position"),
        ({"frozen": 40, "fix": [1.2] * 41, "claimed": Quality.DGPS}, 0.5, "repeat one position"),
        ({"north": [0.0] * 40 + [0.6]}, 0.05, "off the path of their velocity"),
        ({"north": [0.0] * 40 + [0.005 * k for k in range(200)]}, 9.0, "off the path of their velocity"),
        ({"wheel": [1.2] * 40 + [0.0]}, 0.3, "wheels 1.2 m/s slower"),
        ({"wheel": [1.2] * 40 + [-1.2]}, 0.3, "wheels 2.4 m/s slower"),
        ({"wheel": [1.2 - 0.01 * k for k in range(120)]}, 6.0, "off dead reckoning"),
        ({"wheel": [1.2 - 0.01 * k for k in range(120)], "gyro": nan}, 6.0, "slower"),
        ({"speed": [1.2 + 0.05 * k for k in range(40)]}, 1.5, "faster than commanded"),
        ({"pedal": [0.24] * 40 + [0.0]}, 0.1, "pedal 0.24 off"),
        ({"pedal": [0.24 + 0.02 * k for k in range(40)]}, 0.5, "pedal"),
        ({"steer": [0.0] * 40 + [0.1]}, 0.05, "gyro repeats one value"),
        ({"gyro": [0.01] * 40 + [0.0], "steer": [0.0] * 41 + [-0.1]}, 0.45, "in a turn of 4.9 deg/s"),
        ({"gyro": [0.0] * 40 + [0.5]}, 1.0, "tractor turns as with wheels 30 deg off"),
        ({"gyro": [0.0] * 40 + [0.09]}, 6.0, "course of the fixes 8 deg off the gyro"),
        ({"gyro": [0.0] * 40 + [-0.09]}, 6.0, "course of the fixes 8 deg off the gyro"),
    ],
)
def test_evidence_against_the_estimate_stops_in_time(readings, within_s, word):
    begin = max((len(value) for value in readings.values() if isinstance(value, list) and len(value) == 41), default=0)
    state = watched(begin + round(within_s / TICK) + 1, **readings)
    assert state.mode is Mode.STOPPING
    assert word in state.reason


def test_a_gyro_that_repeats_itself_straight_on_or_is_missing_is_no_fault():
    """Without noise it reads zero on a line; a packet may be late; and a wheel that is turned at rest turns nothing."""
    late = [0.001 * k for k in range(40)] + [0.04] * 7 + [0.001 * k for k in range(40, 80)]
    assert watched(80, gyro=late, steer=[0.0] * 42 + [0.1]).mode is Mode.TRACKING
    assert watched(400, gyro=0.0, steer=[0.0] * 40 + [0.01]).mode is Mode.TRACKING
    assert watched(400, gyro=float("nan"), steer=[0.0] * 40 + [0.1]).mode is Mode.TRACKING
    assert watched(60, gyro=0.0, steer=[0.0] * 40 + [0.1], fix=0.0, wheel=0.0, speed=0.0).mode is Mode.TRACKING


def turns_apart(course, gyro, speed=1.0, quality=Quality.FIX, every=2, late=0, pedal=0.2):
    """Largest difference [deg] of the turns of a course [rad] and a gyro [rad/s].

    There is a fix every so many ticks, which is `late` ticks old.
    """
    evidence, largest = TurnEvidence(), 0.0
    speeds, gyros = np.broadcast_to(speed, course.shape), np.broadcast_to(gyro, course.shape)
    pedals = np.broadcast_to(pedal, course.shape)
    claimed, seen = np.broadcast_to(quality, course.shape), course[np.maximum(np.arange(len(course)) - late, 0)]
    for k, (angle, u, rate) in enumerate(zip(seen.tolist(), speeds.tolist(), gyros.tolist(), strict=True)):
        fix = Fix(0.0, 0.0, u * cos(angle), u * sin(angle), TICK * (k - late)) if k % every == 0 else None
        evidence = evidence.after(Measurement(TICK * k, fix, claimed[k], 0.0, pedals[k], rate), TICK)
        largest = max(largest, degrees(evidence.apart))
    return largest


def test_course_and_gyro_turn_apart_only_where_one_of_them_is_wrong():
    t = TICK * np.arange(800)
    rate = 0.4 * np.sin(0.5 * t)
    bends = np.cumsum(rate) * TICK  # to either side, over the whole compass
    sway, usual = 0.3 * np.sin(7.0 * t), np.radians(0.3)
    assert turns_apart(bends + sway, rate + usual) < 5.0
    assert turns_apart(bends + np.pi, rate) < 2.0, "in reverse"
    back = np.where(t < 20.0, 0.0, np.pi)
    there = {"speed": np.where(abs(t - 20.0) < 0.3, 0.1, 1.0), "pedal": np.where(t < 20.0, 0.2, -0.2)}
    assert turns_apart(back, 0.0, **there) < 1.0, "there and back"
    assert turns_apart(bends, 0.3 * rate) > 8.0
    assert turns_apart(bends, rate + np.radians(3.0)) > 8.0
    assert turns_apart(bends, np.nan) == 0.0
    assert turns_apart(bends, 0.0, quality=Quality.FLOAT) == 0.0
    assert turns_apart(bends, 0.0, every=120) == 0.0, "nothing is known of the way between them"


def test_antenna_that_sways_faster_than_the_tractor_drives_has_a_course():
    """On bumps a slow receiver sees the antenna move backwards at times; the gyro is right all the while."""
    t, rng = TICK * np.arange(800), np.random.default_rng(4)
    bumps = np.where(t % 9.0 < 1.0, 1.4 * np.sin(12.0 * t), 0.0) + 0.1 * rng.standard_normal(t.shape)
    ahead = 1.2 - np.where(t % 9.0 < 1.0, 1.3 * np.abs(np.sin(7.0 * t)), 0.0)
    course, speed = np.arctan2(bumps, ahead), np.hypot(ahead, bumps)
    assert turns_apart(course, 0.0, speed=speed, every=4) < 8.0
    assert turns_apart(course, np.radians(3.0), speed=speed, every=4) > 8.0


def test_course_and_gyro_stay_comparable_where_fixes_are_slow_few_poor_or_late():
    t = TICK * np.arange(800)
    rate = 0.4 * np.sin(0.5 * t)
    bends, wrong = np.cumsum(rate) * TICK, np.radians(4.0)
    crawling = np.where(t % 3.0 < 1.5, 0.1, 1.0)
    poor = np.where(t % 4.0 < 2.0, Quality.FLOAT, Quality.FIX)
    for limits in ({"every": 20}, {"speed": 0.3}, {"speed": crawling}, {"quality": poor}, {"late": 10}):
        assert turns_apart(bends, rate + np.radians(0.3), **limits) < 5.0
        assert turns_apart(bends, rate + wrong, **limits) > 8.0


@pytest.mark.parametrize(
    "readings",
    [
        {"fix": [1.2 - 0.06 * k for k in range(20)] + [0.0], "wheel": 5.0},
        {"fix": 0.0, "wheel": [0.02 * k for k in range(200)]},
        {"fix": 0.0, "wheel": 0.0, "speed": 0.0},
        {"fix": 0.0, "wheel": 0.0, "speed": 0.0, "frozen": 1},
    ],
    ids=["wheels that spin", "too weak from the start", "at rest", "at rest without noise"],
)
def test_a_tractor_that_cannot_move_raises_no_sensor_fault(readings):
    assert watched(400, **readings).mode is Mode.TRACKING


def test_a_pedal_moving_to_its_reference_is_no_fault():
    assert watched(20, pedal=[0.1 + 0.05 * k for k in range(4)]).mode is Mode.TRACKING
    assert watched(20, pedal=[0.24 - 0.01 * k for k in range(20)]).mode is Mode.STOPPING


def test_only_a_doubtful_pedal_cuts_its_valves_power():
    assert watched(46, pedal=[0.24] * 40 + [0.0]).released
    assert not watched(48, wheel=[1.2] * 40 + [0.0]).released


def test_a_tractor_that_does_not_stop_loses_its_valves_power():
    state, commands = drive(Supervisor(), [seen()] * 5 + [seen(y=3.0)] * 40, pedal=0.24)
    assert not commands[10].released
    assert commands[-1].released, "the estimate still drives, two seconds after the stop began"


def test_cross_track_is_monitored_while_the_heading_is_searched_again():
    state, _ = drive(Supervisor(), [seen()] * 5 + [seen(y=2.5, aligned=False)] * 2)
    assert "off the path" in state.reason
    state, _ = drive(Supervisor(), [seen(y=2.5, aligned=False)] * 2)
    assert not state.reason, "before the first heading nothing is known of it"


@pytest.mark.parametrize("limit", [0.012, 0.07, 2.0])
def test_a_cross_track_limit_of_any_size_counts_once_the_tractor_has_been_within_it(limit):
    """It starts a little farther off, drives on the path for longer than it may take to acquire it, and leaves it."""
    supervisor = Supervisor(max_cross_track_m=limit)
    way = [1.2 * limit] + [0.0] * round(1.5 * supervisor.max_acquiring_s / TICK)
    assert not drive(supervisor, [seen(y=y) for y in way])[0].reason
    state, _ = drive(supervisor, [seen(y=y) for y in [*way, 1.1 * limit]])
    assert state.reason.endswith("m off the path")


def test_searches_the_heading_only_briefly_during_work():
    patience = round(Supervisor().max_realigning_s / TICK)
    state, _ = drive(Supervisor(), [seen()] * 5 + [seen(aligned=False)] * (patience + 2))
    assert "heading unknown" in state.reason


def test_a_lock_to_lock_step_is_no_fault_while_the_wheels_move():
    turning = [seen(steer=-0.78 + 0.02 * k) for k in range(79)]  # 23 deg/s towards +0.78 rad
    state, _ = drive(Supervisor(), [seen(steer=-0.78)] + turning, command=Command(0.78, 1.2))
    assert state.mode is Mode.TRACKING


def ramp(steer_of):
    """State after a command that goes from lock to lock at 25 deg/s, twice, while the wheels do as `steer_of` says."""
    supervisor, commands = Supervisor(), np.radians(45 - np.abs((25 * TICK * np.arange(288)) % 180 - 90))
    state, noise = supervisor.init(), np.random.default_rng(1).normal(0, np.radians(0.3), len(commands))
    for k, command in enumerate(commands):
        situation = seen(steer=steer_of(commands, k) + noise[k])
        measured = Measurement(situation.t, FIX, Quality.FIX, situation.steer, 0.24, nan)
        state, _ = supervisor.update(state, situation, measured, Command(command, 1.2), 0.24, TICK)
    return state


def test_wheels_lagging_a_ramp_are_no_fault_but_stationary_wheels_are():
    late = ramp(lambda commands, k: commands[max(k - 11, 0)])  # 0.55 s, 14 deg
    assert late.mode is Mode.TRACKING
    stuck = ramp(lambda commands, k: np.radians(45))
    assert stuck.mode is Mode.STOPPING
    assert "steering command" in stuck.reason


def test_a_stop_is_final_even_if_all_recovers():
    state, _ = drive(Supervisor(), [seen(), seen(y=3.0)] + [seen()] * 50)
    assert state.mode is Mode.STOPPING


def test_lost_fixes_lead_to_coasting_first():
    state, commands = drive(Supervisor(), [seen(age=0.05 * k) for k in range(20)], fix=None)
    assert state.mode is Mode.COASTING
    assert commands[0] == Command(0.0, 1.2)
    assert commands[-1] == Command(0.0, 1.2, pedal=0.24)


@pytest.mark.parametrize("path", [Line(), Circle(radius_m=8.5)], ids=["line", "circle"])
def test_drives_slowly_by_the_curvature_of_the_path_until_the_heading_is_known(path):
    situation = seen(aligned=False)._replace(route=SampledRoute(path))
    state, commands = drive(Supervisor(), [situation] * 5, command=Command(0.4, 1.2))
    assert state.mode is Mode.ALIGNING
    assert commands[-1].speed == Supervisor().aligning_speed_m_s
    assert commands[-1].steer == pytest.approx(TractorParameters().steering_for(path.max_curvature), abs=1e-6)


def test_a_tractor_that_starts_beside_the_path_and_turned_away_may_turn_back():
    """It is within the limit until its heading is known, 45 deg off; there it begins to count."""
    away = [1.4 + 0.02 * k for k in range(60)]
    supervisor, back = Supervisor(), [2.6 + 0.03 * k for k in range(20)] + [3.2 - 0.05 * k for k in range(60)]
    before = [seen(y=y, aligned=False) for y in away]
    assert not drive(supervisor, before + [seen(y=y) for y in back])[0].reason
    state, _ = drive(supervisor, before + [seen(y=2.6 + 0.03 * k) for k in range(60)])
    assert state.reason.endswith("m off the path")


def test_does_nothing_when_switched_off():
    supervisor = Supervisor(enabled=False)
    _, commands = drive(supervisor, [seen(y=9.0)] * 100)
    assert set(commands) == {Command(0.0, 1.2)}
    assert supervisor.columns == supervisor.report(supervisor.init()) == ()


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_stops_and_says_so_without_fixes(plant):
    lost = {"kind": "gnss_loss", "start_s": 12.0, "end_s": 60.0}
    log = run(load_scenario("circle", {"plant.kind": plant, "fault": [lost], "duration_s": 60.0}))
    assert log.outcome == "stopped"
    assert "no GNSS fix" in log.metrics["stop_reason"]
    crawl = 2 * log.scenario.speed.tolerance * log.scenario.driveline.full_speed_m_s  # pedal error left alone
    assert abs(log.column("speed")[-1]) < crawl
    age, state = log.column("fix_age"), log.column("supervisor_state")
    assert age[state == Mode.STOPPING].min() == pytest.approx(Supervisor().max_fix_age_s, abs=0.11)
    assert np.hypot(np.diff(log.column("x")), np.diff(log.column("y")))[age[1:] > 0].sum() < 1.3 * 8.0 + 3.0


def test_holds_speed_while_coasting_in_a_bend():
    """The paper's filter takes the turning of the velocity for a loss of speed."""
    lost = {"kind": "gnss_loss", "start_s": 12.0, "end_s": 18.0}
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "fault": [lost], "duration_s": 19.0}))
    assert log.column("speed")[-20:] == pytest.approx(1.2, abs=0.1)


def test_a_short_loss_is_coasted_through():
    lost = {"kind": "gnss_loss", "start_s": 12.0, "end_s": 15.0}
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "fault": [lost], "duration_s": 25.0}))
    assert log.outcome == "completed"
    assert set(log.column("supervisor_state")) == {Mode.TRACKING, Mode.COASTING}
