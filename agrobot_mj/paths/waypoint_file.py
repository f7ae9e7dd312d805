"""Waypoints from a CSV file: x, y[, speed] per row, in metres east and north of a local origin, and m/s.

A first row of words is a header; empty rows are ignored. Every error is a ValueError with the file, the row number of
an editor, and the fix.
"""

import csv
from collections.abc import Iterator
from functools import lru_cache
from math import hypot, isfinite
from pathlib import Path

import numpy as np

from agrobot_mj.core.resources import Stamp, checked, refuse, stamp
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import FASTEST_M_S, SLOWEST_M_S

MAX_BYTES = 2_000_000
MAX_ROWS = 20_000
MAX_COORDINATE_M = 100e3
"""Maximum distance from the origin [m]; larger coordinates are usually from a map grid and less precise."""
CLOSEST_M = 0.001
"""Minimum distance between consecutive waypoints [m]."""
COLUMNS = ("x", "y", "speed")


def stamp_of(name: str) -> Stamp:
    """Return the stamp of the current file content. Raise ValueError if the file cannot contain waypoints."""
    path = checked(name, (), MAX_BYTES)
    return stamp(name) or refuse(path, "no longer exists; create it again")


@lru_cache(maxsize=8)
def waypoints(stamp: Stamp) -> Array:
    """Return the waypoints, shape (n, 2) or (n, 3): x, y [m] and speed [m/s]; n >= 3. Raise ValueError if invalid."""
    file = Path(stamp[0])
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        refuse(file, "is not valid UTF-8; save it as a CSV file in UTF-8 with the columns x, y[, speed]")
    except OSError as error:
        refuse(file, f"cannot be read: {error.strerror}; choose another file")
    try:
        return _table(lines)
    except (ValueError, csv.Error) as error:
        refuse(file, str(error))


def _table(lines: list[str]) -> Array:
    rows = list(_rows(lines))
    if len(rows) < 3:
        raise ValueError(f"has {len(rows)} waypoints; give at least 3")
    if len(rows) > MAX_ROWS:
        raise ValueError(f"has {len(rows)} waypoints, at most {MAX_ROWS}; remove some rows")
    width = len(rows[0][1])
    previous = rows[0][1]
    for number, row in rows[1:]:
        if len(row) != width:
            raise ValueError(
                f"row {number}: has {len(row)} columns, previous rows {width}; use the same number in every row"
            )
        if hypot(row[0] - previous[0], row[1] - previous[1]) < CLOSEST_M:
            raise ValueError(f"row {number}: repeats the previous waypoint; remove it")
        previous = row
    return np.array([row for _, row in rows])


def _rows(lines: list[str]) -> Iterator[tuple[int, list[float]]]:
    """Yield number and values of each non-empty row."""
    first = True
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in next(csv.reader([line]), [])]
        if not any(cells):
            continue
        if any(mark in line for mark in ";\t"):
            raise ValueError(f"row {number}: has semicolons or tabs; separate columns by commas, use decimal points")
        if first and _is_header(cells):
            _in_order(number, cells)
        else:
            yield number, _numbers(number, cells)
        first = False


def _is_header(cells: list[str]) -> bool:
    return not any(_is_number(cell) for cell in cells)


def _in_order(number: int, cells: list[str]) -> None:
    """Raise ValueError if the row is a header with the columns in another order."""
    for k, name in enumerate(cell.lower() for cell in cells):
        if name in COLUMNS and COLUMNS.index(name) != k:
            raise ValueError(f"row {number}: has {name} in column {k + 1}; reorder the columns to x, y[, speed]")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _numbers(number: int, cells: list[str]) -> list[float]:
    """Return the values of a row. Raise ValueError if invalid."""
    if len(cells) not in (2, 3):
        raise ValueError(f"row {number}: has {len(cells)} columns; specify x, y or x, y, speed, separated by commas")
    values = []
    for name, cell in zip(COLUMNS, cells, strict=False):
        if not _is_number(cell):
            shown = cell if len(cell) <= 20 else cell[:20] + "..."
            raise ValueError(f"row {number}: {name} is not a number: {shown!r}; use metres with a decimal point")
        value = float(cell)
        if not isfinite(value):
            raise ValueError(f"row {number}: {name} is {value:g}; use a finite number, or remove the row")
        if name == "speed" and not SLOWEST_M_S <= value <= FASTEST_M_S:
            raise ValueError(f"row {number}: speed is {value:g} m/s; give one from {SLOWEST_M_S:g} to {FASTEST_M_S:g}")
        if abs(value) > MAX_COORDINATE_M:
            raise ValueError(
                f"row {number}: {name} is {value:g} m, more than {MAX_COORDINATE_M / 1000:g} km from the origin; "
                "subtract the coordinates of a point on the field"
            )
        values.append(value)
    return values
