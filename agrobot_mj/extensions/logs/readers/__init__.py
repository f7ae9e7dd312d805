"""Readers for logs of other programs and machines, one per format. The list `READERS` contains all readers.

`open_log` selects a reader by the content of a file and returns the result of this reader. A user-defined reader is a
class derived from `LogReader`, registered like any other component. User-defined readers take precedence over the
readers of the package.
"""

from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import pyarrow as pa

from agrobot_mj.core.contracts import one_line
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import absence
from agrobot_mj.core.table_columns import CONTROL, FieldLogError, Source, check_size, column_names, load_table
from agrobot_mj.extensions.logs.maps import UNKNOWN, LogMap, known_map, lacking, si_tables
from agrobot_mj.extensions.logs.readers.agopenweb import AgOpenWebRecorder
from agrobot_mj.extensions.logs.readers.base import HEAD_BYTES, QUANTITIES, Head, LogReader, ReadLog, Samples
from agrobot_mj.extensions.logs.readers.can import CanText
from agrobot_mj.extensions.logs.readers.isoxml import TaskData
from agrobot_mj.extensions.logs.readers.mcap import Ros2Bag
from agrobot_mj.extensions.logs.readers.nmea import NmeaText
from agrobot_mj.extensions.logs.readers.own import FreeColumns, LinkRecord, RunFolder
from agrobot_mj.extensions.logs.readers.sentences import found_in
from agrobot_mj.extensions.logs.readers.timed import TimedLines

READERS = LogReader.registry  # All readers in the order in which they are tried, the most specific first
READERS += [RunFolder(), LinkRecord(), AgOpenWebRecorder(), TaskData(), Ros2Bag(), TimedLines(), NmeaText(), CanText()]
READERS += [FreeColumns()]


class OpenedLog(NamedTuple):
    """Content of a log, with its column map and notes."""

    name: str
    reader: str  # Name of the format, from the attribute `kind` of the reader
    source: Source
    """Table in SI units, or the path of the file if a column map must define its columns."""
    notes: tuple[str, ...]  # Notes about data that were selected or omitted
    log_map: LogMap | None  # Map of the columns, or None if the columns are unknown or insufficient for a replay
    missing: str  # Text that names the quantities missing for a replay, identification or calibration, or ""
    tables: dict[str, dict[str, Any]]
    """Column-map tables for the known columns, as a template for a user-defined map. Empty for arbitrary columns."""

    def checked_map(self) -> LogMap:
        """Return `log_map`. Raises `FieldLogError` with the missing quantities if `log_map` is None."""
        if self.log_map is None:
            raise FieldLogError(
                f"{self.name}: {self.missing}; `agrobot-mj twin --describe` lists the content of the log"
            )
        return self.log_map


def open_log(path: Path) -> OpenedLog:
    """Read a file or folder with the first reader that recognises it. Raises `FieldLogError` for unreadable or unknown
    content, and `ScenarioError` for a faulty user-defined reader."""
    head = _head(path)
    if head.data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return _of_utf16(path)
    for reader in READERS:
        if reader.recognises(head):
            return _opened_log(path, reader.kind, _check_result(reader, reader.read(path)))
    raise FieldLogError(f"{path if path.is_dir() else path.name}: {_reason(head)}")


def _of_utf16(path: Path) -> OpenedLog:
    """Read a log in UTF-16 by converting a temporary copy to UTF-8."""
    check_size(path)
    with TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        with (
            path.open(encoding="utf-16", errors="replace", newline="") as text,
            copy.open("w", encoding="utf-8", newline="") as out,
        ):
            copyfileobj(text, out)
        found = open_log(copy)
        return found._replace(source=load_table(found.source))


def _reason(head: Head) -> str:
    """Return an error text: the reason why no reader recognises a file or folder, with a remedy."""
    name = head.path.name
    if head.path.is_dir():
        return "the folder has neither signals.parquet nor TASKDATA.XML; specify a log or the folder of a run"
    if next(found_in(head.data), None):
        return "the NMEA sentences have no valid checksum; enable checksums in the receiver"
    if (kind := head.text_type) and (kind != "GeoJSON" or b'"coordinates"' in head.data):
        return (
            f"{kind} files contain no wheel angle and no speed; use the file as a path, with --set path.kind=waypoints "
            f"--set path.file={name}, or record a log (docs/extensions/logs/record.md)"
        )
    if b"\x1b[" in head.data:
        return "the file is a recording of a terminal screen; record the output of the receiver (gpspipe -r)"
    if CONTROL.search(head.data.decode(errors="replace")):
        return "the file is binary, of an unknown format; record NMEA, or convert it to CSV"
    kinds = ", ".join(reader.kind for reader in READERS if not isinstance(reader, NmeaText))
    nmea = "the start of the file contains no NMEA sentence with a valid checksum"
    return f"{nmea} and matches no other known format ({kinds}); export the log as CSV in UTF-8 with a header line"


def _head(path: Path) -> Head:
    if path.is_dir():
        return Head(path, b"")
    if not path.is_file():
        raise FieldLogError(f"{path}: {absence(path)}")
    try:
        with path.open("rb") as stream:
            return Head(path, stream.read(HEAD_BYTES))
    except OSError as error:
        raise FieldLogError(f"{path}: {error.strerror}") from None


def _opened_log(path: Path, kind: str, found: ReadLog) -> OpenedLog:
    names, tables = column_names(found.source), dict[str, dict[str, Any]]()
    log_map, missing = known_map(names), UNKNOWN
    if isinstance(found.source, pa.Table):
        tables = si_tables(names, found.meaning)
        missing = lacking(tables, names)
        log_map = None if missing else LogMap.model_validate(tables)
    return OpenedLog(path.name, kind, found.source, found.notes, log_map, "" if log_map else missing, tables)


def _check_result(reader: LogReader, found: ReadLog) -> ReadLog:
    """Return the result of a reader unchanged. Raises `ScenarioError` if the result has a wrong type."""
    whole = isinstance(found, ReadLog) and isinstance(found.source, pa.Table | Path)
    if not whole or (isinstance(found.source, pa.Table) and "t" not in found.source.column_names):
        wanted = "a ReadLog of a file, or of a table with a column t"
        raise ScenarioError(f"the reader ({reader.kind}): read must return {wanted}, got {one_line(found)}")
    return found


__all__ = ["QUANTITIES", "READERS", "Head", "LogReader", "OpenedLog", "ReadLog", "Samples", "open_log"]
