"""Frames of the AgOpenGPS family: golden vectors, real frames, round trips, and invalid frames."""

from math import isnan, pi, radians
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
from agrobot_mj.core.agopengps.wire import Rejected, Unknown, check, decode, encode, frame

HALF = 0.5 * radians(0.01)  # Half a count of a steering angle [rad]
GOLDEN = {
    "254 on": (
        SteerData(4.3 / 3.6, 1, radians(3.25), 0x7F),
        "80 81 7F FE 08 2B 00 01 BB FE 7F 00 00 E9",
    ),
    "254 off": (SteerData(4.3 / 3.6, 0, 0.0, 255), "80 81 7F FE 08 2B 00 00 00 00 FF 00 00 AF"),
    "253": (SteerState(radians(3.20), switches=1, pwm=42), "80 81 7E FD 08 C0 FE 0F 27 B8 22 01 2A 7C"),
    "252": (SteerSettings(40, 160, 30, 25, 100, 0, 100), "80 81 7F FC 08 28 A0 1E 19 64 00 00 64 4A"),
    "251": (SteerConfig(0x18, 5), "80 81 7F FB 08 18 05 00 00 00 00 00 00 9F"),
    "126": (HelloReply(126, radians(3.2), -320, 1), "80 81 7E 7E 05 C0 FE C0 FE 01 7E"),
    "202": (Scan(), "80 81 7F CA 03 CA CA 05 E5"),
    "203": (ScanReply(126, (127, 0, 0, 1), (127, 0, 0)), "80 81 7E CB 07 7F 00 00 01 7F 00 00 4F"),
}
"""Messages with their bytes, computed by hand from the layouts."""


def bare(text: str) -> bytes:
    return bytes.fromhex(text)


@pytest.mark.parametrize("name", GOLDEN)
def test_documented_example_messages_are_encoded_and_decoded(name):
    message, text = GOLDEN[name]
    assert encode(message) == bare(text)
    assert encode(decode(bare(text))) == bare(text)
    assert type(decode(bare(text))) is type(message)


def test_setpoint_to_the_left_is_negative_in_the_message():
    message = decode(bare(GOLDEN["254 on"][1]))
    assert message.steer == pytest.approx(radians(3.25))
    assert message.speed == pytest.approx(4.3 / 3.6)
    assert (message.status, message.cross_track) == (1, 127)


def test_hello_message_is_accepted_with_any_checksum():
    as_sent = bare("80 81 7F C8 03 38 00 00 47")
    assert decode(as_sent) == Hello()
    assert encode(Hello()) == as_sent[:-1] + b"\x82"


@pytest.mark.parametrize(
    ("text", "status", "degrees_left", "distance"),
    [
        ("80 81 7f fe 08 36 00 00 00 00 ff 00 00 ba", 0, 0.0, 255),
        ("80 81 7f fe 08 36 00 00 02 fc ff 00 00 b8", 0, 10.22, 255),
        ("80 81 7f fe 08 36 00 01 f6 fb b1 00 00 5e", 1, 10.34, 177),
        ("80 81 7f fe 08 36 00 01 eb fb b1 00 00 53", 1, 10.45, 177),
    ],
)
def test_frames_recorded_from_a_real_host_are_decoded(text, status, degrees_left, distance):
    message = decode(bare(text))
    assert message.speed == pytest.approx(1.5)
    assert (message.status, message.cross_track) == (status, distance)
    assert message.steer == pytest.approx(radians(degrees_left), abs=HALF)
    assert encode(message) == bare(text)


def test_messages_equal_frames_recorded_from_a_host_and_a_board():
    assert decode(bare("80 81 7f ef 08 00 36 00 00 00 00 00 00 ac")) == Unknown(127, 239)
    assert decode(bare("80 81 7f fb 08 00 03 05 00 00 00 00 00 8a")) == SteerConfig(0, 3, 5)
    assert encode(HelloReply(126, switches=2)) == bare("80 81 7e 7e 05 00 00 00 00 02 03")
    assert encode(SteerState(0.0, switches=2)) == bare("80 81 7e fd 08 00 00 0f 27 b8 22 02 00 95")


def test_short_configuration_message_is_decoded():
    assert decode(frame(127, 251, bytes((1, 2, 3, 4, 5)))) == SteerConfig(1, 2, 3, 4, 5)


def test_reply_of_a_module_without_imu_has_neither_heading_nor_roll():
    state = decode(bare(GOLDEN["253"][1]))
    assert isnan(state.yaw)
    assert isnan(state.roll)


def test_imu_reply_is_unchanged_by_encoding_and_decoding():
    assert decode(encode(HelloReply(121))) == HelloReply(121, -0.0)


@given(st.floats(0, 100), st.integers(0, 255), st.floats(-5.7, 5.7), st.integers(0, 255), st.integers(0, 65535))
def test_steering_messages_are_unchanged_by_encoding_and_decoding(speed, status, steer, distance, sections):
    again = decode(encode(SteerData(speed, status, steer, distance, sections)))
    assert again.steer == pytest.approx(steer, abs=HALF * 1.001)
    assert again.speed == pytest.approx(speed, abs=0.0139)
    assert (again.status, again.cross_track, again.sections) == (status, distance, sections)


@given(st.floats(-pi, pi), st.floats(-0.7, 0.7))
def test_heading_and_roll_are_encoded_with_a_resolution_of_0_1_deg(yaw, roll):
    again = decode(encode(SteerState(0.0, yaw, roll)))
    assert (again.yaw - yaw + pi) % (2 * pi) - pi == pytest.approx(0.0, abs=radians(0.051))
    assert again.roll == pytest.approx(roll, abs=radians(0.051))


def test_values_outside_the_field_range_saturate():
    assert decode(encode(SteerData(1e9, 1, 100.0))).steer == pytest.approx(radians(327.68))
    assert decode(encode(SteerState(-100.0, pwm=9999))).pwm == 255


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (b"", "preamble"),
        (b"\x80", "preamble"),
        (b"$PANDA,1*00\r\n", "preamble"),
        (b"\x80\x81", "length"),
        (b"\x80\x81\x7f\xfe\x08", "length"),
        (bare("80 81 7F FE 08 2B 00 01 BB FE 7F 00 00 E9 00"), "length"),
        (bare("80 81 7F FE 08 2B 00 01 BB FE 7F 00 00 E8"), "checksum"),
        (frame(126, 254, bytes(8)), "source"),
        (frame(127, 253, bytes(8)), "source"),
        (frame(127, 254, bytes(7)), "data"),
        (frame(127, 202, b""), "data"),
    ],
)
def test_invalid_frames_are_rejected_with_a_reason(datagram, reason):
    assert decode(datagram) == Rejected(reason)


def test_frame_for_another_module_is_ignored_without_an_error():
    assert decode(frame(127, 238, bytes(8))) == Unknown(127, 238)


def test_ten_thousand_malformed_datagrams_are_decoded_or_rejected():
    random = Random(11)
    seeds = [encode(m) for m, _ in GOLDEN.values()] + [frame(127, n, bytes(16)) for n in (100, 201, 229, 239)]
    for _ in range(10_000):
        datagram = bytearray(
            random.choice(seeds) if random.random() < 0.7 else random.randbytes(random.randint(0, 300))
        )
        for _ in range(random.randint(0, 4)):
            if datagram:
                datagram[random.randrange(len(datagram))] = random.randrange(256)
        if random.random() < 0.3:  # a valid check byte takes a hostile datagram further
            datagram = bytearray(frame(*datagram[2:4], bytes(datagram[5:100]))) if len(datagram) > 4 else datagram
        message = decode(bytes(datagram))
        if not isinstance(message, Rejected | Unknown | Hello | Scan):
            assert datagram[-1] == check(bytes(datagram[2:-1]))
            assert isinstance(decode(encode(message)), type(message))
