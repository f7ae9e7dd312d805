"""NMEA 0183 sentences of a GNSS receiver: creation of GGA, RMC and VTG, and parsing of the fields of any sentence.

A sentence is `$fields*CS` followed by CR LF. CS is the exclusive or of the characters between `$` and `*` as two hex
digits. Minutes of angle have seven decimals (0.2 mm), because five decimals would quantise positions to 19 mm.
"""

from datetime import UTC, datetime, timedelta
from math import degrees, pi
from typing import NamedTuple

START = datetime(2026, 6, 1, 12, tzinfo=UTC)  # UTC time at the start of every run, constant for repeatable runs
KNOTS = 3600 / 1852  # Conversion factor from m/s to knots [kn per m/s]
MINUTE_DECIMALS = 7
NO_FIX, GPS_FIX, DGPS_FIX, RTK_FIX, RTK_FLOAT = 0, 1, 2, 4, 5  # Values of the fix quality indicator in GGA sentences
MODES = {NO_FIX: "N", DGPS_FIX: "D", RTK_FIX: "R", RTK_FLOAT: "F"}
"""Mode letter of RMC and VTG sentences by fix quality; "A" applies to other qualities."""


class Solution(NamedTuple):
    """Navigation solution of a receiver at one time."""

    t: float  # Time since the start of the run [s]
    latitude: float  # Latitude [deg], north positive
    longitude: float  # Longitude [deg], east positive
    altitude: float  # Height of the antenna above z = 0 [m], interpreted as height above the WGS84 ellipsoid
    speed: float  # Speed over ground [m/s]
    course: float  # Direction of motion [rad], from east, counter-clockwise
    quality: int = RTK_FIX  # Fix quality indicator of the GGA sentence
    satellites: int = 14  # Number of satellites in use [-]. Assumed value.
    hdop: float = 0.7  # Horizontal dilution of precision [-]. Assumed value.
    age: float = 1.0  # Age of the corrections [s]. Assumed value.


def checksum(text: str) -> str:
    """Return the checksum of the characters between `$` and `*` as two hex digits."""
    total = 0
    for character in text:
        total ^= ord(character)
    return f"{total:02X}"


def sentence(*fields: object) -> bytes:
    """Return the complete NMEA sentence with the given fields, including checksum and line end."""
    text = ",".join(map(str, fields))
    return f"${text}*{checksum(text)}\r\n".encode("ascii")


def fields_of(datagram: bytes) -> list[str] | None:
    """Return the fields of a sentence, name first, or None for an invalid sentence or a wrong checksum."""
    text = datagram.decode("ascii", errors="replace").strip()
    body, star, given = text.removeprefix("$").partition("*")
    if not text.startswith("$") or not star or given.upper() != checksum(body):
        return None
    return body.split(",")


def clock(t: float) -> str:
    """Return the UTC time at `t` [s] after the start of the run, in the form hhmmss.ss."""
    time = START + timedelta(seconds=round(t, 2))
    return f"{time:%H%M%S}.{time.microsecond // 10000:02d}"


def date(t: float) -> str:
    """Return the UTC date at `t` [s] after the start of the run, in the form ddmmyy."""
    return f"{START + timedelta(seconds=round(t, 2)):%d%m%y}"


def angle(value: float, hemispheres: str, digits: int) -> tuple[str, str]:
    """Return a latitude or longitude [deg] in degrees and minutes, and its letter from `hemispheres` (positive,
    negative)."""
    unit = 10**MINUTE_DECIMALS
    whole, rest = divmod(round(abs(value) * 60 * unit), 60 * unit)
    return f"{whole:0{digits}d}{rest // unit:02d}.{rest % unit:0{MINUTE_DECIMALS}d}", hemispheres[value < 0]


LONGEST_DEGREES = 5  # Maximum number of digits before the decimal point of a string in degrees and minutes


def degrees_of(text: str, hemisphere: str) -> float:
    """Convert a text in degrees and minutes to latitude or longitude [deg]. Raises ValueError for an invalid text."""
    if (point := text.index(".")) > LONGEST_DEGREES:
        raise ValueError(text)
    value = int(text[: point - 2]) + float(text[point - 2 :]) / 60
    return -value if hemisphere in ("S", "W") else value


def place(solution: Solution) -> tuple[str, str, str, str]:
    """Return the position fields of an NMEA sentence: latitude, N or S, longitude, E or W."""
    return *angle(solution.latitude, "NS", 2), *angle(solution.longitude, "EW", 3)


def to_compass(yaw: float) -> float:
    """Convert a yaw [rad] to a compass heading [deg], clockwise from north in [0, 360)."""
    return degrees(pi / 2 - yaw) % 360.0


def gga(s: Solution) -> bytes:
    """Return the GGA sentence, with position and fix quality. Without a fix the position fields are empty."""
    where = place(s) if s.quality else ("", "", "", "")
    return sentence(
        *("GPGGA", clock(s.t), *where, s.quality, f"{s.satellites:02d}", f"{s.hdop:.1f}"),
        *(f"{s.altitude:.3f}", "M", "0.0", "M", f"{s.age:.1f}", "0000"),
    )


def rmc(s: Solution) -> bytes:
    """Return the RMC sentence, with position, speed, course and date. Without a fix only time and date are present."""
    where, status = (place(s), "A") if s.quality else (("", "", "", ""), "V")
    motion = (f"{s.speed * KNOTS:.3f}", f"{to_compass(s.course):.2f}") if s.quality else ("", "")
    return sentence("GPRMC", clock(s.t), status, *where, *motion, date(s.t), "", "", MODES.get(s.quality, "A"))


def vtg(s: Solution) -> bytes:
    """Return the VTG sentence, with course and speed over ground. Without a fix these fields are empty."""
    if not s.quality:
        return sentence("GPVTG", "", "T", "", "M", "", "N", "", "K", "N")
    motion = f"{to_compass(s.course):.2f}", "T", "", "M", f"{s.speed * KNOTS:.3f}", "N", f"{s.speed * 3.6:.3f}", "K"
    return sentence("GPVTG", *motion, MODES.get(s.quality, "A"))
