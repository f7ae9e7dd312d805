"""Steering board: engagement, watchdog, latch, settings, replies, and hostile datagrams."""

from math import degrees, radians
from random import Random

import pytest

from agrobot_mj.core.agopengps.messages import (
    Hello,
    HelloReply,
    Scan,
    ScanReply,
    SteerConfig,
    SteerData,
    SteerSettings,
    SteerState,
)
from agrobot_mj.core.agopengps.wire import decode, encode, frame
from agrobot_mj.core.signals import NEUTRAL_V
from agrobot_mj.extensions.links.agopengps.board import Board
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps, BoardSettings

LIMIT = radians(45)
TICK = 0.05


class Rig:
    """Steering board with a simulated clock and manually supplied messages."""

    def __init__(self, **keys):
        self.board = Board(AgOpenGps(**keys), LIMIT)
        self.state, self.t, self.steer = self.board.init(), 0.0, 0.0

    def send(self, message, quiet=False):
        """Send a message to the board and return its decoded replies."""
        data = message if isinstance(message, bytes) else encode(message)
        self.state, answers = self.board.receive(self.state, data, self.t, self.t, quiet)
        return [decode(answer) for answer in answers]

    def tick(self, message=None, ticks=1):
        """Advance the board by some ticks with the same message in each tick, and return the last actuation."""
        for _ in range(ticks):
            if message is not None:
                self.send(message)
            self.state, actuation = self.board.tick(self.state, self.t, self.steer)
            self.t += TICK
        return actuation


def off(angle=radians(10)):
    return SteerData(1.5, 0, angle)


def on(angle=radians(10)):
    return SteerData(1.5, 1, angle)


def engaged(**keys):
    rig = Rig(**keys)
    rig.tick(off())
    assert rig.tick(on()).engaged
    return rig


def test_setpoint_is_applied_only_while_the_host_is_engaged():
    rig = Rig()
    actuation = rig.tick(off(radians(30)))
    assert not actuation.engaged
    assert (actuation.steer, actuation.voltage) == (0.0, NEUTRAL_V)
    actuation = rig.tick(on(radians(12.34)))
    assert actuation.engaged
    assert actuation.voltage is None
    assert degrees(actuation.steer) == pytest.approx(12.34, abs=0.006)
    assert not rig.tick(off(radians(30))).engaged


def test_board_ignores_a_host_engaged_at_power_up_until_it_disengages():
    rig = Rig()
    assert not rig.tick(on(), 40).engaged
    rig.tick(off())
    assert rig.tick(on()).engaged


def test_watchdog_releases_the_steering_in_time_and_latches_the_board():
    rig = engaged()
    last = rig.t - TICK
    for _ in range(100):
        if not rig.tick().engaged:
            break
    assert 2.4 <= rig.t - TICK - last <= 2.5 + TICK + 1e-9
    assert rig.tick().voltage == NEUTRAL_V
    actuation = rig.tick(on(radians(30)), 100)
    assert not actuation.engaged
    assert actuation.voltage == NEUTRAL_V
    rig.tick(off())
    assert rig.tick(on()).engaged
    assert rig.state.tally.lost == 1


@pytest.mark.parametrize(("latch", "silence", "steers"), [(6.25, 5.0, True), (6.25, 7.0, False), ("never", 50.0, True)])
def test_board_latches_after_the_configured_time_without_messages(latch, silence, steers):
    rig = engaged(latch_s=latch)
    assert not rig.tick(ticks=round(silence / TICK)).engaged
    assert rig.tick(on()).engaged is steers
    assert rig.board.refuses(rig.state) is not steers
    rig.tick(off())
    assert not rig.board.refuses(rig.state)
    assert rig.tick(on()).engaged


def test_board_does_not_latch_before_the_watchdog_time():
    rig = engaged(latch_s=0.5, watchdog_s=3.0)
    assert rig.tick(ticks=40).engaged
    assert rig.tick(on()).engaged
    rig.tick(ticks=70)
    assert not rig.tick(on()).engaged


def test_board_without_latch_also_ignores_a_host_engaged_at_power_up():
    assert not Rig(latch_s="never").tick(on(), 40).engaged


def test_board_disengages_at_the_first_tick_after_a_long_message_outage():
    rig = engaged()
    rig.t += 10.0
    assert not rig.tick(on(radians(30))).engaged


def test_hello_messages_do_not_reset_the_watchdog():
    rig = engaged()
    assert not rig.tick(Hello(), 52).engaged


def test_shorter_watchdog_and_self_centring_can_be_configured():
    rig = engaged(watchdog_s=0.5, released="centre")
    actuation = rig.tick(ticks=12)
    assert (actuation.engaged, actuation.steer, actuation.voltage) == (False, 0.0, None)


@pytest.mark.parametrize(
    ("host", "status", "expected"),
    [
        ("agopengps", 1, True),
        ("agopengps", 4, False),
        ("agopenweb", 1, False),
        ("agopenweb", 4, True),
        ("agopenweb", 29, True),
    ],
)
def test_position_of_the_engaged_bit_depends_on_the_host_program(host, status, expected):
    rig = Rig(host=host)
    rig.tick(SteerData(1.5, 0, 0.1))
    assert rig.tick(SteerData(1.5, status, 0.1)).engaged is expected


def test_last_of_two_steering_messages_in_a_tick_is_applied():
    rig = engaged()
    rig.send(on(radians(5)))
    rig.send(on(radians(6)))
    assert degrees(rig.tick().steer) == pytest.approx(6.0, abs=0.006)


def test_datagram_received_on_two_routes_is_answered_once():
    rig = engaged()
    assert len(rig.send(on())) == 1
    assert rig.send(on()) == []
    assert rig.state.tally.repeats == 1
    rig.t += 0.002
    assert len(rig.send(on())) == 1


def test_setpoints_are_clipped_at_the_steering_stops():
    assert degrees(engaged().tick(on(radians(300))).steer) == pytest.approx(45)
    assert degrees(engaged().tick(on(radians(-300))).steer) == pytest.approx(-45)


def test_board_replies_to_steering_messages_or_else_reports_at_10_hz():
    rig = engaged()
    rig.steer = radians(-3.2)
    rig.tick(on())
    (report,) = rig.send(SteerData(1.4, 1, 0.0))
    assert isinstance(report, SteerState)
    assert degrees(report.steer) == pytest.approx(-3.2, abs=0.006)
    assert rig.send(SteerData(1.3, 1, 0.0), quiet=True) == []
    sent = 0
    for _ in range(40):
        rig.t += TICK
        rig.state, report = rig.board.report_if_due(rig.state, rig.t)
        sent += len(report)
    assert sent == 20


def test_hello_and_scan_messages_are_answered():
    rig = Rig()
    rig.steer = radians(3.2)
    rig.tick()
    (hello,) = rig.send(Hello())
    assert isinstance(hello, HelloReply)
    assert (hello.module, hello.counts) == (126, -96)
    rig.t += 1
    assert rig.send(Scan()) == [ScanReply(126, (127, 0, 0, 1), (127, 0, 0))]
    assert rig.send(frame(127, 201, bytes((201, 201, 1, 2, 3)))) == []
    rig.board = rig.board._replace(inertial_unit=True)
    rig.t += 1
    assert [reply.module for reply in rig.send(Hello())] == [126, 121]


@pytest.mark.parametrize(("host", "before", "after"), [("agopengps", 0b11, 0b01), ("agopenweb", 0b01, 0b11)])
def test_steer_switch_of_the_board_turns_on_at_the_configured_time(host, before, after):
    rig = Rig(host=host, engage_at_s=1.0)
    assert rig.send(off())[0].switches == before
    rig.t = 1.0
    assert rig.send(off())[0].switches == after


def settings(kp=40, high=60, least=9, counts=30, offset=0, ackermann=100):
    return SteerSettings(kp, high, least, least, counts, offset, ackermann)


@pytest.mark.parametrize(
    ("error_deg", "pwm"),
    [
        (0.0, 0),
        (0.02, 0),  # the board's arithmetic is in whole counts
        (0.1, 12),  # 4 + 9 counts, limit 10.8 + 0.1/3 * 49.2
        (1.0, 27),  # limit 10.8 + 1/3 * 49.2
        (3.0, 60),
        (20.0, 60),
    ],
)
def test_proportional_law_of_the_board_respects_its_power_limits(error_deg, pwm):
    for sign in (1, -1):
        rig = engaged(steer_by="pwm")
        actuation = rig.tick(on(sign * radians(error_deg)))
        assert rig.state.pwm == sign * pwm
        assert actuation.voltage == pytest.approx(NEUTRAL_V + sign * NEUTRAL_V * pwm / 255)


def test_steering_error_of_the_board_uses_the_measured_angle():
    rig = engaged(steer_by="pwm")
    rig.steer = radians(12)
    assert rig.tick(on(radians(10))).voltage < NEUTRAL_V


def test_settings_from_the_host_apply_immediately_and_outlast_an_outage():
    rig = engaged(steer_by="pwm")
    rig.send(settings(high=255, least=20))
    assert rig.tick(on(radians(20))).voltage == pytest.approx(2 * NEUTRAL_V)
    rig.tick(ticks=60)
    rig.tick(off())
    assert rig.tick(on(radians(20))).voltage == pytest.approx(2 * NEUTRAL_V)


def test_settings_at_power_up_are_taken_from_the_scenario():
    rig = engaged(steer_by="pwm", board=BoardSettings(kp=10, high_pwm=128, min_pwm=0))
    assert rig.tick(on(radians(30))).voltage == pytest.approx(NEUTRAL_V * (1 + 128 / 255))


def test_wrong_steering_sensor_settings_cause_a_wrong_wheel_angle():
    """With half of the true scale, the board measures twice the angle, so the wheels turn by half."""
    rig = engaged()
    rig.send(settings(counts=15))
    rig.steer = radians(5)
    assert degrees(rig.tick(on(radians(10))).steer) == pytest.approx(5.0, abs=0.01)
    assert degrees(rig.send(off())[0].steer) == pytest.approx(10.0, abs=0.01)


def test_ackermann_scale_applies_only_to_steering_angles_to_the_left():
    rig = engaged()
    rig.send(settings(ackermann=50))
    assert degrees(rig.tick(on(radians(10))).steer) == pytest.approx(20.0, abs=0.01)
    assert degrees(rig.tick(on(radians(-10))).steer) == pytest.approx(-10.0, abs=0.01)


def test_inverted_wiring_settings_invert_motor_and_angle_sensor():
    rig = engaged(steer_by="pwm")
    rig.send(SteerConfig(0x04))
    assert rig.tick(on(radians(20))).voltage < NEUTRAL_V
    rig = engaged()
    rig.steer = radians(5)
    rig.send(SteerConfig(0x01))
    rig.tick(off())
    assert degrees(rig.send(off(0.0))[0].steer) == pytest.approx(-5.0, abs=0.01)


def test_host_settings_of_zero_cause_no_division_by_zero():
    rig = engaged(steer_by="pwm")
    rig.send(settings(0, 0, 0, 0, 0, 0))
    rig.steer = radians(5)
    assert rig.tick(on(radians(20))).voltage == NEUTRAL_V
    assert isinstance(rig.send(SteerData(1.0, 1, 0.1))[0], SteerState)


def valid_steer_data(datagram):
    """Return whether a board must accept a datagram, by an independent implementation of the frame description."""
    return (
        len(datagram) >= 14
        and datagram[:4] == b"\x80\x81\x7f\xfe"
        and len(datagram) == 6 + datagram[4]
        and datagram[4] >= 8
        and sum(datagram[2:-1]) % 256 == datagram[-1]
    )


def hostile(random):
    """Return noise, or a message of a host with changed, missing or additional bytes and sometimes a valid checksum."""
    if random.random() < 0.2:
        return random.randbytes(random.randint(0, 1500))
    data = bytearray(encode(random.choice([on(), off(), settings(), SteerConfig(5), Hello(), Scan()])))
    for _ in range(random.randint(0, 3)):
        data[random.randrange(len(data))] = random.randrange(256)
    kind = random.random()
    if kind < 0.2:
        data = data[: random.randint(0, len(data))]
    elif kind < 0.4:
        data += random.randbytes(random.randint(1, 20))
    elif kind < 0.6:
        data = bytearray(frame(data[2], data[3], bytes(data[5:-1])))
    return bytes(data)


def test_malformed_datagrams_do_not_engage_the_board_or_exceed_limits():
    random, rig = Random(5), Rig()
    latched, asked, seen = True, None, 0
    for n in range(10_000):
        datagram = hostile(random)
        rig.t += 0.01
        rig.send(datagram)
        if valid_steer_data(datagram):
            seen += 1
            asked = datagram[7] & 1, -int.from_bytes(datagram[8:10], "little", signed=True) / 100
            latched = latched and bool(asked[0])
        rig.state, actuation = rig.board.tick(rig.state, rig.t, 0.0)
        assert actuation.engaged == (asked is not None and bool(asked[0]) and not latched), n
        assert abs(actuation.steer) <= LIMIT
        if not actuation.engaged:
            assert actuation.voltage == NEUTRAL_V
    tally = rig.state.tally
    rejected = sum(count for _, count in tally.rejected)
    assert seen > 500
    assert rejected > 1000
    assert tally.steer_data + tally.hellos + tally.others + tally.unknown + tally.repeats + rejected == 10_000
