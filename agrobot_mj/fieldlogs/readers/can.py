"""Logs of a CAN bus as text: candump, the CSV of python-can, and the serial output of an Arduino with an MCP2515.

Which quantities are found is in `pgn`: among them the steering wheel and the curvature that the steering reports
(PGN 44032), speeds, and positions of NMEA 2000 in single frames.
"""

import re
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple

from agrobot_mj.fieldlogs.columns import FieldLogError
from agrobot_mj.fieldlogs.readers.base import Head, LogReader, ReadLog, Samples, text_lines
from agrobot_mj.fieldlogs.readers.pgn import SIGNALS, signals_of

ERROR_FRAME = 0x20000000
"""Bit of an identifier in candump's logs that marks a report of the controller."""
IDENTIFIER = 0x1FFFFFFF
BINARY = {b"LOGG": "BLF", b"date ": "ASC", b";$FILEVERSION": "TRC", b"MDF ": "MF4"}
"""Beginnings of logs that python-can converts."""


class Dialect(NamedTuple):
    """One way to write a frame in a line."""

    line: re.Pattern[str]
    """Groups: time, identifier in hex, data."""
    data: Callable[[str], bytes]
    per_second: float
    """Units of time in a second."""


def _decimals(text: str) -> bytes:
    return bytes(map(int, text.split(";")[:-1]))


STAMP, FRAME = r"\((\d+\.\d+)\) +\S+ +", "([0-9A-Fa-f]{3,8})"
DIALECTS = (
    Dialect(re.compile(STAMP + FRAME + r"#(?:#[0-9A-Fa-f])?([0-9A-Fa-f]*)(?: [RT])?"), bytes.fromhex, 1.0),
    Dialect(re.compile(STAMP + r"(?:[RT]X\S* +\S+ +)?" + FRAME + r" +\[\d+\]((?: +[0-9A-F]{2})*)"), bytes.fromhex, 1.0),
    Dialect(re.compile(r"(\d+\.?\d*),0x([0-9A-Fa-f]+),[01],[01],[01],\d+,([\w+/=]*)"), b64decode, 1.0),
    Dialect(re.compile(r"(?:[\d:.]+ -> )?(\d+); ID;([0-9A-F]+) Data;((?:\d+;)*)"), _decimals, 1e3),
)
"""candump -L, candump -t on a screen, python-can's CSV, and `ms; ID;hex Data;bytes;` behind a terminal's stamp."""


class CanText(LogReader):
    """CAN frames as candump, python-can or a serial sniffer write them: curvature, steering wheel, speeds, position."""

    kind: Literal["can"] = "can"

    def recognises(self, head: Head) -> bool:
        """Whether some of the first lines are frames, or the file is one that python-can converts."""
        return head.data.startswith(tuple(BINARY)) or _dialect(head.lines) is not None

    def read(self, path: Path) -> ReadLog:
        """Signals of the frames that are known."""
        with path.open("rb") as stream:
            start = stream.read(65536)
        if kind := next((name for mark, name in BINARY.items() if start.startswith(mark)), ""):
            raise FieldLogError(
                f"{path.name}: is a {kind} log; convert it: python -m can.logconvert {path.name} {path.stem}.log"
            )
        dialect = _dialect(Head(path, start).lines)
        if dialect is None:
            raise FieldLogError(f"{path.name}: holds no CAN frames")
        samples, begun = Samples(path), False
        for number, line in enumerate(text_lines(path), 1):
            found = dialect.line.fullmatch(line.strip())
            try:
                if found is None:
                    raise ValueError(line)
                t, identifier, data = float(found[1]) / dialect.per_second, int(found[2], 16), dialect.data(found[3])
            except ValueError:
                if begun:
                    samples.damaged(number, line)
                continue
            begun = True
            if identifier & ERROR_FRAME:
                continue
            source, signals = signals_of(identifier & IDENTIFIER)
            values = {s.quantity: value for s in signals if (value := s.of_frame(data)) is not None}
            samples.add(t, source, **values)
        groups = ", ".join(map(str, SIGNALS))
        return samples.log(f"signals that are known (parameter groups {groups})")


def _dialect(lines: list[str]) -> Dialect | None:
    """The dialect of the most of these lines."""
    counts = {k: sum(d.line.fullmatch(line.strip()) is not None for line in lines) for k, d in enumerate(DIALECTS)}
    best = max(counts, key=lambda k: counts[k])
    return DIALECTS[best] if counts[best] else None
