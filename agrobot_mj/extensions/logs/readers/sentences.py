"""Quantities in NMEA 0183 sentences of receivers: position, motion, and headings of two antennas.

An empty field is a missing value. Positions in sentences without a fix are also missing values. A float solution of two
antennas may give any heading. Therefore sentences with a heading quality provide a heading only with a fixed solution.
"""

from collections.abc import Callable, Iterator
from math import nan
from mmap import mmap
from re import compile as pattern
from typing import NamedTuple

from agrobot_mj.core.agopengps.layouts import from_compass
from agrobot_mj.core.agopengps.position import decode_position as read_position
from agrobot_mj.core.nmea import DGPS_FIX, GPS_FIX, KNOTS, NO_FIX, RTK_FIX, RTK_FLOAT, degrees_of, fields_of, sentence

Quantities = dict[str, float]
Condition = Callable[[list[str]], bool]
SENTENCE = pattern(rb"\$([A-Z]{4,5}[A-Z0-9]*,[\x20-\x23\x25-\x29\x2b-\x7e]{0,500})(\*[0-9A-Fa-f]{2})?")
"""Regular expression for an NMEA sentence among other bytes. Without a checksum, the checksum group is None."""
BEST_FIRST = {"R": RTK_FIX, "F": RTK_FLOAT, "D": DGPS_FIX, "P": 3, "A": GPS_FIX, "E": 6, "M": 7, "S": 8}
"""GGA quality for each mode letter of the GNS sentence. If a sentence has several letters, the first letter in this
order applies."""
KSXT_QUALITY = (NO_FIX, GPS_FIX, RTK_FLOAT, RTK_FIX)  # GGA quality for each quality number of the KSXT sentence


class Sentence(NamedTuple):
    """NMEA sentence found in a file."""

    at: int  # Offset in the file [bytes]
    kind: str  # Type of the sentence, a key of `KINDS`
    fields: list[str]  # Fields of the sentence, name first, or an empty list if the checksum is missing or invalid
    text: str


def found_in(data: bytes | mmap) -> Iterator[Sentence]:
    """Yield the sentences in `data` whose types are in `KINDS`, including sentences without a valid checksum."""
    for match in SENTENCE.finditer(data):
        if (kind := kind_of(match[1].decode().split(",", 2))) in KINDS:
            yield Sentence(match.start(), kind, fields_of(match[0]) or [], match[0].decode())


def kind_of(fields: list[str]) -> str:
    """Return the type of a sentence: its name without talker identifier, or manufacturer and subtype (`PTNL,AVR`)."""
    name = fields[0]
    if name in ("PTNL", "PSTI", "PSAT") or (name == "PASHR" and fields[1][:1].isalpha()):
        return ",".join(fields[:2])
    return name if name.startswith("P") or name == "KSXT" else name[2:]


def _gga(fields: list[str]) -> Quantities:
    quality = _number(fields[6])
    return {"quality": quality} | (_place(fields[2:6]) if quality != NO_FIX else {})


def _gns(fields: list[str]) -> Quantities:
    quality = next((number for letter, number in BEST_FIRST.items() if letter in fields[6]), NO_FIX)
    return {"quality": quality} | (_place(fields[2:6]) if quality != NO_FIX else {})


def _rmc(fields: list[str]) -> Quantities:
    return _place(fields[3:7]) | _motion(fields[7], fields[8]) if fields[2] == "A" else {}


def _gll(fields: list[str]) -> Quantities:
    return _place(fields[1:5]) if fields[6] == "A" else {}


def _vtg(fields: list[str]) -> Quantities:
    if fields[2:3] == ["T"]:
        return _motion(fields[5], fields[1])
    return _motion(fields[3], fields[1])  # before NMEA 2.3 the sentence contained no units


def _ksxt(fields: list[str]) -> Quantities:
    quality = KSXT_QUALITY[int(fields[10] or 0)]
    found: Quantities = {"quality": quality}
    if quality != NO_FIX:
        place = {"longitude": _number(fields[2]), "latitude": _number(fields[3])}
        found |= place | {"speed": _number(fields[8]) / 3.6, "course": from_compass(_number(fields[7]))}
    return found | (_heading(fields[5]) if fields[11] == "3" else {})


def _board(fields: list[str]) -> Quantities:
    if (position := read_position(sentence(*fields))) is None:
        raise ValueError(fields[0])
    s, a = position.solution, position.attitude
    place = {"latitude": s.latitude, "longitude": s.longitude} if s.quality != NO_FIX else {}
    return {"quality": s.quality, "speed": s.speed, "heading": a.yaw, "roll": a.roll, **place}


def _place(fields: list[str]) -> Quantities:
    """Return latitude and longitude [deg], or an empty mapping if the fields are empty."""
    if not (fields[0] and fields[2]):
        return {}
    return {"latitude": degrees_of(*fields[:2]), "longitude": degrees_of(*fields[2:])}


def _motion(knots: str, course: str) -> Quantities:
    return {"speed": _number(knots) / KNOTS, "course": from_compass(_number(course))}


def _heading(text: str) -> Quantities:
    return {"heading": from_compass(_number(text))}


def _heading_in(field: int, valid: Condition = lambda fields: True) -> Callable[[list[str]], Quantities]:
    """Return a function that reads a heading from the given field of a sentence, if the sentence is valid."""
    return lambda fields: _heading(fields[field]) if valid(fields) else {}


def _number(text: str) -> float:
    return float(text) if text else nan


class Kind(NamedTuple):
    """Definition of a supported sentence type."""

    quantities: Callable[[list[str]], Quantities]
    """Function that converts the fields to quantities. Missing values are NaN. Raises ValueError or IndexError."""
    time: int = 1  # Index of the field that contains the time of day, or 0 if there is none


KINDS = {
    "GGA": Kind(_gga),
    "GNS": Kind(_gns),
    "RMC": Kind(_rmc),
    "GLL": Kind(_gll, 5),
    "KSXT": Kind(_ksxt),
    "PANDA": Kind(_board),
    "PAOGI": Kind(_board),
    "VTG": Kind(_vtg, 0),
    "HDT": Kind(_heading_in(1), 0),
    "THS": Kind(_heading_in(1, lambda fields: fields[2] != "V"), 0),
    "HPR": Kind(_heading_in(2, lambda fields: fields[5] == str(RTK_FIX))),
    "PASHR": Kind(_heading_in(2, lambda fields: fields[3] == "T")),
    "PTNL,AVR": Kind(_heading_in(3, lambda fields: fields[4] == "Yaw" and fields[-3] == "3"), 2),
    "PSAT,HPR": Kind(_heading_in(3, lambda fields: fields[6] in ("N", "G")), 2),
    "PSTI,036": Kind(_heading_in(4, lambda fields: fields[7] == "R"), 2),
}
"""Supported sentence types, by name without the talker identifier."""
