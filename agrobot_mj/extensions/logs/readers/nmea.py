"""Reader for NMEA 0183 text of a receiver or board: GGA, RMC, VTG, HDT, and PANDA and PAOGI of the AgOpenGPS family.

A time stamp of the logger may precede a sentence in its line; the time used is that of the receiver. VTG and HDT have
no time and get that of the preceding sentence. The speed is over ground, also positive in reverse.
"""

from math import inf, nan
from pathlib import Path
from typing import Literal

from agrobot_mj.core.agopengps.layouts import from_compass
from agrobot_mj.core.agopengps.position import read as read_position
from agrobot_mj.core.nmea import KNOTS, NO_FIX, degrees_of, fields_of
from agrobot_mj.extensions.logs.readers.base import DayClock, Head, LogReader, ReadLog, Samples, text_lines

KINDS = ("GGA", "RMC", "VTG", "HDT", "PANDA", "PAOGI")
"""Supported sentences, without the two letters of the talker."""


class NmeaText(LogReader):
    """NMEA sentences: position with quality, speed and course; heading if a sentence contains it."""

    kind: Literal["nmea"] = "nmea"

    def recognises(self, head: Head) -> bool:
        """Return whether one of the first lines contains a supported sentence with a valid checksum."""
        return any(_kind(_fields(line)) in KINDS for line in head.lines if "$" in line)

    def read(self, path: Path) -> ReadLog:
        """Return the values of all supported sentences; those with an invalid checksum are omitted and counted."""
        samples, clock, t = Samples(path), DayClock(), -inf
        for number, line in enumerate(text_lines(path), 1):
            if "$" not in line:
                continue
            fields = _fields(line)
            try:
                if not fields:
                    raise ValueError(line)
                if (kind := _kind(fields)) not in KINDS:
                    continue
                if kind not in ("VTG", "HDT") and fields[1]:
                    t = clock.at(fields[1])
                samples.add(t, kind, **_values(kind, fields, line))
            except (ValueError, IndexError):
                samples.damaged(number, line)
        return samples.log(f"sentences with a time and values ({', '.join(KINDS)})")


def _fields(line: str) -> list[str]:
    """Return the fields of the sentence in a line, name first; empty for an invalid checksum."""
    return fields_of(line[line.find("$") :].encode()) or []


def _kind(fields: list[str]) -> str:
    name = fields[0] if fields else ""
    return name if name.startswith("P") else name[2:]


def _values(kind: str, fields: list[str], line: str) -> dict[str, float]:
    """Return the quantities of a sentence, NaN for empty fields. Raises ValueError or IndexError if damaged."""
    match kind:
        case "GGA":
            quality = int(fields[6])
            return {"quality": quality} | (_place(fields[2:6]) if quality != NO_FIX else {})
        case "RMC":
            valid = fields[2] == "A"
            motion = {"speed": _number(fields[7]) / KNOTS, "course": from_compass(_number(fields[8]))}
            return (_place(fields[3:7]) | motion) if valid else {}
        case "VTG":
            return {"speed": _number(fields[5]) / KNOTS, "course": from_compass(_number(fields[1]))}
        case "HDT":
            return {"heading": from_compass(_number(fields[1]))}
    if (position := read_position(line[line.find("$") :].encode())) is None:
        raise ValueError(line)
    s, a = position.solution, position.attitude
    place = {"latitude": s.latitude, "longitude": s.longitude} if s.quality != NO_FIX else {}
    return {"quality": s.quality, "speed": s.speed, "heading": a.yaw, "roll": a.roll, **place}


def _place(fields: list[str]) -> dict[str, float]:
    return {"latitude": degrees_of(*fields[:2]), "longitude": degrees_of(*fields[2:])}


def _number(text: str) -> float:
    return float(text) if text else nan
