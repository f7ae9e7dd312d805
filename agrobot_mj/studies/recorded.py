"""Columns of recorded signals, looked at before anything is computed from them: numbers, in seconds, evenly sampled."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array

MOST_ROWS = 5_000_000
"""Largest number of rows: more than a day at 50 Hz."""
SHORTEST_S, LONGEST_S = 0.001, 0.5
"""Range of the time between two rows [s]."""
UNEVEN = 0.5
"""Largest difference of a time between two rows from the usual one, over that [-]."""


def recorded_columns(signals: pa.Table | Path, names: Sequence[str]) -> list[Array]:
    """Columns of a table or Parquet file, each (n,), NaN where there is no value; the first is the time [s].

    Raises `ScenarioError` that says what is wrong, without the name of the file.
    """
    table = _read(signals, names) if isinstance(signals, Path) else signals
    _check_names(table.column_names, names)
    if table.num_rows > MOST_ROWS:
        raise ScenarioError(f"has {table.num_rows} rows, the limit is {MOST_ROWS}; cut a part out of it")
    columns = [_numbers(table[name], name) for name in names]
    _check_time(columns[0], names[0])
    return columns


def _read(file: Path, names: Sequence[str]) -> pa.Table:
    try:
        with pq.ParquetFile(file) as parquet:
            _check_names(parquet.schema_arrow.names, names)
            if parquet.metadata.num_rows > MOST_ROWS:  # before they fill the memory
                raise ScenarioError(f"has {parquet.metadata.num_rows} rows, the limit is {MOST_ROWS}; cut a part out")
            return parquet.read(columns=list(names))
    except pa.ArrowException as error:
        raise ScenarioError(f"is no Parquet file, or a damaged one: {_first_line(error)}") from None
    except OSError as error:
        raise ScenarioError(f"cannot be read: {_first_line(error)}; is it damaged?") from None


def _check_names(there: Sequence[str], wanted: Sequence[str]) -> None:
    if missing := [name for name in wanted if name not in there]:
        raise ScenarioError(f"has no column {', '.join(missing)}; take the signals of a run")
    if twice := [name for name in wanted if list(there).count(name) > 1]:
        raise ScenarioError(f"has column {', '.join(twice)} more than once; take the signals of a run")


def _numbers(column: pa.ChunkedArray, name: str) -> Array:
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind)):
        raise ScenarioError(f"column {name}: must hold numbers, got {kind}")
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def _check_time(t: Array, name: str) -> None:
    """Raise `ScenarioError` unless the time runs forward in even steps of seconds."""
    steps = np.diff(t)
    if len(t) < 2 or not np.isfinite(t).all():
        raise ScenarioError(f"column {name}: must hold the time of every row, got {len(t)} rows with gaps or nothing")
    if steps.min() <= 0.0:
        at = int(steps.argmin())
        raise ScenarioError(f"column {name}: must increase, got {t[at]:g} and then {t[at + 1]:g}; sort the rows")
    usual = float(np.median(steps))
    if not SHORTEST_S <= usual <= LONGEST_S:
        wanted = f"{SHORTEST_S:g} to {LONGEST_S:g} s"
        raise ScenarioError(f"column {name}: rows must be {wanted} apart, got {usual:g}; is it in s?")
    if (off := float(np.abs(steps - usual).max())) > UNEVEN * usual:
        gap = f"they are {usual:g} s apart, one is {off:.3g} s off"
        raise ScenarioError(f"column {name}: rows must be evenly spaced: {gap}; fill the gaps")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
