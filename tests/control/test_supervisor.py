"""Supervisor: unchanged commands without faults, and a controlled stop when a limit is exceeded."""

from math import cos, degrees, nan, sin

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.control.base import Situation
from agrobot_mj.control.evidence import TurnEvidence, course_error, sensor_numbers
from agrobot_mj.control.supervisor import Mode, Supervisor
from agrobot_mj.core.signals import Command, Estimate, Fix, Measurement, Quality, Reference
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths import Circle, Line
from agrobot_mj.paths.route import SampledRoute

TICK = 0.05
ROUTE = SampledRoute(Line())
FIX = Fix(0.0, 0.0, 1.2, 0.0)


def situation_with(y=0.0, steer=0.0, aligned=True, age=0.0, sigma=0.02, nis=2.0, speed=1.2, yaw=0.0):
    health = {"aligned": aligned, "fix_age": age, "position_sigma": sigma, "nis_mean": nis}
    rate = speed * np.tan(steer) / TractorParameters().wheelbase_m
    estimate = Estimate(1.0, y, yaw, speed, rate, 0.5, y, np.eye(3), **health)
    return Situation(1.0, estimate, Reference(1.0, 0.0, 1.2, 0.0, 0.0, 0.0), ROUTE, TractorParameters(), steer)


def drive(supervisor, situations, fix=FIX, pedal=0.24, command=None):
    """Return state and commands after situations, for a pedal that follows its reference immediately."""
    state, commands = supervisor.init(), []
    for situation in situations:
        measured = Measurement(situation.t, fix, Quality.FIX if fix else Quality.NONE, situation.steer, pedal, nan)
        state, out = supervisor.update(state, situation, measured, command or Command(0.0, 1.2), pedal, TICK)
        pedal = pedal if out.pedal is None else out.pedal
        commands.append(out)
    return state, commands


def test_commands_without_faults_pass_unchanged():
    state, commands = drive(Supervisor(), [situation_with(y=0.5)] * 100)
    assert state.mode is Mode.TRACKING
    assert set(commands) == {Command(0.0, 1.2)}


@pytest.mark.parametrize(
    ("bad", "fix", "word"),
    [
        ({"y": 2.5}, FIX, "off the path"),
        ({"sigma": 1.5}, FIX, "position standard deviation"),
        ({"nis": 1e4}, FIX, "contradict"),
        ({"steer": 0.5}, FIX, "steering command"),
        ({"age": 8.5}, None, "no GNSS fix"),
        ({"aligned": False}, FIX, "heading unknown"),
    ],
)
def test_exceeded_limit_stops_the_tractor_with_the_limit_as_reason(bad, fix, word):
    supervisor = Supervisor()
    turning = [situation_with(steer=bad.get("steer", 0.0) * k / 12) for k in range(12)]
    state, commands = drive(supervisor, turning + [situation_with(**bad)] * 800, fix)
    assert state.mode is Mode.STOPPING
    assert word in state.reason
    pedals = [c.pedal for c in commands if c.pedal is not None]
    assert (np.abs(np.diff(pedals)) <= supervisor.stopping_pedal_rate_per_s * TICK + 1e-12).all()
    assert pedals[-1] == 0.0
    assert supervisor.is_stopped(state)


def supervised(ticks, frozen=10**9, claimed=Quality.FIX, **readings):
    """Return the state after `ticks` of straight motion at 1.2 m/s. Measurements may be replaced by a number or a list.

    The position is the integral of the fix speed with noise of 1 cm. From tick `frozen` on, it is constant with the
    quality `claimed`.
    """
    values = {"fix": 1.2, "north": 0.0, "gyro": 0.0, "wheel": 1.2, "pedal": 0.24, "steer": 0.0, "speed": 1.2} | readings
    supervisor, noise = Supervisor(), np.random.default_rng(3)
    state, distance, x = supervisor.init(), 0.0, 0.0
    for k in range(ticks):
        now = {
            key: value[min(k, len(value) - 1)] if isinstance(value, list) else value for key, value in values.items()
        }
        distance += now["fix"] * TICK
        x = distance + 0.01 * noise.standard_normal() if k < frozen else x
        fix = Fix(x, now["north"], now["fix"], 0.0, TICK * k)
        given = (now["steer"], now["pedal"], now["gyro"])
        quality = claimed if k >= frozen else Quality.FIX
        measured = Measurement(TICK * k, fix, quality, *given, wheel_speed=now["wheel"])
        situation = situation_with(steer=now["steer"], speed=now["speed"])
        state, _ = supervisor.update(state, situation, measured, Command(0.0, 1.2), 0.24, TICK)
    return state


def test_measurement_noise_without_faults_causes_no_stop():
    noise = np.random.default_rng(3).normal(0.0, 1.0, 400)
    state = supervised(400, wheel=(1.24 + 0.02 * noise).tolist(), gyro=(0.002 * noise).tolist())
    assert state.mode is Mode.TRACKING


@pytest.mark.parametrize(
    ("readings", "within_s", "word"),
    [
        ({"frozen": 40, "fix": [1.2] * 40 + [0.0]}, 0.5, "repeat one position"),
        ({"frozen": 40, "fix": [1.2] * 41, "claimed": Quality.DGPS}, 0.5, "repeat one position"),
        ({"north": [0.0] * 40 + [0.6]}, 0.05, "off the track integrated from their velocity"),
        ({"north": [0.0] * 40 + [0.005 * k for k in range(200)]}, 9.0, "off the track integrated from their velocity"),
        ({"wheel": [1.2] * 40 + [0.0]}, 0.3, "wheel speed 1.2 m/s below"),
        ({"wheel": [1.2] * 40 + [-1.2]}, 0.3, "wheel speed 2.4 m/s below"),
        ({"wheel": [1.2 - 0.01 * k for k in range(120)]}, 6.0, "off dead reckoning"),
        ({"wheel": [1.2 - 0.01 * k for k in range(120)], "gyro": nan}, 6.0, "below"),
        ({"speed": [1.2 + 0.05 * k for k in range(40)]}, 1.5, "above the command"),
        ({"pedal": [0.24] * 40 + [0.0]}, 0.1, "pedal position 0.24 off"),
        ({"pedal": [0.24 + 0.02 * k for k in range(40)]}, 0.5, "pedal"),
        ({"steer": [0.0] * 40 + [0.1]}, 0.05, "gyro repeats one value"),
        ({"gyro": [0.01] * 40 + [0.0], "steer": [0.0] * 41 + [-0.1]}, 0.45, "in a turn of 4.9 deg/s"),
        ({"gyro": [0.0] * 40 + [0.5]}, 1.0, "turn rate implies a wheel angle 30 deg off"),
        ({"gyro": [0.0] * 40 + [0.09]}, 6.0, "course of the fixes 8 deg off the gyro heading"),
        ({"gyro": [0.0] * 40 + [-0.09]}, 6.0, "course of the fixes 8 deg off the gyro heading"),
    ],
)
def test_faulty_measurement_stops_the_tractor_within_the_permitted_time(readings, within_s, word):
    begin = max((len(value) for value in readings.values() if isinstance(value, list) and len(value) == 41), default=0)
    state = supervised(begin + round(within_s / TICK) + 1, **readings)
    assert state.mode is Mode.STOPPING
    assert word in state.reason


def test_missing_or_repeated_gyro_value_on_a_straight_causes_no_stop():
    """Cases: a noise-free gyro on a line, delayed gyro values, and wheels turned at standstill, which cause no yaw
    rate."""
    late = [0.001 * k for k in range(40)] + [0.04] * 7 + [0.001 * k for k in range(40, 80)]
    assert supervised(80, gyro=late, steer=[0.0] * 42 + [0.1]).mode is Mode.TRACKING
    assert supervised(400, gyro=0.0, steer=[0.0] * 40 + [0.01]).mode is Mode.TRACKING
    assert supervised(400, gyro=float("nan"), steer=[0.0] * 40 + [0.1]).mode is Mode.TRACKING
    assert supervised(60, gyro=0.0, steer=[0.0] * 40 + [0.1], fix=0.0, wheel=0.0, speed=0.0).mode is Mode.TRACKING


def course_gyro_angle(course, gyro, speed=1.0, quality=Quality.FIX, every=2, late=0, pedal=0.2):
    """Return the maximum angle [deg] between the rotations of a course [rad] and of a gyro [rad/s].

    There is a fix every `every` ticks, delayed by `late` ticks.
    """
    evidence, maximum = TurnEvidence(), 0.0
    speeds, gyros = np.broadcast_to(speed, course.shape), np.broadcast_to(gyro, course.shape)
    pedals = np.broadcast_to(pedal, course.shape)
    claimed, observed = np.broadcast_to(quality, course.shape), course[np.maximum(np.arange(len(course)) - late, 0)]
    for k, (angle, u, rate) in enumerate(zip(observed.tolist(), speeds.tolist(), gyros.tolist(), strict=True)):
        fix = Fix(0.0, 0.0, u * cos(angle), u * sin(angle), TICK * (k - late)) if k % every == 0 else None
        evidence = evidence.after(*sensor_numbers(Measurement(TICK * k, fix, claimed[k], 0.0, pedals[k], rate)), TICK)
        maximum = max(maximum, degrees(course_error(evidence)))
    return maximum


def test_course_gyro_difference_is_large_only_with_a_sensor_fault():
    t = TICK * np.arange(800)
    rate = 0.4 * np.sin(0.5 * t)
    bends = np.cumsum(rate) * TICK  # in both directions, over all headings
    sway, usual = 0.3 * np.sin(7.0 * t), np.radians(0.3)
    assert course_gyro_angle(bends + sway, rate + usual) < 5.0
    assert course_gyro_angle(bends + np.pi, rate) < 2.0, "in reverse"
    back = np.where(t < 20.0, 0.0, np.pi)
    there = {"speed": np.where(abs(t - 20.0) < 0.3, 0.1, 1.0), "pedal": np.where(t < 20.0, 0.2, -0.2)}
    assert course_gyro_angle(back, 0.0, **there) < 1.0, "after a reversal"
    assert course_gyro_angle(bends, 0.3 * rate) > 8.0
    assert course_gyro_angle(bends, rate + np.radians(3.0)) > 8.0
    assert course_gyro_angle(bends, np.nan) == 0.0
    assert course_gyro_angle(bends, 0.0, quality=Quality.FLOAT) == 0.0
    assert course_gyro_angle(bends, 0.0, every=120) == 0.0, "fixes are too far apart"


def test_course_check_tolerates_fast_antenna_oscillation():
    """On bumps, a slow receiver sometimes measures backward motion of the antenna, while the gyro is correct."""
    t, rng = TICK * np.arange(800), np.random.default_rng(4)
    bumps = np.where(t % 9.0 < 1.0, 1.4 * np.sin(12.0 * t), 0.0) + 0.1 * rng.standard_normal(t.shape)
    ahead = 1.2 - np.where(t % 9.0 < 1.0, 1.3 * np.abs(np.sin(7.0 * t)), 0.0)
    course, speed = np.arctan2(bumps, ahead), np.hypot(ahead, bumps)
    assert course_gyro_angle(course, 0.0, speed=speed, every=4) < 8.0
    assert course_gyro_angle(course, np.radians(3.0), speed=speed, every=4) > 8.0


def test_course_check_works_with_rare_imprecise_or_delayed_fixes():
    t = TICK * np.arange(800)
    rate = 0.4 * np.sin(0.5 * t)
    bends, wrong = np.cumsum(rate) * TICK, np.radians(4.0)
    crawling = np.where(t % 3.0 < 1.5, 0.1, 1.0)
    poor = np.where(t % 4.0 < 2.0, Quality.FLOAT, Quality.FIX)
    for limits in ({"every": 20}, {"speed": 0.3}, {"speed": crawling}, {"quality": poor}, {"late": 10}):
        assert course_gyro_angle(bends, rate + np.radians(0.3), **limits) < 5.0
        assert course_gyro_angle(bends, rate + wrong, **limits) > 8.0


@pytest.mark.parametrize(
    "readings",
    [
        {"fix": [1.2 - 0.06 * k for k in range(20)] + [0.0], "wheel": 5.0},
        {"fix": 0.0, "wheel": [0.02 * k for k in range(200)]},
        {"fix": 0.0, "wheel": 0.0, "speed": 0.0},
        {"fix": 0.0, "wheel": 0.0, "speed": 0.0, "frozen": 1},
    ],
    ids=["spinning wheels", "no traction from the start", "at rest", "at rest without noise"],
)
def test_blocked_tractor_is_not_reported_as_a_sensor_fault(readings):
    assert supervised(400, **readings).mode is Mode.TRACKING


def test_pedal_moving_to_its_reference_causes_no_stop():
    assert supervised(20, pedal=[0.1 + 0.05 * k for k in range(4)]).mode is Mode.TRACKING
    assert supervised(20, pedal=[0.24 - 0.01 * k for k in range(20)]).mode is Mode.STOPPING


def test_pedal_fault_cuts_valve_power_but_wheel_fault_does_not():
    assert supervised(46, pedal=[0.24] * 40 + [0.0]).released
    assert not supervised(48, wheel=[1.2] * 40 + [0.0]).released


def test_valve_power_is_cut_if_the_tractor_does_not_stop():
    state, commands = drive(Supervisor(), [situation_with()] * 5 + [situation_with(y=3.0)] * 40, pedal=0.24)
    assert not commands[10].released
    assert commands[-1].released, "the estimated speed is not zero two seconds after the stop began"


def test_cross_track_limit_applies_while_the_heading_is_realigned():
    state, _ = drive(Supervisor(), [situation_with()] * 5 + [situation_with(y=2.5, aligned=False)] * 2)
    assert "off the path" in state.reason
    state, _ = drive(Supervisor(), [situation_with(y=2.5, aligned=False)] * 2)
    assert not state.reason, "the cross-track error is unknown before the first heading"


@pytest.mark.parametrize("limit", [0.012, 0.07, 2.0])
def test_cross_track_limit_applies_once_the_path_has_been_reached(limit):
    """The tractor starts slightly outside the limit, follows the path beyond the acquisition time, and leaves it."""
    supervisor = Supervisor(max_cross_track_m=limit)
    distance = [1.2 * limit] + [0.0] * round(1.5 * supervisor.max_acquiring_s / TICK)
    assert not drive(supervisor, [situation_with(y=y) for y in distance])[0].reason
    state, _ = drive(supervisor, [situation_with(y=y) for y in [*distance, 1.1 * limit]])
    assert state.reason.endswith("m off the path")


def test_long_loss_of_heading_causes_a_stop():
    patience = round(Supervisor().max_realigning_s / TICK)
    state, _ = drive(Supervisor(), [situation_with()] * 5 + [situation_with(aligned=False)] * (patience + 2))
    assert "heading unknown" in state.reason


def test_full_steering_step_causes_no_stop_while_the_wheels_move():
    turning = [situation_with(steer=-0.78 + 0.02 * k) for k in range(79)]  # 23 deg/s towards +0.78 rad
    state, _ = drive(Supervisor(), [situation_with(steer=-0.78)] + turning, command=Command(0.78, 1.2))
    assert state.mode is Mode.TRACKING


def ramp(steer_of):
    """Return the state after two command ramps from lock to lock at 25 deg/s; `steer_of` gives the wheel angle."""
    supervisor, commands = Supervisor(), np.radians(45 - np.abs((25 * TICK * np.arange(288)) % 180 - 90))
    state, noise = supervisor.init(), np.random.default_rng(1).normal(0, np.radians(0.3), len(commands))
    for k, command in enumerate(commands):
        situation = situation_with(steer=steer_of(commands, k) + noise[k])
        measured = Measurement(situation.t, FIX, Quality.FIX, situation.steer, 0.24, nan)
        state, _ = supervisor.update(state, situation, measured, Command(command, 1.2), 0.24, TICK)
    return state


def test_stuck_steered_wheels_cause_a_stop_but_lagging_wheels_do_not():
    late = ramp(lambda commands, k: commands[max(k - 11, 0)])  # 0.55 s, 14 deg
    assert late.mode is Mode.TRACKING
    stuck = ramp(lambda commands, k: np.radians(45))
    assert stuck.mode is Mode.STOPPING
    assert "steering command" in stuck.reason


def test_stop_remains_active_after_the_fault_disappears():
    state, _ = drive(Supervisor(), [situation_with(), situation_with(y=3.0)] + [situation_with()] * 50)
    assert state.mode is Mode.STOPPING


def test_supervisor_coasts_after_a_loss_of_fixes():
    state, commands = drive(Supervisor(), [situation_with(age=0.05 * k) for k in range(20)], fix=None)
    assert state.mode is Mode.COASTING
    assert commands[0] == Command(0.0, 1.2)
    assert commands[-1] == Command(0.0, 1.2, pedal=0.24)


@pytest.mark.parametrize("path", [Line(), Circle(radius_m=8.5)], ids=["line", "circle"])
def test_tractor_with_unknown_heading_creeps_with_path_curvature(path):
    situation = situation_with(aligned=False)._replace(route=SampledRoute(path))
    state, commands = drive(Supervisor(), [situation] * 5, command=Command(0.4, 1.2))
    assert state.mode is Mode.ALIGNING
    assert commands[-1].speed == Supervisor().aligning_speed_m_s
    assert commands[-1].steer == pytest.approx(TractorParameters().steering_for(path.max_curvature), abs=1e-6)


def test_tractor_off_the_path_may_move_away_until_its_heading_is_known():
    """The heading, 45 deg off, becomes known within the limit. The limit applies from this time on."""
    away = [1.4 + 0.02 * k for k in range(60)]
    supervisor, back = Supervisor(), [2.6 + 0.03 * k for k in range(20)] + [3.2 - 0.05 * k for k in range(60)]
    before = [situation_with(y=y, aligned=False) for y in away]
    assert not drive(supervisor, before + [situation_with(y=y) for y in back])[0].reason
    state, _ = drive(supervisor, before + [situation_with(y=2.6 + 0.03 * k) for k in range(60)])
    assert state.reason.endswith("m off the path")


def test_disabled_supervisor_changes_no_command():
    supervisor = Supervisor(enabled=False)
    _, commands = drive(supervisor, [situation_with(y=9.0)] * 100)
    assert set(commands) == {Command(0.0, 1.2)}
    assert supervisor.columns == supervisor.report(supervisor.init()) == ()


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_run_without_fixes_stops_with_missing_fix_as_reason(plant):
    lost = {"kind": "gnss_loss", "start_s": 12.0, "end_s": 60.0}
    log = run(load_scenario("circle", {"plant.kind": plant, "fault": [lost], "duration_s": 60.0}))
    assert log.outcome == "stopped"
    assert "no GNSS fix" in log.metrics["stop_reason"]
    crawl = 2 * log.scenario.speed.tolerance * log.scenario.driveline.full_speed_m_s  # tolerated pedal error
    assert abs(log.column("speed")[-1]) < crawl
    age, state = log.column("fix_age"), log.column("supervisor_state")
    assert age[state == Mode.STOPPING].min() == pytest.approx(Supervisor().max_fix_age_s, abs=0.11)
    assert np.hypot(np.diff(log.column("x")), np.diff(log.column("y")))[age[1:] > 0].sum() < 1.3 * 8.0 + 3.0


def test_tractor_keeps_its_speed_without_fixes_in_a_bend():
    """The paper's filter interprets the rotation of the velocity as a loss of speed."""
    lost = {"kind": "gnss_loss", "start_s": 12.0, "end_s": 18.0}
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "fault": [lost], "duration_s": 19.0}))
    assert log.column("speed")[-20:] == pytest.approx(1.2, abs=0.1)


def test_short_loss_of_fixes_causes_coasting_but_no_stop():
    lost = {"kind": "gnss_loss", "start_s": 12.0, "end_s": 15.0}
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "fault": [lost], "duration_s": 25.0}))
    assert log.outcome == "completed"
    assert set(log.column("supervisor_state")) == {Mode.TRACKING, Mode.COASTING}
