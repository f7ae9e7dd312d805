"""Zero of the angle sensor, and roll, of the simulated board compared with doubles of real boards and programs.

Boards (AgOpenGPS-Official/Boards): AiO v2.5 Autosteer.ino:434, AiO v4 Autosteer.ino:423, Autosteer_UDP_v5.ino:501,
and zHandlers.ino:91 of AiO v2.5. Programs: AgOpenGPS FormSteer.cs:911, AgOpenWeb AutoSteerConfigViewModel.cs:442. The
doubles follow these sources and compute in degrees with right positive.
"""

from math import degrees, isnan, nan, radians, sin

import pytest

from agrobot_mj.core.agopengps.messages import SteerConfig, SteerData, SteerSettings, SteerState
from agrobot_mj.core.agopengps.position import BoardAttitude, panda
from agrobot_mj.core.agopengps.wire import decode, encode
from agrobot_mj.core.nmea import Solution, fields_of, sentence
from agrobot_mj.extensions.links.agopengps.board import Board
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps, BoardSettings

HOSTS = ("agopengps", "agopenweb")
ANTENNA_M = 2.0
HERE = Solution(1.0, 50.877, 4.699, 35.0, 1.5, 0.3)


def shown_by_a_real_board(counts, offset, per_degree, ackermann, host):
    """Return the angle, right positive [deg], that the firmware computes from sensor counts."""
    angle = (counts + offset if host == "agopengps" else counts - offset) / per_degree
    return angle * ackermann / 100 if angle < 0 else angle


def zero_pressed(offset, per_degree, shown, host):
    """Return the offset sent by the host program when its user marks the wheels as straight."""
    return offset + int(per_degree * -shown) if host == "agopengps" else offset + round(per_degree * shown)


class Bench:
    """Simulated board with a biased angle sensor, on wheels that are moved by hand."""

    def __init__(self, host, bias_deg=0.0, per_degree=30, invert=False):
        board = BoardSettings(counts_per_degree=per_degree)
        spec = AgOpenGps(host=host, board=board, sensor_counts_per_degree=per_degree)
        self.board, self.bias, self.per_degree, self.t = Board(spec, radians(45)), bias_deg, per_degree, 0.0
        self.state = self.board.init()
        if invert:
            self.send(SteerConfig(0x01))

    def send(self, message):
        self.t += 0.05
        self.state, answers = self.board.receive(self.state, encode(message), self.t, self.t)
        return [decode(answer) for answer in answers]

    def calibrate(self, offset, ackermann=100):
        self.send(SteerSettings(40, 60, 9, 9, self.per_degree, offset, ackermann))

    def shown(self, left_deg):
        """Return the angle in message 253 for a wheel angle [deg], positive to the right."""
        self.state, _ = self.board.tick(self.state, self.t, radians(left_deg + self.bias))
        (report,) = self.send(SteerData(1.0, 0, 0.0))
        assert isinstance(report, SteerState)
        return -degrees(report.steer)

    def wheels_for(self, left_deg):
        """Return the true wheel angle for an angle commanded by the host [deg]; the steering loop uses the same
        sensor."""
        self.send(SteerData(1.0, 0, 0.0))
        self.send(SteerData(1.0, 4 | 1, radians(left_deg)))
        self.state, actuation = self.board.tick(self.state, self.t, 0.0)
        assert actuation.engaged
        return degrees(actuation.steer) - self.bias


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("offset", [-150, 0, 77])
def test_simulated_board_reports_the_same_angle_as_a_real_board(host, offset):
    for invert in (False, True):
        bench = Bench(host, per_degree=45, invert=invert)
        bench.calibrate(offset, ackermann=80)
        for left_deg in (-20.0, -3.0, 0.0, 1.0, 12.5):
            counts = 45 * (left_deg if invert else -left_deg)
            expected = shown_by_a_real_board(counts, offset, 45, 80, host)
            assert bench.shown(left_deg) == pytest.approx(expected, abs=0.006)


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("bias_deg", [3.2, -1.7])
def test_zero_button_of_the_host_removes_a_steering_sensor_offset(host, bias_deg):
    bench = Bench(host, bias_deg)
    assert bench.shown(0.0) == pytest.approx(-bias_deg, abs=0.006)
    assert bench.wheels_for(0.0) == pytest.approx(-bias_deg, abs=0.006)
    bench.calibrate(zero_pressed(0, 30, bench.shown(0.0), host))
    assert bench.shown(0.0) == pytest.approx(0.0, abs=1 / 30)
    for left_deg in (0.0, 8.0, -8.0):
        assert bench.wheels_for(left_deg) == pytest.approx(left_deg, abs=1 / 30)


def signed_bytes(datagram):
    """Return the roll in message 253 as QtAgOpenGPS reads it: two signed bytes, without a missing value [deg]."""
    low, high = (byte - 256 if byte > 127 else byte for byte in datagram[9:11])
    return (high * 256 + low) / 10


def whole_number(datagram):
    """Return the roll in message 253 as AgOpenGPS reads it [deg], or NaN for a missing value."""
    value = int.from_bytes(datagram[9:11], "little", signed=True)
    return nan if value == 8888 else value / 10


def roll_of_a_host(read, state, position):
    """Return the roll used by a host after a steering state and a position [deg]."""
    found = read(state)
    roll = 0.0 if isnan(found) else found
    field = fields_of(position)[13]
    value = int(field) if field else 0  # of an empty field the bridge makes 0
    return roll if value == 32767 else value / 10  # a reserved number leaves what was there


@pytest.mark.parametrize("read", [signed_bytes, whole_number])
def test_host_applies_no_tilt_correction_without_an_imu(read):
    state = encode(SteerState(radians(3.0), switches=1))
    ours = panda(HERE, BoardAttitude())
    fields = [str(field) for field in fields_of(ours)]
    assert fields[12:] == ["65535", "0", "0", "0"]
    as_boards_send = sentence("PANDA", *fields[1:13], "", "", "")
    reserved = sentence("PANDA", *fields[1:13], 32767, 0, 0)
    lean = [ANTENNA_M * sin(radians(roll_of_a_host(read, state, each))) for each in (ours, as_boards_send, reserved)]
    assert lean[:2] == [0.0, 0.0]
    assert abs(lean[2]) == pytest.approx(1.198 if read is signed_bytes else 0.0, abs=0.001)


def test_available_roll_is_sent_to_the_host_even_without_a_heading():
    assert fields_of(panda(HERE, BoardAttitude(roll=radians(-4.23))))[12:14] == ["65535", "-42"]
