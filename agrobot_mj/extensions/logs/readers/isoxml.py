"""Reader for ISO 11783-10 task data: time logs in a folder, in a zip archive, or a single TLGnnnnn.XML.

A time log is a pair of files. The XML file describes the records: an attribute without a value is stored in every
record of the .BIN file; an attribute with a value is constant. A record contains the time [ms of the day, days since
1980], the position [1e-7 deg], the position status (numbered as the quality of GGA), and the process values that have
changed. The data dictionary of the standard defines a speed, but no wheel angle or heading of a tractor. A log may also
contain the bus signals `can.SIGNALS`, such as the curvature reported by the steering. Bus signals are stored as counts
without offset when they change.
"""

import re
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from struct import Struct, error
from typing import Literal, NamedTuple
from xml.etree import ElementTree

from agrobot_mj.core.resources import ZIP_ERRORS
from agrobot_mj.core.table_columns import FieldLogError, check_size
from agrobot_mj.extensions.logs.readers.base import DAY_S, Head, LogReader, ReadLog, Samples
from agrobot_mj.extensions.logs.readers.can import SIGNALS, BusSignal
from agrobot_mj.extensions.logs.series import LATE_S

TASKDATA = "TASKDATA.XML"
TIME_LOG = re.compile(r"(TLG\d{5})\.XML")
FIELDS = {"A": "i", "B": "i", "C": "i", "D": "B", "E": "H", "F": "H", "G": "B", "H": "I", "I": "H"}
"""Binary formats of the position attributes A to I: north, east, up, status, PDOP, HDOP, satellites, UTC time, date."""
SPEED, ON_BUS = 397, 0xDFFE
"""Data dictionary identifiers of the actual speed [mm/s], and of a bus signal defined by further attributes."""
DEGREES = 1e-7  # Angle per count of latitude and longitude [deg]
FAILED, NOT_AVAILABLE = 14, 15
"""Values of the position status without an equivalent GGA quality. All lower values equal the GGA quality."""
MOST_ZIP_BYTES, MOST_XML_BYTES, MOST_BIN_BYTES = 100_000_000, 20_000_000, 100_000_000
"""Maximum sizes of a zip archive, of an XML file, and of all binary files together [bytes]."""
MOST_FILES = 10_000  # Maximum number of files in a zip archive
Open = Callable[[int], bytes]
"""Type of functions that return the content of a file. The argument is the maximum accepted size [bytes]."""


class TaskData(LogReader):
    """Reader for time logs in ISO 11783-10 task data: position, position status, speed and bus signals."""

    kind: Literal["isoxml"] = "isoxml"

    def recognises(self, head: Head) -> bool:
        """Return whether the path is task data: TASKDATA.XML, a folder or archive with this file, or a time log."""
        if head.path.is_dir():
            return any(each.name.upper() == TASKDATA for each in head.path.iterdir())
        if head.data.startswith(b"PK\3\4"):
            return TASKDATA.encode() in head.data.upper() or _zip_has_taskdata(head.path)
        return b"<ISO11783_TaskData" in head.data or (b"<TIM" in head.data and b"<PTN" in head.data)

    def read(self, path: Path) -> ReadLog:
        """Return the values of all time logs in chronological order. Logs are read up to the first damaged record."""
        files = _files(path)
        samples, notes, left = Samples(path, ordered=False), list[str](), MOST_BIN_BYTES
        for name in sorted(each[1] for key in files if (each := TIME_LOG.fullmatch(key))):
            if (binary := files.get(f"{name}.BIN")) is None:
                notes.append(f"{name}.BIN is missing")
                continue
            data = binary(left)
            left -= len(data)
            try:
                layout = _layout(name, files[f"{name}.XML"](MOST_XML_BYTES))
            except FieldLogError as problem:
                notes.append(str(problem))
                continue
            end = 0
            for record in layout.records(data):
                end = record.end
                samples.add(record.t, "", **record.position)
                for source, signal in record.signals.items():
                    samples.add(record.t, source, **signal)
            if end < len(data):
                notes.append(f"{name} is damaged after {end} of {len(data)} bytes; only the undamaged part is used")
        return samples.log("time log with positions", *notes)


class Record(NamedTuple):
    """Decoded record of a time log: time, position and bus signals."""

    t: float  # Local time since 1980 [s]
    position: dict[str, float]
    signals: dict[str, dict[str, float]]  # Latest values of the bus signals, by source and quantity
    end: int  # Offset of the next record in the file [bytes]


class Layout(NamedTuple):
    """Layout of the binary records of a time log."""

    head: Struct
    keys: tuple[str, ...]  # Position attributes that each record contains
    fixed: dict[str, int]  # Values of the position attributes that are constant, by key
    known: dict[int, tuple[str, BusSignal]]
    """Source and signal of each known process value, keyed by the number of the process value in the XML file."""
    values: int  # Number of process values

    def records(self, data: bytes) -> Iterator[Record]:
        """Yield the records up to the first incomplete or invalid record. A signal keeps its value until it changes."""
        at, last, held = 0, 0.0, dict[str, dict[str, float]]()
        while at < len(data):
            try:
                millis, days, *position = self.head.unpack_from(data, at)
                at += self.head.size
                count = data[at]
                at += 1
                for number, value in (ENTRY.unpack_from(data, at + ENTRY.size * k) for k in range(count)):
                    if number >= self.values:
                        return
                    if number in self.known:
                        source, signal = self.known[number]
                        held.setdefault(source, {})[signal.quantity] = signal.of_counts(value)
            except (error, IndexError):
                return
            at += ENTRY.size * count
            t = millis / 1000 + days * DAY_S
            if t < last - LATE_S or millis > 1000 * DAY_S:
                return
            last = t
            place = self._position(dict(zip(self.keys, position, strict=True)) | self.fixed)
            yield Record(t, place, held, at)

    @staticmethod
    def _position(fields: dict[str, int]) -> dict[str, float]:
        quality = fields.get("D", NOT_AVAILABLE)
        found: dict[str, float] = {"quality": quality} if quality < FAILED else {}
        if quality not in (0, FAILED) and {"A", "B"} <= fields.keys():
            latitude, longitude = DEGREES * fields["A"], DEGREES * fields["B"]
            if abs(latitude) <= 90 and abs(longitude) <= 180:
                found |= {"latitude": latitude, "longitude": longitude}
        return found


ENTRY = Struct("<Bi")  # Binary format of a process value in a record: number and value


def _layout(name: str, data: bytes) -> Layout:
    """Return the record layout defined by the XML file of a time log. Raises `FieldLogError` for invalid XML."""
    where = f"{name}.XML"
    if b"<!" in data.replace(b"\0", b"").replace(b"<!--", b""):
        raise FieldLogError(f"{where}: the file declares a document type or entities; remove the declaration")
    try:
        tree = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as problem:
        raise FieldLogError(f"{where}: the file is not valid XML: {problem}") from None
    position = tree.find("PTN")
    attributes = dict(position.attrib) if position is not None else {}
    keys = tuple(key for key in FIELDS if attributes.get(key) == "")
    try:
        fixed = {key: _counts(key, text) for key, text in attributes.items() if text and key in ("A", "B", "D")}
        values = tree.findall("DLV")
        signals = [_signal(int(each.get("A", ""), 16), each) for each in values]
    except (ValueError, OverflowError) as problem:
        raise FieldLogError(f"{where}: {problem}") from None
    known = {number: signal for number, signal in enumerate(signals) if signal}
    return Layout(Struct("<IH" + "".join(FIELDS[key] for key in keys)), keys, fixed, known, len(values))


def _signal(ddi: int, value: ElementTree.Element) -> tuple[str, BusSignal] | None:
    """Return source and signal of a process value with the identifier `ddi`, or None for an unknown value."""
    if ddi == SPEED:
        return f"DDI {SPEED}", BusSignal("speed", 0, 32, True, 1e-3)
    if ddi != ON_BUS:
        return None
    group, first, last = (int(value.get(key) or -1) for key in "DEF")
    signals = SIGNALS.get(group, ())
    return next(((f"PGN {group}", s) for s in signals if (s.start, s.start + s.bits - 1) == (first, last)), None)


def _counts(key: str, text: str) -> int:
    return int(text) if key == "D" else round(float(text) / DEGREES)


def _files(path: Path) -> dict[str, Open]:
    """Return functions that read the task data files, keyed by upper-case file name. Raises `FieldLogError` for a
    damaged archive."""
    if path.is_file():
        with path.open("rb") as stream:
            if stream.read(4) == b"PK\3\4":
                return _in_zip(path)
    folder = path if path.is_dir() else path.parent
    files = {each.name.upper(): partial(_read_bytes, each) for each in folder.iterdir() if each.is_file()}
    alone = TIME_LOG.fullmatch(path.name.upper())
    return {key: each for key, each in files.items() if not alone or key.startswith(f"{alone[1]}.")}


def _read_bytes(path: Path, most: int) -> bytes:
    check_size(path, most)
    return path.read_bytes()


def _zip_has_taskdata(path: Path) -> bool:
    try:
        return bool(_task_folders(_entries(path)))
    except FieldLogError:
        return False


def _entries(path: Path) -> list[zipfile.ZipInfo]:
    check_size(path, MOST_ZIP_BYTES)
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (ValueError, *ZIP_ERRORS) as problem:
        raise FieldLogError(f"{path.name}: the file is not a valid zip archive: {problem}") from None
    if len(entries) > MOST_FILES:
        raise FieldLogError(f"{path.name}: the archive has {len(entries)} files, more than {MOST_FILES}; remove some")
    return entries


def _task_folders(entries: list[zipfile.ZipInfo]) -> list[str]:
    names = (each.filename for each in entries)
    return [name[: -len(TASKDATA)] for name in names if name.upper().rpartition("/")[2] == TASKDATA]


def _in_zip(path: Path) -> dict[str, Open]:
    entries = _entries(path)
    sets = _task_folders(entries)
    if len(sets) > 1:
        raise FieldLogError(f"{path.name}: the archive has {len(sets)} TASKDATA.XML files; unpack and use only one")
    found = dict[str, Open]()
    for each in entries:
        if each.filename.startswith(tuple(sets)) and not each.is_dir():
            name = each.filename.removeprefix(sets[0]).upper()
            if name in found:
                raise FieldLogError(f"{path.name}: the archive contains {name} twice; create the archive again")
            found[name] = partial(_unpack, path, each)
    return found


def _unpack(path: Path, entry: zipfile.ZipInfo, most: int) -> bytes:
    where = f"{path.name}: {entry.filename}"
    if entry.file_size > most:
        size = f"{entry.file_size / 1e6:.3g} MB when unpacked, but the limit is {most / 1e6:g} MB"
        raise FieldLogError(f"{where}: the file has {size}; split the recording")
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(entry)
    except ZIP_ERRORS as problem:
        raise FieldLogError(f"{where}: cannot be unpacked: {problem}") from None
