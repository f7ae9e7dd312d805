"""Where each value stands in the data of a frame: one codec a message.

On the wire angles are degrees with right positive, headings degrees clockwise from north, speeds km/h; values beyond
the range of their field saturate.
"""

from collections.abc import Callable
from math import degrees, isnan, nan, pi, radians
from struct import Struct
from typing import Any, NamedTuple

from agrobot_mj.core.geometry import wrap
from agrobot_mj.links.agopengps.messages import (
    GPS,
    HELLO,
    HOST,
    IMU,
    MACHINE,
    NO_LINE,
    SCAN,
    STEER,
    SUBNET,
    BridgePosition,
    CorrectedPosition,
    Hello,
    HelloReply,
    ImuData,
    MachineData,
    Scan,
    ScanReply,
    SectionData,
    SensorValue,
    SteerConfig,
    SteerData,
    SteerSettings,
    SteerState,
    SubnetChange,
)

KMH = 3.6
"""One metre per second in kilometres per hour [km/h per m/s]."""
NO_HEADING, NO_ROLL = 9999, 8888
"""What a steer module without an inertial unit sends [0.1 deg]."""
LINE_VALID = 0x10
"""Bit of the status in AgOpenWeb: its distance from the line is one."""
SHORTEST = 8
"""Data bytes of the messages that are filled up [bytes]."""
RECEIVER = 124
"""Number under which the bridge forwards positions."""

STEER_DATA, STEER_SETTINGS, STEER_CONFIG = Struct("<HBhBH"), Struct("<5BhB"), Struct("<5B")
MACHINE_DATA, SECTION_DATA, POSITION = Struct("<5BxH"), Struct("<QBB"), Struct("<dd")
STEER_STATE, SENSOR_VALUE, HELLO_REPLY = Struct("<hhhBB"), Struct("<B"), Struct("<hhB")
SCAN_REPLY, IMU_DATA, BRIDGE = Struct("<7B"), Struct("<Hhh2x"), Struct("<ddfffffHBHHHhhh")


class Codec(NamedTuple):
    """How a message is written and read."""

    message: type[Any]
    number: int
    """PGN."""
    source: int
    """Number of the module that sends it; any but the host where that is not `HOST`."""
    least: int
    """Fewest data bytes that can be read; what stands behind them is left alone."""
    pack: Callable[[Any], bytes]
    unpack: Callable[[int, bytes], Any]
    """From the source and the data."""
    replies: bool = False
    """The number is that of the module itself."""


def to_wire_angle(angle: float) -> int:
    """Steering angle [rad], left positive, as int16 [0.01 deg], right positive."""
    return int16(-degrees(angle) * 100)


def from_wire_angle(value: int) -> float:
    """Steering angle [rad] of an int16."""
    return -radians(value / 100)


def to_compass(yaw: float) -> float:
    """Heading [deg], clockwise from north, in [0, 360), of a yaw [rad]."""
    return degrees(pi / 2 - yaw) % 360.0


def from_compass(heading: float) -> float:
    """Yaw [rad] of a heading [deg]."""
    return wrap(pi / 2 - radians(heading))


def cross_track_of(message: SteerData, dialect: str) -> float:
    """The host's own distance from its line, left positive; NaN without a line [m].

    Byte 10 is right positive: counts of 2 cm about 127 in AgOpenGPS, signed centimetres in AgOpenWeb; it saturates at
    2.5 m and at 1.3 m.
    """
    if dialect == "agopenweb":
        value = message.cross_track - 256 if message.cross_track > 127 else message.cross_track
        return -value / 100 if message.status & LINE_VALID else nan
    return nan if message.cross_track == NO_LINE else (127 - message.cross_track) / 50


def cross_track_byte(distance: float, dialect: str) -> int:
    """Byte 10 for a distance from the line, left positive [m]."""
    if dialect == "agopenweb":
        return limited(-distance * 100, -127, 127) & 0xFF
    return limited(127 - distance * 50, 0, 254)


def limited(value: float, low: int, high: int) -> int:
    """The nearest whole number in a range."""
    return round(min(max(value, low), high))


def int16(value: float) -> int:
    """As a signed field of two bytes."""
    return limited(value, -32768, 32767)


def uint16(value: float) -> int:
    """As an unsigned field of two bytes."""
    return limited(value, 0, 65535)


def byte(value: float) -> int:
    """As a field of one byte."""
    return limited(value, 0, 255)


def _tenths(angle: float, none: int) -> int:
    return none if isnan(angle) else int16(angle * 10)


def _pack_steer_data(m: SteerData) -> bytes:
    values = uint16(abs(m.speed) * KMH * 10), byte(m.status), to_wire_angle(m.steer), byte(m.cross_track), m.sections
    return STEER_DATA.pack(*values)


def _steer_data(source: int, data: bytes) -> SteerData:
    speed, status, steer, cross_track, sections = STEER_DATA.unpack_from(data)
    return SteerData(speed / 10 / KMH, status, from_wire_angle(steer), cross_track, sections)


def _pack_machine_data(m: MachineData) -> bytes:
    return MACHINE_DATA.pack(m.u_turn, byte(m.speed * KMH * 10), m.lift, 0, 0, m.sections)


def _machine_data(source: int, data: bytes) -> MachineData:
    u_turn, speed, lift, _tram, _stop, sections = MACHINE_DATA.unpack_from(data)
    return MachineData(speed / 10 / KMH, u_turn, lift, sections)


def _pack_corrected(m: CorrectedPosition) -> bytes:
    tail = b"" if isnan(m.yaw) else Struct("<d").pack(to_compass(m.yaw))
    return POSITION.pack(m.longitude, m.latitude) + tail


def _corrected(source: int, data: bytes) -> CorrectedPosition:
    heading = Struct("<d").unpack_from(data, POSITION.size)[0] if len(data) >= POSITION.size + 8 else nan
    usable = -1e6 < heading < 1e6  # any eight bytes are a number to the sender's struct, not all are an angle
    longitude, latitude = POSITION.unpack_from(data)
    return CorrectedPosition(longitude, latitude, from_compass(heading) if usable else nan)


def _pack_steer_state(m: SteerState) -> bytes:
    heading = _tenths(nan if isnan(m.yaw) else to_compass(m.yaw), NO_HEADING)
    roll = _tenths(degrees(m.roll), NO_ROLL)
    return STEER_STATE.pack(to_wire_angle(m.steer), heading, roll, m.switches, byte(m.pwm))


def _steer_state(source: int, data: bytes) -> SteerState:
    steer, heading, roll, switches, pwm = STEER_STATE.unpack_from(data)
    yaw = nan if heading == NO_HEADING else from_compass(heading / 10)
    return SteerState(from_wire_angle(steer), yaw, nan if roll == NO_ROLL else radians(roll / 10), switches, pwm)


def _pack_hello_reply(m: HelloReply) -> bytes:
    return HELLO_REPLY.pack(to_wire_angle(m.steer), int16(m.counts), m.switches)


def _hello_reply(source: int, data: bytes) -> HelloReply:
    steer, counts, switches = HELLO_REPLY.unpack_from(data)
    return HelloReply(source, from_wire_angle(steer), counts, switches)


def _scan_reply(source: int, data: bytes) -> ScanReply:
    a = SCAN_REPLY.unpack_from(data)
    return ScanReply(source, (a[0], a[1], a[2], a[3]), (a[4], a[5], a[6]))


def _pack_imu(m: ImuData) -> bytes:
    return IMU_DATA.pack(uint16(to_compass(m.yaw) * 10), int16(degrees(m.roll) * 10), int16(2 * degrees(m.yaw_rate)))


def _imu(source: int, data: bytes) -> ImuData:
    heading, roll, rate = IMU_DATA.unpack_from(data)
    return ImuData(from_compass(heading / 10), radians(roll / 10), radians(rate / 2))


def _fields(message: type[Any], layout: Struct) -> tuple[Callable[[Any], bytes], Callable[[int, bytes], Any]]:
    """Writing and reading of a message whose fields stand in the data as they are; short ones are filled up."""
    return lambda m: layout.pack(*m).ljust(SHORTEST, b"\0"), lambda source, data: message(*layout.unpack_from(data))


def _codecs() -> tuple[Codec, ...]:
    def subnet(source: int, data: bytes) -> SubnetChange:
        return SubnetChange((data[2], data[3], data[4]))

    replies = _pack_hello_reply, _hello_reply, True
    return (
        Codec(SteerData, 254, HOST, STEER_DATA.size, _pack_steer_data, _steer_data),
        Codec(SteerSettings, 252, HOST, STEER_SETTINGS.size, *_fields(SteerSettings, STEER_SETTINGS)),
        Codec(SteerConfig, 251, HOST, STEER_CONFIG.size, *_fields(SteerConfig, STEER_CONFIG)),
        Codec(MachineData, 239, HOST, MACHINE_DATA.size, _pack_machine_data, _machine_data),
        Codec(SectionData, 229, HOST, SECTION_DATA.size, *_fields(SectionData, SECTION_DATA)),
        Codec(Hello, HELLO, HOST, 1, lambda m: b"\x38\x00\x00", lambda source, data: Hello()),
        Codec(SubnetChange, SUBNET, HOST, 5, lambda m: b"\xc9\xc9" + bytes(m.subnet), subnet),
        Codec(Scan, SCAN, HOST, 3, lambda m: b"\xca\xca\x05", lambda source, data: Scan()),
        Codec(CorrectedPosition, 100, HOST, POSITION.size, _pack_corrected, _corrected),
        Codec(SteerState, 253, STEER, STEER_STATE.size, _pack_steer_state, _steer_state),
        Codec(SensorValue, 250, STEER, SENSOR_VALUE.size, *_fields(SensorValue, SENSOR_VALUE)),
        *(Codec(HelloReply, module, module, HELLO_REPLY.size, *replies) for module in (STEER, MACHINE, IMU, GPS)),
        Codec(ScanReply, 203, STEER, SCAN_REPLY.size, lambda m: bytes((*m.address, *m.subnet)), _scan_reply),
        Codec(ImuData, 211, IMU, IMU_DATA.size, _pack_imu, _imu),
        Codec(BridgePosition, 214, RECEIVER, BRIDGE.size, *_fields(BridgePosition, BRIDGE)),
    )


CODECS: dict[int, Codec] = {codec.number: codec for codec in _codecs()}
"""Every message by its number."""
