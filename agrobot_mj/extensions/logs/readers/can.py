"""Reader for text logs of a CAN bus: candump, CSV of python-can, and serial output of an Arduino with an MCP2515.

`SIGNALS` contains the supported signals by parameter group number (PGN). Examples are the steering-wheel angle, the
curvature reported by the steering (PGN 44032), speeds, and NMEA 2000 positions in single frames.

Signals are defined in ISO 11783-7, SAE J1939-71 and NMEA 2000. Curvatures and yaw rates of ISO 11783 and NMEA 2000 are
right positive. Steering-wheel angles and yaw rates of J1939 are left positive. Courses and headings are clockwise.
"""

import re
from base64 import b64decode
from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Literal, NamedTuple

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.readers.base import Head, LogReader, ReadLog, Samples, text_lines

REVERSE_BITS = 56  # Bit index in ISO 11783-7 speed messages of the first of two bits that are 0 in reverse


class BusSignal(NamedTuple):
    """Definition of a signal in a CAN message."""

    quantity: str
    start: int  # Index of the first bit of the value, counted from the lowest bit of the first byte
    bits: int
    signed: bool
    scale: float  # SI units per count, with the sign that makes values left positive
    offset: float = 0.0  # Value at count 0 [SI], with the sign of `scale`
    compass: bool = False  # Whether the value is an angle clockwise from north
    directed: bool = False  # Whether the message also contains the direction of travel

    def of_counts(self, counts: float) -> float:
        """Convert a count to a value in SI units without the offset of the signal, which ISO 11783-10 logs omit."""
        value = self.scale * counts
        return wrap(pi / 2 - value) if self.compass else value

    def of_frame(self, data: bytes) -> float | None:
        """Return the value [SI] in the bytes of a message, or None if the value is unavailable or bytes are missing."""
        if 8 * len(data) < self.start + self.bits:
            return None
        frame = int.from_bytes(data, "little")
        counts = (frame >> self.start) & ((1 << self.bits) - 1)
        if self.signed:
            counts -= (counts >> (self.bits - 1)) << self.bits
            available = counts < (1 << (self.bits - 1)) - 3
        else:
            available = counts >> (self.bits - 8) < 0xFB
        if not available:
            return None
        back = self.directed and len(data) == 8 and not (frame >> REVERSE_BITS) & 3
        return (-1 if back else 1) * (self.of_counts(counts) + self.offset)


SIGNALS: dict[int, tuple[BusSignal, ...]] = {
    44032: (BusSignal("curvature", 0, 16, False, -0.25e-3, 8.032),),
    65096: (BusSignal("wheel_speed", 0, 16, False, 1e-3, directed=True),),
    65097: (BusSignal("speed", 0, 16, False, 1e-3, directed=True),),
    61474: (BusSignal("speed", 0, 16, False, 1e-3, directed=True),),
    65265: (BusSignal("wheel_speed", 8, 16, False, 1 / 256 / 3.6),),
    65256: (
        BusSignal("course", 0, 16, False, pi / 180 / 128, compass=True),
        BusSignal("speed", 16, 16, False, 1 / 256 / 3.6),
    ),
    61449: (
        BusSignal("steering_wheel", 0, 16, False, 1 / 1024, -32127 / 1024),
        BusSignal("yaw_rate", 24, 16, False, 1 / 8192, -32127 / 8192),
    ),
    65267: (BusSignal("latitude", 0, 32, False, 1e-7, -210.0), BusSignal("longitude", 32, 32, False, 1e-7, -210.0)),
    127250: (BusSignal("heading", 8, 16, False, 1e-4, compass=True),),
    127251: (BusSignal("yaw_rate", 8, 32, True, -1e-6 / 32),),
    127257: (BusSignal("roll", 40, 16, True, 1e-4),),
    129025: (BusSignal("latitude", 0, 32, True, 1e-7), BusSignal("longitude", 32, 32, True, 1e-7)),
    129026: (BusSignal("course", 16, 16, False, 1e-4, compass=True), BusSignal("speed", 32, 16, False, 1e-2)),
}
"""Definitions of the supported signals by parameter group number."""
OWN_SIGNALS: dict[int, tuple[BusSignal, ...]] = {0x301: (BusSignal("steering_wheel", 0, 16, True, -2 * pi / 4096),)}
"""Signals by 11-bit identifier: steering wheel of a Massey Ferguson 7720, 4096 counts per revolution (measured)."""


def signals_of(identifier: int) -> tuple[str, tuple[BusSignal, ...]]:
    """Return the name and the signals of a message with a CAN identifier. Unknown messages have no signals."""
    if identifier < 0x800:
        return f"frame {identifier:03X}", OWN_SIGNALS.get(identifier, ())
    group = (identifier >> 8) & 0x3FFFF
    if (group >> 8) & 0xFF < 240:
        group &= 0x3FF00  # the low byte is the destination address
    return f"PGN {group} of {identifier & 0xFF:02X}", SIGNALS.get(group, ())


ERROR_FRAME = 0x20000000  # Identifier bit in candump logs that marks an error frame, which the CAN controller generates
IDENTIFIER = 0x1FFFFFFF
BINARY = {b"LOGG": "BLF", b"date ": "ASC", b";$FILEVERSION": "TRC", b"MDF ": "MF4"}
"""Names of log formats that the user can convert with python-can, by first bytes of the file."""


class Dialect(NamedTuple):
    """Text format with one CAN frame per line."""

    line: re.Pattern[str]  # Pattern of a line, with groups for time, hexadecimal identifier and data
    data: Callable[[str], bytes]
    per_second: float  # Number of time units per second


def _decimals(text: str) -> bytes:
    return bytes(map(int, text.split(";")[:-1]))


STAMP, FRAME = r"\((\d+\.\d+)\) +\S+ +", "([0-9A-Fa-f]{3,8})"
DIALECTS = (
    Dialect(re.compile(STAMP + FRAME + r"#(?:#[0-9A-Fa-f])?([0-9A-Fa-f]*)(?: [RT])?"), bytes.fromhex, 1.0),
    Dialect(re.compile(STAMP + r"(?:[RT]X\S* +\S+ +)?" + FRAME + r" +\[\d+\]((?: +[0-9A-F]{2})*)"), bytes.fromhex, 1.0),
    Dialect(re.compile(r"(\d+\.?\d*),0x([0-9A-Fa-f]+),[01],[01],[01],\d+,([\w+/=]*)"), b64decode, 1.0),
    Dialect(re.compile(r"(?:[\d:.]+ -> )?(\d+); ID;([0-9A-F]+) Data;((?:\d+;)*)"), _decimals, 1e3),
)
"""Text formats: candump -L, screen output of candump -t, CSV of python-can, serial `ms; ID;hex Data;bytes;`."""


class CanText(LogReader):
    """Reader for text logs of CAN frames (candump, python-can, sniffer): curvature, steering, speeds and position."""

    kind: Literal["can"] = "can"

    def recognises(self, head: Head) -> bool:
        """Return whether the first lines contain CAN frames, or the file has a format that python-can converts."""
        return head.data.startswith(tuple(BINARY)) or _dialect(head.lines) is not None

    def read(self, path: Path) -> ReadLog:
        """Return the values of all known signals. Raises `FieldLogError` for a file that needs conversion first."""
        with path.open("rb") as stream:
            start = stream.read(65536)
        if kind := next((name for mark, name in BINARY.items() if start.startswith(mark)), ""):
            raise FieldLogError(
                f"{path.name}: this is a {kind} log; convert it with: python -m can.logconvert {path.name} "
                f"{path.stem}.log"
            )
        dialect = _dialect(Head(path, start).lines)
        if dialect is None:
            raise FieldLogError(f"{path.name}: the log contains no CAN frames")
        samples, begun = Samples(path), False
        for number, line in enumerate(text_lines(path), 1):
            found = dialect.line.fullmatch(line.strip())
            try:
                if found is None:
                    raise ValueError(line)
                t, identifier, data = float(found[1]) / dialect.per_second, int(found[2], 16), dialect.data(found[3])
            except ValueError:
                if begun:
                    samples.count_damaged(number, line)
                continue
            begun = True
            if identifier & ERROR_FRAME:
                continue
            source, signals = signals_of(identifier & IDENTIFIER)
            values = {s.quantity: value for s in signals if (value := s.of_frame(data)) is not None}
            samples.add(t, source, **values)
        groups = ", ".join(map(str, SIGNALS))
        return samples.log(f"known signals (parameter groups {groups})")


def _dialect(lines: list[str]) -> Dialect | None:
    """Return the text format that most lines have, or None if no line has a known format."""
    counts = {k: sum(d.line.fullmatch(line.strip()) is not None for line in lines) for k, d in enumerate(DIALECTS)}
    best = max(counts, key=lambda k: counts[k])
    return DIALECTS[best] if counts[best] else None
