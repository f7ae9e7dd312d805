"""Readers for logs of other programs and machines, one per format. `READERS` is the registry.

`open_log` selects a reader by the content of the file, and returns its result. A user-defined reader is a class derived
from `LogReader`, registered like any other kind. It takes precedence over the readers of the package.
"""

from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from agrobot_mj.core.contracts import one_line
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import absence
from agrobot_mj.core.table_columns import FieldLogError, Source, column_names
from agrobot_mj.extensions.logs.maps import UNKNOWN, LogMap, known_map, lacking, si_tables
from agrobot_mj.extensions.logs.readers.agopenweb import AgOpenWebRecorder
from agrobot_mj.extensions.logs.readers.base import HEAD_BYTES, QUANTITIES, Head, LogReader, ReadLog, Samples
from agrobot_mj.extensions.logs.readers.can import CanText
from agrobot_mj.extensions.logs.readers.isoxml import TaskData
from agrobot_mj.extensions.logs.readers.mcap import Ros2Bag
from agrobot_mj.extensions.logs.readers.nmea import NmeaText
from agrobot_mj.extensions.logs.readers.own import CONTROL, FreeColumns, LinkRecord, RunFolder
from agrobot_mj.extensions.logs.readers.sentences import found_in
from agrobot_mj.extensions.logs.readers.timed import TimedLines

READERS = LogReader.registry  # All readers in the order in which they are tried, the most specific first
READERS += [RunFolder(), LinkRecord(), AgOpenWebRecorder(), TaskData(), Ros2Bag(), TimedLines(), NmeaText(), CanText()]
READERS += [FreeColumns()]


class OpenedLog(NamedTuple):
    """Log that has been read, with its properties."""

    name: str
    reader: str  # Kind of the reader that read the log
    source: Source
    """Texts of both ends of the interval, rounded to the same digit as the value."""
    notes: tuple[str, ...]  # Notes about data that were selected or omitted
    log_map: LogMap | None  # Map of the columns, if known and sufficient for a replay; otherwise None
    missing: str  # Text that names quantities missing for a replay, identification or calibration, or ""
    tables: dict[str, dict[str, Any]]
    """Map tables for the known columns, as a template for a user-defined map. Empty for free columns."""

    def checked_map(self) -> LogMap:
        """Return `log_map`. Without a map, raises a `FieldLogError` that names the missing quantities."""
        if self.log_map is None:
            raise FieldLogError(f"{self.name}: {self.missing}; twin --describe lists its content")
        return self.log_map


def open_log(path: Path) -> OpenedLog:
    """Read a file or folder with the first reader that recognises it. Raises `FieldLogError` or `ScenarioError`."""
    head = _head(path)
    for reader in READERS:
        if reader.recognises(head):
            return _opened(path, reader.kind, _checked(reader, reader.read(path)))
    if path.is_dir():
        raise FieldLogError(
            f"{path}: the folder has neither signals.parquet nor TASKDATA.XML; specify a log or the folder of a run"
        )
    if next(found_in(head.data), None):
        raise FieldLogError(f"{path.name}: the NMEA sentences have no valid checksum; enable checksums in the receiver")
    if head.data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FieldLogError(f"{path.name}: the text is in UTF-16; save it as UTF-8")
    if b"<gpx" in head.data or b"<kml" in head.data:
        raise FieldLogError(
            f"{path.name}: a track has no wheel angle and no speed; use it as a path, with --set path.kind=waypoints "
            f"--set path.file={path.name}, or record a log (docs/extensions/logs/record.md)"
        )
    if CONTROL.search(head.data):
        raise FieldLogError(f"{path.name}: the file is binary, of an unknown format; record NMEA, or convert it to CSV")
    kinds = ", ".join(reader.kind for reader in READERS)
    raise FieldLogError(
        f"{path.name}: the format is unknown (supported: {kinds}); export it as CSV in UTF-8 with a header line"
    )


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


def _opened(path: Path, kind: str, found: ReadLog) -> OpenedLog:
    names, tables = column_names(found.source), dict[str, dict[str, Any]]()
    log_map, missing = known_map(names), UNKNOWN
    if isinstance(found.source, pa.Table):
        tables = si_tables(names, found.meaning)
        missing = lacking(tables, names)
        log_map = None if missing else LogMap.model_validate(tables)
    return OpenedLog(path.name, kind, found.source, found.notes, log_map, "" if log_map else missing, tables)


def _checked(reader: LogReader, found: ReadLog) -> ReadLog:
    """Return the result of a reader. Raises `ScenarioError` if the result has a wrong type."""
    whole = isinstance(found, ReadLog) and isinstance(found.source, pa.Table | Path)
    if not whole or (isinstance(found.source, pa.Table) and "t" not in found.source.column_names):
        wanted = "a ReadLog of a file, or of a table with a column t"
        raise ScenarioError(f"the reader ({reader.kind}): read must return {wanted}, got {one_line(found)}")
    return found


__all__ = ["QUANTITIES", "READERS", "Head", "LogReader", "OpenedLog", "ReadLog", "Samples", "open_log"]
