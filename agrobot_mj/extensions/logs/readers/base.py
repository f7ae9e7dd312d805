"""Base class of log readers. A reader converts a file of another program to a table in SI units.

A reader recognises files by their content, independent of their names. It returns a column for each of the `QUANTITIES`
in the file, with a common time and null for missing values. `Samples` collects the values. Unreadable lines of text are
counted; too many such lines are an error.
"""

from array import array
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pyarrow as pa

from agrobot_mj.core.errors import shorten
from agrobot_mj.core.signals import Array, Column
from agrobot_mj.core.spec import Spec
from agrobot_mj.core.table_columns import NAME, FieldLogError, Source, check_size
from agrobot_mj.extensions.logs.series import LARGEST, LATE_S, RESTART_S, note_on_decreases
from agrobot_mj.paths.imports import text_type

QUANTITIES = (
    Column("t", "s", "time since the first value"),
    Column("latitude", "deg", "latitude of the antenna, north positive"),
    Column("longitude", "deg", "longitude of the antenna, east positive"),
    Column("east", "m", "position on a plane of the recording program"),
    Column("north", "m", "position on a plane of the recording program"),
    Column(
        "quality", "-", "quality of the position as in GGA: 0 none, 1 single, 2 differential, 4 RTK fixed, 5 RTK float"
    ),
    Column("speed", "m/s", "speed over ground; negative in reverse only if the program records the direction"),
    Column("wheel_speed", "m/s", "speed of the driven wheels"),
    Column("course", "rad", "course over ground, from east, counter-clockwise"),
    Column("heading", "rad", "heading of the body, from east, counter-clockwise"),
    Column("yaw_rate", "rad/s", "yaw rate, left positive"),
    Column("roll", "rad", "roll, left side up positive"),
    Column("steer", "rad", "measured wheel angle, left positive"),
    Column("steer_demand", "rad", "wheel angle commanded by the guidance, left positive"),
    Column("curvature", "1/m", "curvature that corresponds to the wheel angle, left positive"),
    Column("steering_wheel", "rad", "angle of the steering wheel, left positive"),
)
"""Quantities that a reader may return. Other numeric columns are also accepted."""
HEAD_BYTES = 65536  # Number of bytes at the start of a file from which its format is recognised [bytes]
LONGEST_LINE = 65536  # Maximum length of a line of text [bytes]
MOST_VALUES = 20_000_000  # Maximum number of values from one file; a value needs 16 bytes
MOST_DAMAGED = 0.2  # Fraction of unreadable lines above which a file is rejected as damaged [-]. Assumed value.
DAY_S = 86400.0


class Head(NamedTuple):
    """First bytes of a file, or a folder path, from which a reader recognises the format."""

    path: Path
    data: bytes  # First `HEAD_BYTES` of the file, or empty bytes for a folder

    @property
    def lines(self) -> list[str]:
        """Complete lines of text in `data`, without line ends."""
        text = self.data.decode("utf-8-sig", errors="replace").splitlines()
        return text[:-1] if len(self.data) == HEAD_BYTES else text

    @property
    def text_type(self) -> str:
        """Name of a text format that contains positions only, for example KML, or an empty string."""
        return text_type(self.data.decode("utf-8-sig", errors="replace"))


class ReadLog(NamedTuple):
    """Content of a log as returned by a reader."""

    source: Source  # Table with columns of `QUANTITIES`, or the file itself if a map must define its columns
    notes: tuple[str, ...] = ()  # Notes about data that were selected or omitted, one line each
    meaning: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
    """Keys of the column map whose values differ from the defaults, by table and key."""


class LogReader(Spec):
    """Base class of log readers, one for each format."""

    kind: str
    registry: ClassVar[list["LogReader"]] = []
    """All readers, in the order in which their format tests run."""

    def recognises(self, head: Head) -> bool:
        """Return whether a file or folder has the format of the reader."""
        raise NotImplementedError

    def read(self, path: Path) -> ReadLog:
        """Read a log file or folder. Raises `FieldLogError` if the log is damaged, too large or empty."""
        raise NotImplementedError


class Samples:
    """Values of a log with their times, collected by a reader."""

    def __init__(self, path: Path, ordered: bool = True) -> None:
        """Create an empty collection. If `ordered`, time may decrease at restarts. Otherwise values are sorted."""
        self.name, self._ordered = path.name, ordered
        self._latest, self._shift, self._decreases = dict[str, float](), 0.0, list[float]()
        self._kept: dict[str, dict[str, tuple[array[float], array[float]]]] = {}
        self._values, self._lines, self._damaged, self._first_damage = 0, 0, 0, ""

    def add(self, t: float, source: str = "", **values: float) -> None:
        """Add values by quantity at time `t` [s]. Absolute values of at least `LARGEST` are treated as missing.

        If several sources provide a quantity, the source with the most values is used. Raises `FieldLogError` for too
        many values.
        """
        t += self._shift
        if self._ordered and t < (latest := self._latest.get(source, t)) - LATE_S:
            self._decreases.append(latest - t)
            later = max(self._latest.values()) + RESTART_S - t
            self._latest, self._shift, t = {}, self._shift + later, t + later
        if isfinite(t):
            self._latest[source] = t
        for name, value in values.items():
            if abs(value) < LARGEST and isfinite(t):
                times, kept = self._kept.setdefault(name, {}).setdefault(source, (array("d"), array("d")))
                times.append(t)
                kept.append(value)
                self._values += 1
        self._lines += 1
        if self._values > MOST_VALUES:
            raise FieldLogError(f"{self.name}: the log has more than {MOST_VALUES:.3g} values; split the log")

    def count_damaged(self, line: int, text: str) -> None:
        """Count an unreadable line. The number and the text of the first unreadable line are kept for messages."""
        self._first_damage = self._first_damage or f"line {line}, {shorten(ascii(text.strip()), 60)}"
        self._damaged += 1

    def log(self, what: str, *notes: str, **meaning: dict[str, Any]) -> ReadLog:
        """Return a table of the collected values, with notes about omitted data.

        `what` names the expected content in errors. Raises `FieldLogError` for too many damaged lines or for no data.
        """
        if self._damaged > MOST_DAMAGED * (self._lines + self._damaged):
            raise FieldLogError(
                f"{self.name}: {self._damaged} of {self._lines + self._damaged} lines cannot be read (first: "
                f"{self._first_damage}); export the file again"
            )
        if not self._kept:
            raise FieldLogError("; ".join([f"{self.name}: the log contains no {what}", *notes[:3]]))
        found = list(notes)
        if self._decreases:
            found.append(note_on_decreases(self._decreases))
        if self._damaged:
            found.append(f"{self._damaged} damaged lines are omitted (first: {self._first_damage})")
        chosen = {name: max(parts, key=lambda each: len(parts[each][0])) for name, parts in self._kept.items()}
        for source in dict.fromkeys(filter(None, chosen.values())):
            found.append(f"from {source}: {', '.join(name for name, each in chosen.items() if each == source)}")
        for name, parts in self._kept.items():
            if others := [source for source in parts if source != chosen[name]]:
                found.append(f"{name} is also in {', '.join(others)}, with fewer values")
        columns = {name: _in_order(name, *self._kept[name][source]) for name, source in chosen.items()}
        return ReadLog(self._table(columns), tuple(found), meaning)

    def _table(self, columns: dict[str, tuple[Array, Array]]) -> pa.Table:
        start = min(t[0] for t, _ in columns.values())
        columns = {name: (np.round(t - start, 6), values) for name, (t, values) in columns.items()}
        times = np.unique(np.concatenate([t for t, _ in columns.values()]))
        known = {quantity.name: quantity for quantity in QUANTITIES}
        fields, arrays = [_field(known["t"])], [pa.array(times)]
        for name in [*filter(columns.__contains__, known), *(name for name in columns if name not in known)]:
            t, values = columns[name]
            column = np.full(len(times), np.nan)
            column[np.searchsorted(times, t)] = values
            fields.append(_field(known.get(name, Column(name, "", "of this reader"))))
            arrays.append(pa.array(column, from_pandas=True))
        return pa.table(arrays, schema=pa.schema(fields, metadata={NAME: self.name.encode()}))


def _in_order(name: str, times: "array[float]", kept: "array[float]") -> tuple[Array, Array]:
    """Return times and values of a quantity in order of time."""
    t, values = np.frombuffer(times, dtype=np.float64), np.frombuffer(kept, dtype=np.float64)
    order = np.argsort(t, kind="stable")
    # a sensor of one revolution restarts at zero
    return t[order], np.unwrap(values[order]) if name == "steering_wheel" else values[order]


def _field(quantity: Column) -> pa.Field:
    metadata = {"unit": quantity.unit, "description": quantity.description}
    return pa.field(quantity.name, pa.float64(), metadata=metadata)


def text_lines(path: Path) -> Iterator[str]:
    """Yield the lines of a text file with their line ends. Raises `FieldLogError` if the file or a line is too long."""
    check_size(path)
    with path.open("rb") as stream:
        number = 0
        while line := stream.readline(LONGEST_LINE + 1):
            number += 1
            if len(line) > LONGEST_LINE:
                raise FieldLogError(f"{path.name}: line {number} has more than {LONGEST_LINE} bytes; use a text file")
            yield line.decode("utf-8-sig" if number == 1 else "utf-8", errors="replace")


class DayClock:
    """Clock that converts times of day to a time that continues to increase after midnight."""

    def __init__(self) -> None:
        self.days, self.last = 0, -1.0

    def at(self, text: str) -> float:
        """Convert `hh:mm:ss.s` or `hhmmss.s` to seconds since the first midnight. Raises ValueError for other text."""
        digits = text.replace(":", "")
        hours, minutes, seconds = int(digits[:2]), int(digits[2:4]), float(digits[4:])
        if not (digits[:4].isdigit() and hours < 24 and minutes < 60 and 0 <= seconds < 61):
            raise ValueError(text)
        found = hours * 3600 + minutes * 60 + seconds
        if found < self.last - DAY_S / 2:
            self.days += 1
        self.last = found
        return found + self.days * DAY_S
