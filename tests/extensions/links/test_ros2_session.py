"""Runs controlled over /cmd_vel with a test double of the node: waiting, lock-step, silence and requests."""

import time
from math import atan, inf, isfinite, nan

import numpy as np
import pytest

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.cmd_vel import CmdVel, VelocityRequest
from agrobot_mj.extensions.links.ros2 import session
from agrobot_mj.extensions.links.ros2.node import VelocityMessage, problem_of
from agrobot_mj.extensions.links.ros2.session import SENSORS, NoProgramError, RosOptions, run_over

KEYS = {"guidance.kind": "cmd_vel", "plant.kind": "bicycle", "duration_s": 2.0, **SENSORS}
LOCK_STEP = RosOptions("lock_step", wait_s=0.2)


class Program:
    """Program that answers /odometry with `law(content)`, or not at all for None; it replaces the node and an external
    program."""

    def __init__(self, law, types=()):
        self.law, self.heard, self.last, self.sent, self.pending = law, 0, None, [], None
        self.refused, self.types = 0, types

    def problem(self):
        return problem_of(self.types, False, self.refused)

    def publish(self, topic, content):
        self.sent.append((topic, content))
        if topic == "/odometry":
            self.pending = self.law(content)

    def spin(self, until, enough=lambda: False):
        if self.pending is not None:
            (speed, yaw_rate), self.pending = self.pending, None
            if not (isfinite(speed) and isfinite(yaw_rate)):
                self.refused += 1
                return
            self.last = VelocityMessage(speed, yaw_rate, time.perf_counter())
            self.heard += 1
        elif not enough():
            time.sleep(max(0.0, until - time.perf_counter()))

    def stamps(self):
        return [content["clock"]["nanosec"] for topic, content in self.sent if topic == "/clock"]


def straight(content):
    """Return the speed 1.5 m/s and a yaw rate that steers back to y = 0."""
    y = content["pose"]["pose"]["position"]["y"]
    return 1.5, -0.3 * y - 2.0 * content["pose"]["pose"]["orientation"]["z"]


def driven(law, options=LOCK_STEP, **keys):
    program = Program(law)
    return run_over(load_scenario("straight_line", {**KEYS, **keys}), program, options), program


def test_lock_step_run_with_one_request_per_tick_is_repeatable():
    (log, program), (again, _) = driven(straight, **{"duration_s": 8.0}), driven(straight, **{"duration_s": 8.0})
    assert log.outcome == "completed"
    assert log.signals.equals(again.signals)
    assert set(log.column("cmd_age")) == {0.0}
    assert log.metrics["ros2"]["requests"] == 160 + 1, "and one before the clock starts"
    assert len(program.stamps()) == 160 + 1
    assert log.metrics["xte_rms"] < 0.05
    assert log.column("speed")[-1] == pytest.approx(1.5, abs=0.1)


def test_requests_every_second_tick_are_sufficient_if_configured():
    ticks = iter(range(10_000))
    log, _ = driven(lambda content: (1.0, 0.0) if next(ticks) % 2 == 1 else None, LOCK_STEP._replace(every=2))
    assert log.outcome == "completed"
    assert set(log.column("cmd_age").round(2)) == {0.0, 0.05}


def test_lock_step_run_ends_if_the_program_stops_sending_requests():
    answers, told = iter(range(15)), []
    log, _ = driven(
        lambda _: (1.0, 0.0) if next(answers, None) is not None else None, LOCK_STEP._replace(notify=told.append)
    )
    assert log.outcome == "host_lost"
    assert len(log.column("t")) == 14
    assert "no message on /cmd_vel for 0.2 s; lock-step needs a message every 0.05 s" in told[-1]
    assert "set --every above 1" in told[-1]


def test_missing_command_program_is_reported():
    with pytest.raises(NoProgramError, match=r"no message on /cmd_vel within 0.2 s: no program publishes this topic"):
        driven(lambda _: None)


def test_error_names_publishers_of_the_wrong_message_type(monkeypatch):
    monkeypatch.setattr(session, "ASK_TURNS", 10)
    told, program = [], Program(lambda _: None, ["geometry_msgs/msg/TwistStamped"])
    options = LOCK_STEP._replace(wait_s=12 * TICK_S, notify=told.append)
    expected = (
        r"the publishers send geometry_msgs/TwistStamped, but the node expects geometry_msgs/Twist; add --stamped"
    )
    with pytest.raises(NoProgramError, match=expected):
        run_over(load_scenario("straight_line", KEYS), program, options)
    assert [text for text in told if "add --stamped" in text], "before the wait is over"


@pytest.mark.parametrize(
    ("types", "stamped", "refused", "expected"),
    [
        ([], False, 0, "no program publishes this topic"),
        (["geometry_msgs/msg/Twist"], False, 0, ""),
        (["geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"], False, 0, ""),
        (["geometry_msgs/msg/Twist"], True, 0, "omit --stamped"),
        (
            ["std_msgs/msg/String"],
            False,
            0,
            "send std_msgs/String, but the node expects geometry_msgs/Twist; change the",
        ),
        (["geometry_msgs/msg/Twist"], False, 5, "5 messages with a non-finite velocity"),
    ],
)
def test_error_for_missing_requests_states_the_reason(types, stamped, refused, expected):
    found = problem_of(types, stamped, refused)
    assert expected in found
    assert bool(found) == bool(expected)


@pytest.mark.parametrize("bad", [(nan, 0.0), (1.0, inf)])
def test_non_finite_commands_are_counted_and_reported_once(bad):
    told, ticks = [], iter(range(10_000))
    options = RosOptions("real_time", wait_s=1.0, notify=told.append)
    log, _ = driven(lambda _: bad if next(ticks) % 3 == 2 else (1.0, 0.0), options, **{"duration_s": 0.6})
    assert log.outcome == "completed"
    assert log.metrics["ros2"]["refused"] >= 3
    assert len([text for text in told if "non-finite velocities on /cmd_vel are ignored" in text]) == 1
    assert (log.column("cmd_speed") == 1.0).all()


@pytest.mark.parametrize(
    ("machine", "speed"), [("compact", 1.7), ("utility", 1.1), ("row_crop", 2.2), ("compact", -0.8)]
)
@pytest.mark.parametrize("stop", [inf, 0.0], ids=["silence", "zero"])
def test_tractor_stopped_by_the_program_stays_at_rest_until_the_end(machine, speed, stop):
    """After 5 s the program is silent or requests zero speed. A tractor of 9.4 t moves back by 8 cm, because braking
    has deflected the carcasses.
    """
    keys = {**KEYS, "plant.kind": "mujoco", "machine": machine, "duration_s": 12.0}
    sim = Simulation("straight_line", keys)
    sim.reset()
    while not sim.done:
        age = max(0.0, sim.truth.t - 5.0) if stop == inf else 0.0
        sim.drive(VelocityRequest(speed if stop == inf or sim.truth.t < 5.0 else stop, 0.0, age))
    log = sim.log()
    way = np.sign(speed) * log.column("rear_x")
    assert way.max() > 3.0
    assert (np.maximum.accumulate(way) - way).max() < (0.1 if machine == "row_crop" else 0.01)
    assert np.ptp(way[log.column("t") > 10.5]) < 1e-3


def test_clock_topic_continues_while_the_run_waits_for_requests():
    ticks = iter(range(10_000))
    log, program = driven(lambda _: (1.0, 0.0) if next(ticks) > 3 else None, LOCK_STEP._replace(wait_s=1.0))
    assert log.metrics["ros2"]["waited_s"] == pytest.approx(0.25)
    assert program.stamps()[:6] == [50_000_000 * k for k in range(6)]
    assert log.column("t")[0] == 0.0


def test_tractor_without_requests_stops_in_a_real_time_run():
    answers = iter(range(20))
    options = RosOptions("real_time", wait_s=1.0)
    began = time.perf_counter()
    log, _ = driven(lambda _: (1.0, 0.0) if next(answers, None) is not None else None, options, **{"duration_s": 2.0})
    assert time.perf_counter() - began > 1.9
    assert log.outcome == "completed"
    t, age, wanted = (log.column(name) for name in ("t", "cmd_age", "speed_ref"))
    assert (wanted[age < 0.5] == 1.0).all()
    assert (wanted[age >= 0.5] == 0.0).all()
    assert log.column("speed")[-1] < log.column("speed")[t < 1.2].max()


def test_long_gap_in_requests_ends_a_real_time_run():
    answers = iter(range(4))
    keys = {"guidance.give_up_s": 0.5, "duration_s": 5.0}
    options = RosOptions("real_time", wait_s=1.0)
    log, _ = driven(lambda _: (1.0, 0.0) if next(answers, None) is not None else None, options, **keys)
    assert log.outcome == "host_lost"
    assert log.column("t")[-1] < 1.0


def test_real_time_run_may_start_before_the_first_request():
    log, _ = driven(lambda _: None, RosOptions("real_time", start="now"), **{"duration_s": 0.3})
    assert log.outcome == "not_engaged"
    assert (log.column("speed_ref") == 0.0).all()


def test_scenario_with_guidance_other_than_external_is_rejected():
    with pytest.raises(ScenarioError, match='set it to "cmd_vel"'):
        driven(straight, **{"guidance.kind": "stanley"})


def test_run_command_rejects_guidance_that_needs_the_ros2_command(call):
    with pytest.raises(ScenarioError, match="use `agrobot-mj ros2`"):
        run(load_scenario("straight_line", KEYS))
    status, out, err = call("run", "circle", "--set", "guidance.kind=cmd_vel")
    assert (status, out, err.count("\n"), "use `agrobot-mj ros2`" in err) == (2, "", 1, True)


# --- the law ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def situation():
    sim = Simulation("straight_line", KEYS)
    sim.reset()
    return sim.situation


@pytest.mark.parametrize(("speed", "yaw_rate"), [(1.5, 0.2), (1.5, -0.2), (-1.0, 0.2), (0.06, 0.01)])
def test_steering_angle_follows_the_bicycle_model_for_a_yaw_rate(situation, speed, yaw_rate):
    _, command = CmdVel().update(VelocityRequest(speed, yaw_rate, 0.0), situation, 0.05)
    assert command.steer == pytest.approx(atan(situation.machine.wheelbase_m * yaw_rate / speed))
    assert command.speed == speed


def test_steering_angle_is_held_at_zero_speed_and_limited_at_the_stops(situation):
    law = CmdVel()
    assert law.update(VelocityRequest(0.0, 1.0, 0.0), situation, 0.05)[1].steer == situation.steer
    assert law.update(VelocityRequest(0.1, 9.0, 0.0), situation, 0.05)[1].steer == situation.machine.steer_limit


@pytest.mark.parametrize("age", [0.5, 3.0, inf])
def test_expired_request_is_replaced_by_a_speed_of_zero(situation, age):
    assert CmdVel().update(VelocityRequest(1.5, 0.1, age), situation, 0.05)[1].speed == 0.0
