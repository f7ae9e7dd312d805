"""Columns of an external log (Parquet or CSV), read as floats; empty and infinite cells become NaN.

External files may contain invalid data: text, lists, milliseconds, decreasing times, or a hundred million rows. Sizes
are checked before reading, and only requested columns are read, one by one. Every problem raises a `ScenarioError` that
names the file, the column and the fix.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.resources import absence
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import UNPRINTABLE

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
MOST_ROWS = 5_000_000  # Maximum number of rows of a log: three days at 20 Hz
MOST_CSV_BYTES = 1_000_000_000  # Maximum size of a CSV file [bytes]
MOST_HEADER_BYTES = 1_000_000  # Maximum length of a CSV header line [bytes]
SHOWN = 24  # Maximum number of column names listed in a message
LONGEST_STEP_S = 5.0  # Median time step above which the times cannot be in seconds [s]; slower logs contain no dynamics
SAME_TIME = 1.5
"""Mean number of rows per time value [-] above which an error message recommends exporting more digits of the times."""
LATEST_STEP_S = 1e-5  # Median time step below which the times cannot be in seconds [s]
MOST_STEPS = 1e8
"""Maximum duration of a log divided by its median time step [-]: a year at 3 Hz. A log above this ratio is rejected."""
NAME = b"name"  # Key of the log's name in the table metadata
PARQUET = b"PAR1"  # First bytes of a Parquet file
CONTROL = re.compile(r"[\x00-\x08\x0e-\x1a]")  # Pattern of control characters, which do not occur in text files
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")  # Pattern of a number with a decimal comma
CLOCK = re.compile(r"(\d\d?):(\d\d):(\d\d(?:[.,]\d+)?)")  # Pattern of a time of day
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")  # Pattern of a finite number in a CSV cell


class FieldLogError(ScenarioError):
    """Error for an unusable log; the printable text names the file and the column."""

    def __init__(self, text: str = "") -> None:
        super().__init__(UNPRINTABLE.sub("?", text))


Source: TypeAlias = Path | pa.Table  # Source of a log: a Parquet or CSV file, or a table in memory


def column_names(source: Source) -> list[str]:
    """Return the column names of a log without reading its rows. Raises `FieldLogError` for an invalid file."""
    if isinstance(source, pa.Table):
        return list(source.column_names)
    if not source.is_file():
        raise FieldLogError(f"{source}: {absence(source, 'specify a .parquet or .csv file')}")
    if _is_parquet(source):
        try:
            return list(pq.read_schema(source.absolute()).names)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise FieldLogError(f"{source.name}: the file is not a valid Parquet file: {_first_line(error)}") from None
    return _header(source)[0]


def read_columns(source: Source, wanted: Sequence[str], why: dict[str, str] | None = None) -> dict[str, Array]:
    """Return columns of a log as arrays of floats with shape (n,). Empty cells are NaN, and clock times are in seconds.

    `why` names the scenario key that requests each column, for error messages. Raises `FieldLogError` if the file is
    unreadable, if a column is missing or contains no numbers, or if there are more than `MOST_ROWS` rows.
    """
    cells = _cells(source, wanted, why)
    return {column: _floats(source_name(source), column, cells(column)) for column in dict.fromkeys(wanted)}


def accepted_rows(source: Source, column: str, accepted: Sequence[int | str], why: str) -> Mask:
    """Return a mask (n,) of the rows whose cell in `column` is one of `accepted`. Raises the same errors as
    `read_columns`."""
    cells = _cells(source, [column], {column: why})(column)
    if not pa.types.is_string(cells.type):
        return np.isin(_floats(source_name(source), column, cells), [a for a in accepted if not isinstance(a, str)])
    return np.isin(np.array(cells.to_pylist(), dtype=object).astype(str), [str(a) for a in accepted])


def _cells(source: Source, wanted: Sequence[str], why: dict[str, str] | None) -> Callable[[str], pa.ChunkedArray]:
    """Return a function that reads the cells of each requested column. Raises the same errors as `read_columns`."""
    name, known = source_name(source), column_names(source)
    for column in wanted:
        if column not in known:
            shown = ", ".join(known[:SHOWN]) + (", ..." if len(known) > SHOWN else "")
            asked = f" ({why[column]})" if why and column in why else ""
            missing = f"there is no column {column!r}{asked}{suggestion(column, known)}"
            raise FieldLogError(f"{name}: {missing} (available: {shown})")
        if known.count(column) > 1:
            raise FieldLogError(f"{name}: there is more than one column {column!r}; rename all but one")
    cells: Callable[[str], pa.ChunkedArray]
    if isinstance(source, pa.Table):
        rows, cells = source.num_rows, source.column
    elif _is_parquet(source):
        rows, cells = pq.read_metadata(source.absolute()).num_rows, partial(_page, source)
    else:
        table = _csv(source, wanted)
        rows, cells = table.num_rows, table.column
    if not rows:
        raise FieldLogError(f"{name}: the file has column names but no rows; export the file again")
    if rows > MOST_ROWS:
        raise FieldLogError(f"{name}: the file has {rows:.3g} rows, but the limit is {MOST_ROWS:.3g}; split the file")
    return cells


def load_table(source: Source) -> Source:
    """Return a log whose columns can be read one by one: a CSV file is converted to a table in memory.

    Raises `FieldLogError` for an unreadable file.
    """
    if isinstance(source, pa.Table) or _is_parquet(source):
        return source
    names = column_names(source)
    if repeated := next((name for name in names if names.count(name) > 1), None):
        raise FieldLogError(f"{source.name}: there is more than one column {repeated!r}; rename all but one")
    return _csv(source, names).replace_schema_metadata({NAME: source.name.encode()})


def check_time(name: str, column: str, t: Array, unit_key: str = "") -> None:
    """Raise `FieldLogError` unless `t` (n,) [s] is finite, increasing, and plausible in seconds."""
    where = f"{name}: {column!r}"
    if len(t) < 2:
        raise FieldLogError(f"{where} has {len(t)} rows; a log needs at least two")
    if not np.isfinite(t).all():
        row = int(np.flatnonzero(~np.isfinite(t))[0])
        raise FieldLogError(f"{where} is not a number in row {row + 1}; remove the rows without a time")
    steps = np.diff(t)
    if not steps.any():
        raise FieldLogError(f"{where} is constant; specify the time column")
    if (steps >= 0).all() and (rows := len(t) / (1 + np.count_nonzero(steps))) > SAME_TIME:
        raise FieldLogError(
            f"{where}: each time occurs in {rows:.2g} rows; export times with more digits, or remove repeated rows"
        )
    if (steps <= 0).any():
        row = int(np.flatnonzero(steps <= 0)[0])
        what = "does not increase" if steps[row] == 0 else "decreases"
        raise FieldLogError(f"{where} {what} at row {row + 2}; sort the rows by time and remove repeated rows")
    step = float(np.median(steps))
    if step > LONGEST_STEP_S or step < LATEST_STEP_S:
        looks = "milliseconds" if step > LONGEST_STEP_S else "another unit"
        fix = f'; set {unit_key}, e.g. "ms"' if unit_key else "; convert it to seconds"
        raise FieldLogError(f"{where} has steps of {step:.3g} s, which indicates {looks}{fix}")
    if t[-1] - t[0] > MOST_STEPS * step:
        row = int(steps.argmax())
        raise FieldLogError(f"{where} jumps by {steps[row]:.3g} s at row {row + 2}; remove the rows with a wrong time")


def source_name(source: Source) -> str:
    """Return the name of a log for messages: the file name, or the name stored in a table."""
    if isinstance(source, Path):
        return source.name
    name: bytes = (source.schema.metadata or {}).get(NAME, b"log")
    return name.decode()


def check_size(path: Path, most: int = MOST_CSV_BYTES) -> None:
    """Raise `FieldLogError` for a file of more than `most` bytes."""
    if (size := path.stat().st_size) > most:
        raise FieldLogError(
            f"{path.name}: the file size is {size / 1e6:.3g} MB, but the limit is {most / 1e6:g} MB; split the file"
        )


def is_parquet(data: bytes) -> bool:
    """Return whether `data`, the first bytes of a file, are the start of a Parquet file."""
    return data.startswith(PARQUET)


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as stream:
        return is_parquet(stream.read(len(PARQUET)))


def _page(path: Path, column: str) -> pa.ChunkedArray:
    try:
        return pq.read_table(path.absolute(), columns=[column])[column]
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        raise FieldLogError(
            f"{path.name}: {column!r} cannot be read: {_first_line(error)}; the file is damaged, export the file again"
        ) from None


def _header(path: Path) -> tuple[list[str], str]:
    """Return the column names of a CSV file, and its delimiter: the most frequent of comma, semicolon and tab."""
    with path.open("rb") as stream:
        line = stream.readline(MOST_HEADER_BYTES)
    text = line.decode("utf-8-sig", errors="replace").strip("\r\n")
    if "\ufffd" in text:  # not UTF-8: units such as a degree sign, of a spreadsheet program
        text = line.decode("cp1252", errors="replace").strip("\r\n")
    if CONTROL.search(text):
        raise FieldLogError(f"{path.name}: the first line has control characters; export the file as CSV in UTF-8")
    if "\r" in text:
        raise FieldLogError(f"{path.name}: the lines end with CR only; save the file with LF or CR LF")
    if not text.strip():
        raise FieldLogError(f"{path.name}: the file has no header line with column names; add one")
    delimiter = max(",;\t", key=text.count)
    return [name.strip().strip('"') for name in text.split(delimiter)], delimiter


def _csv(path: Path, wanted: Sequence[str]) -> pa.Table:
    """Return the requested columns of a CSV file. Raises `FieldLogError` for a file that is too large or unreadable."""
    check_size(path)
    names, delimiter = _header(path)
    with path.open("rb") as stream:
        stream.readline()
        if not stream.read(1):
            raise FieldLogError(f"{path.name}: the file has column names but no rows; export the file again")

    def read(decimal: str) -> pa.Table:
        return pacsv.read_csv(
            path,
            read_options=pacsv.ReadOptions(column_names=names, skip_rows=1, use_threads=False),
            parse_options=pacsv.ParseOptions(delimiter=delimiter),
            convert_options=pacsv.ConvertOptions(
                include_columns=list(dict.fromkeys(wanted)), strings_can_be_null=True, decimal_point=decimal
            ),
        )

    try:
        table = read(".")
        texts = (column for column in table.columns if delimiter != "," and pa.types.is_string(column.type))
        return read(",") if any(DECIMAL_COMMA.fullmatch(_first_text(column)) for column in texts) else table
    except (pa.ArrowException, OSError, ValueError) as error:
        raise FieldLogError(
            f"{path.name}: the file cannot be read as CSV: {_first_line(error)}; correct or remove that row"
        ) from None


def _first_text(cells: pa.ChunkedArray) -> str:
    """Return the first text in a column, or an empty string."""
    return next(filter(None, (text.as_py() for text in cells)), "")


def _floats(name: str, column: str, cells: pa.ChunkedArray) -> Array:
    kind = cells.type
    if pa.types.is_time(kind):
        cells, kind = cells.cast(pa.string()), pa.string()
    if pa.types.is_string(kind) and CLOCK.fullmatch(_first_text(cells)):
        return _clock_seconds(name, column, cells)
    if pa.types.is_dictionary(kind):
        cells, kind = cells.cast(kind.value_type), kind.value_type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
        ticks = cells.cast(pa.int64())
        first = (ticks[0].as_py() if len(ticks) else 0) or 0
        return _numpy(ticks, first) / per_second
    if pa.types.is_boolean(kind):
        cells, kind = cells.cast(pa.int8()), pa.int8()
    if pa.types.is_null(kind):
        raise FieldLogError(f"{name}: {column!r} is empty in every row; specify another column")
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
        raise FieldLogError(f"{name}: {column!r} contains {_value_fault(kind, cells)}")
    values = _numpy(cells.cast(pa.float64()), 0)
    values[~np.isfinite(values)] = np.nan
    return values


def _clock_seconds(name: str, column: str, cells: pa.ChunkedArray) -> Array:
    """Return times of day in seconds since midnight, and NaN for empty cells. Raises `FieldLogError` for other text."""
    found = np.full(len(cells), np.nan)
    for k, text in enumerate(cells.to_pylist()):
        if not text:
            continue
        if not (match := CLOCK.fullmatch(text)):
            raise FieldLogError(
                f"{name}: {column!r} contains {text[:20]!r} in row {k + 1}, not a time; remove that row"
            )
        found[k] = 3600 * int(match[1]) + 60 * int(match[2]) + float(match[3].replace(",", "."))
    return found


def _numpy(cells: pa.ChunkedArray, origin: int) -> Array:
    """Return cells minus `origin` as a writable float array. Subtracting integers keeps all digits of nanoseconds."""
    if origin:
        return np.array([np.nan if v is None else float(v - origin) for v in cells.to_pylist()])
    return np.array(cells.to_numpy(zero_copy_only=False), dtype=np.float64)


def _value_fault(kind: pa.DataType, cells: pa.ChunkedArray) -> str:
    if pa.types.is_binary(kind):
        return "text that is not in UTF-8; save the file in UTF-8"
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        words = [(k, v) for k, v in enumerate(cells.to_pylist(), 1) if v]
        row, sample = next((word for word in words if not NUMBER.fullmatch(word[1])), words[0] if words else (1, ""))
        if DECIMAL_COMMA.fullmatch(sample):
            return f"decimal commas ({sample!r}); write decimal points"
        return f"text ({sample[:20]!r} in row {row}), not numbers; remove that row or specify another column"
    return f"{kind}, not numbers; export one number per row or specify another column"


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
