"""Byte layouts of the AgOpenGPS messages, with one codec per message.

In the transmitted frames, angles are in degrees and positive to the right, headings in degrees clockwise from north,
and speeds in km/h. Speeds, angles and cross-track errors outside the range of their field saturate at its limits.
"""

from collections.abc import Callable
from math import degrees, isnan, nan, pi, radians
from struct import Struct
from typing import Any, NamedTuple

from agrobot_mj.core.agopengps.messages import (
    HOST,
    IMU,
    NO_LINE,
    STEER,
    Hello,
    HelloReply,
    Message,
    Scan,
    ScanReply,
    SteerConfig,
    SteerData,
    SteerSettings,
    SteerState,
)
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.nmea import to_compass

KMH = 3.6  # Conversion factor from m/s to km/h [km/h per m/s]
NO_HEADING, NO_ROLL = 9999, 8888  # Heading and roll that a steer module without an inertial unit sends [0.1 deg]
LINE_VALID = 0x10  # Status bit of AgOpenWeb for a valid cross-track error


class Codec(NamedTuple):
    """Codec of a message: sender, minimum data length, encoder and decoder."""

    source: int
    least: int  # Minimum number of data bytes; further bytes are ignored
    pack: Callable[[Any], bytes]
    unpack: Callable[[bytes], Message]


def to_wire_angle(angle: float) -> int:
    """Convert a steering angle [rad], positive to the left, to an int16 in 0.01 deg, positive to the right."""
    return int16(-degrees(angle) * 100)


def from_wire_angle(value: int) -> float:
    """Convert an int16 steering angle in 0.01 deg, positive to the right, to [rad], positive to the left."""
    return -radians(value / 100)


def from_compass(heading: float) -> float:
    """Convert a compass heading [deg], clockwise from north, to a yaw [rad], counter-clockwise from east."""
    return wrap(pi / 2 - radians(heading))


def cross_track_of(message: SteerData, dialect: str) -> float:
    """Return the cross-track error [m] in a message, positive to the left, or NaN if the program has no guidance line.

    Byte 10 of the frame contains the error, positive to the right. AgOpenGPS sends steps of 2 cm relative to 127 (up to
    2.5 m). AgOpenWeb sends signed centimetres (up to 1.3 m). `dialect` is "agopenweb" for AgOpenWeb.
    """
    if dialect == "agopenweb":
        value = message.cross_track - 256 if message.cross_track > 127 else message.cross_track
        return -value / 100 if message.status & LINE_VALID else nan
    return nan if message.cross_track == NO_LINE else (127 - message.cross_track) / 50


def cross_track_byte(distance: float, dialect: str) -> int:
    """Return the `SteerData` byte for the cross-track error `distance` [m], positive to the left, in a host
    `dialect`."""
    if dialect == "agopenweb":
        return clip_to_integer(-distance * 100, -127, 127) & 0xFF
    return clip_to_integer(127 - distance * 50, 0, 254)


def clip_to_integer(value: float, low: int, high: int) -> int:
    """Return `value` limited to the interval from `low` to `high` and rounded to an integer."""
    return round(min(max(value, low), high))


def int16(value: float) -> int:
    """Return `value` rounded to an integer and limited to the range of a signed 16-bit field."""
    return clip_to_integer(value, -32768, 32767)


def _tenths(angle: float, none: int) -> int:
    return none if isnan(angle) else int16(angle * 10)


def _pack_steer_data(m: SteerData) -> bytes:
    speed = clip_to_integer(abs(m.speed) * KMH * 10, 0, 65535)
    status, cross_track = clip_to_integer(m.status, 0, 255), clip_to_integer(m.cross_track, 0, 255)
    return STEER_DATA.pack(speed, status, to_wire_angle(m.steer), cross_track, m.sections)


def _steer_data(data: bytes) -> SteerData:
    speed, status, steer, cross_track, sections = STEER_DATA.unpack_from(data)
    return SteerData(speed / 10 / KMH, status, from_wire_angle(steer), cross_track, sections)


def _pack_steer_state(m: SteerState) -> bytes:
    heading = _tenths(nan if isnan(m.yaw) else to_compass(m.yaw), NO_HEADING)
    roll = _tenths(degrees(m.roll), NO_ROLL)
    return STEER_STATE.pack(to_wire_angle(m.steer), heading, roll, m.switches, clip_to_integer(m.pwm, 0, 255))


def _steer_state(data: bytes) -> SteerState:
    steer, heading, roll, switches, pwm = STEER_STATE.unpack_from(data)
    yaw = nan if heading == NO_HEADING else from_compass(heading / 10)
    return SteerState(from_wire_angle(steer), yaw, nan if roll == NO_ROLL else radians(roll / 10), switches, pwm)


def _scan_reply(data: bytes) -> ScanReply:
    return ScanReply(STEER, tuple(data[:4]), tuple(data[4:7]))


def _plain(message: Callable[..., Message], layout: str) -> Codec:
    fields = Struct(layout)
    return Codec(
        HOST, fields.size, lambda m: fields.pack(*m).ljust(8, b"\0"), lambda data: message(*fields.unpack_from(data))
    )


def _hello_reply(module: int) -> Codec:
    def unpack(data: bytes) -> HelloReply:
        steer, counts, switches = HELLO_REPLY.unpack_from(data)
        return HelloReply(module, from_wire_angle(steer), counts, switches)

    def pack(m: HelloReply) -> bytes:
        return HELLO_REPLY.pack(to_wire_angle(m.steer), int16(m.counts), m.switches)

    return Codec(module, HELLO_REPLY.size, pack, unpack)


STEER_DATA, STEER_STATE, HELLO_REPLY = Struct("<HBhBH"), Struct("<hhhBB"), Struct("<hhB")
CODECS = {
    254: Codec(HOST, STEER_DATA.size, _pack_steer_data, _steer_data),
    252: _plain(SteerSettings, "<5BhB"),
    251: _plain(SteerConfig, "<5B"),
    200: Codec(HOST, 1, lambda m: b"\x38\x00\x00", lambda data: Hello()),
    202: Codec(HOST, 3, lambda m: b"\xca\xca\x05", lambda data: Scan()),
    253: Codec(STEER, STEER_STATE.size, _pack_steer_state, _steer_state),
    STEER: _hello_reply(STEER),
    IMU: _hello_reply(IMU),
    203: Codec(STEER, 7, lambda m: bytes((*m.address, *m.subnet)), _scan_reply),
}
NUMBERS = {SteerData: 254, SteerSettings: 252, SteerConfig: 251, Hello: 200, Scan: 202, SteerState: 253, ScanReply: 203}
"""Message number of each message type. The number of a `HelloReply` is the number of its module."""
