"""Position sentences of the AgOpenGPS family: `$PANDA` (one antenna and an inertial unit) and `$PAOGI` (two antennas).

Both sentences end with speed [kn], heading, roll, pitch and yaw rate. Heading is clockwise from north. Roll is positive
with the right side down, and pitch with the nose up. Heading, roll and pitch are decimal numbers in degrees in PAOGI,
and integers in units of 0.1 deg in PANDA.

Without an inertial unit, the PANDA heading is a reserved number, because guidance programs interpret an empty or
fractional field as 0 (north). Roll, pitch and yaw rate are then 0, which these programs also assume for empty fields.
"""

from math import degrees, isfinite, isnan, nan, radians
from typing import NamedTuple

from agrobot_mj.core.agopengps.layouts import from_compass, int16
from agrobot_mj.core.nmea import KNOTS, Solution, clock, degrees_of, fields_of, place, sentence, to_compass

NO_HEADING = 65535  # Heading in PANDA sentences without an inertial unit [0.1 deg]
FIELDS = 16


class BoardAttitude(NamedTuple):
    """Attitude measured by the inertial unit or by two antennas. Angles and rates that are not measured are NaN."""

    yaw: float = nan  # Yaw [rad]
    roll: float = nan  # Roll [rad], left side up positive
    pitch: float = nan  # Pitch, nose down positive [rad]
    yaw_rate: float = nan  # Yaw rate [rad/s], left positive


def panda(s: Solution, a: BoardAttitude) -> bytes:
    """Return the PANDA sentence for the solution `s` of a receiver and the attitude `a` of an optional inertial
    unit."""
    heading = NO_HEADING if isnan(a.yaw) else round(to_compass(a.yaw) * 10) % 3600
    roll = 0 if isnan(a.roll) else int16(degrees(a.roll) * 10)
    pitch = 0 if isnan(a.pitch) else int16(-degrees(a.pitch) * 10)
    rate = 0 if isnan(a.yaw_rate) else int16(-degrees(a.yaw_rate))
    return sentence("PANDA", *_common(s), heading, roll, pitch, rate)


def paogi(s: Solution, a: BoardAttitude) -> bytes:
    """Return the PAOGI sentence of a receiver with two antennas; the yaw of the attitude `a` must not be NaN."""
    heading = f"{round(to_compass(a.yaw), 2) % 360:.2f}"
    return sentence(
        "PAOGI",
        *_common(s),
        heading,
        _degrees_text(a.roll, 2),
        _degrees_text(-a.pitch, 1),
        _degrees_text(-a.yaw_rate, 1),
    )


def _degrees_text(value: float, decimals: int) -> str:
    """Format an angle [rad] or an angular rate [rad/s] in degrees with fixed decimals; NaN and negative zero become
    0."""
    return f"{0.0 if isnan(value) else round(degrees(value), decimals) + 0.0:.{decimals}f}"


def _common(s: Solution) -> tuple[object, ...]:
    quality = s.quality, s.satellites, f"{s.hdop:.1f}", f"{s.altitude:.3f}", f"{s.age:.1f}"
    return clock(s.t), *place(s), *quality, f"{s.speed * KNOTS:.3f}"


class Position(NamedTuple):
    """Content of a PANDA or PAOGI position sentence."""

    dual: bool  # Whether the heading comes from two antennas
    solution: Solution
    attitude: BoardAttitude


def decode_position(datagram: bytes) -> Position | None:
    """Decode a PANDA or PAOGI sentence. Return None for other sentences and for invalid or non-finite fields."""
    fields = fields_of(datagram)
    if fields is None or len(fields) != FIELDS or fields[0] not in ("PANDA", "PAOGI"):
        return None
    try:
        found = _position(fields)
    except ValueError:
        return None
    s = found.solution
    return found if all(map(isfinite, (s.latitude, s.longitude, s.altitude, s.speed))) else None


def _position(fields: list[str]) -> Position:
    name, time, lat, ns, lon, ew, quality, satellites, hdop, altitude, age, speed, heading, roll, pitch, rate = fields
    dual, scale = name == "PAOGI", 1.0 if name == "PAOGI" else 0.1
    t = int(time[:2]) * 3600 + int(time[2:4]) * 60 + float(time[4:])
    none = not dual and int(heading) == NO_HEADING
    yaw = nan if none else from_compass(float(heading) * scale)
    tilt = radians(float(roll) * scale), -radians(float(pitch) * scale)
    attitude = BoardAttitude(yaw, *tilt, -radians(float(rate)))
    place_ = degrees_of(lat, ns), degrees_of(lon, ew), float(altitude)
    solution = Solution(t, *place_, float(speed) / KNOTS, nan, int(quality), int(satellites), float(hdop), float(age))
    return Position(dual, solution, attitude)
