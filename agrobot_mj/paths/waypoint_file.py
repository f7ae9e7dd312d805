"""Waypoints from a CSV file: x, y[, speed] a row, in metres east and north of a local origin, and m/s.

A first row of words is a header; empty rows count for nothing. Every fault is a ValueError that names the file, the row
(as an editor numbers them) and the fix.
"""

import csv
from collections.abc import Iterator
from functools import lru_cache
from math import hypot, isfinite
from pathlib import Path

import numpy as np

from agrobot_mj.resources import library_file
from agrobot_mj.signals import Array

MOST_BYTES = 2_000_000
MOST_ROWS = 20_000
FARTHEST_M = 100e3
"""From the origin [m]: beyond, coordinates are those of a map, and lose digits."""
CLOSEST_M = 0.001
"""Between one waypoint and the next [m]."""
FASTEST_M_S = 5.0
"""As any path's speed [m/s]."""
COLUMNS = ("x", "y", "speed")

Stamp = tuple[str, int, int]
"""Path of a file, time of its last change, size: a file with the same stamp has the same content."""


def stamp_of(name: str) -> Stamp:
    """What tells this state of the file from others. Raises ValueError if it cannot be one."""
    file = library_file(name)
    try:
        status = file.stat()
    except (OSError, ValueError):
        shown = file.name if len(file.name) <= 80 else file.name[:80] + "..."
        raise ValueError(f"{shown}: no such file; give its path from the folder of the scenario") from None
    if file.is_dir():
        raise ValueError(f"{file.name}: is a folder; name a CSV file with the columns x, y[, speed]")
    if status.st_size > MOST_BYTES:
        raise ValueError(
            f"{file.name}: has {status.st_size / 1e6:.3g} MB, at most {MOST_BYTES / 1e6:g}; leave out some of its rows"
        )
    return str(file), status.st_mtime_ns, status.st_size


@lru_cache(maxsize=8)
def waypoints(stamp: Stamp) -> Array:
    """The waypoints, shape (n, 2) or (n, 3): x, y [m] and speed [m/s]; n is at least 3. Raises ValueError."""
    file = Path(stamp[0])
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise ValueError(f"{file.name}: is not a text file; name a CSV file with the columns x, y[, speed]") from None
    except OSError as error:
        raise ValueError(f"{file.name}: cannot be read: {error.strerror}; choose another file") from None
    try:
        return _table(lines)
    except ValueError as error:
        raise ValueError(f"{file.name}: {error}") from None


def _table(lines: list[str]) -> Array:
    rows = list(_rows(lines))
    if len(rows) < 3:
        raise ValueError(f"has {len(rows)} waypoints; give at least 3")
    if len(rows) > MOST_ROWS:
        raise ValueError(f"has {len(rows)} waypoints, at most {MOST_ROWS}; leave out some of its rows")
    width = len(rows[0][1])
    before = rows[0][1]
    for number, row in rows[1:]:
        if len(row) != width:
            raise ValueError(f"row {number}: has {len(row)} columns, those before {width}; give every row the same")
        if hypot(row[0] - before[0], row[1] - before[1]) < CLOSEST_M:
            raise ValueError(f"row {number}: repeats the waypoint before it; leave it out")
        before = row
    return np.array([row for _, row in rows])


def _rows(lines: list[str]) -> Iterator[tuple[int, list[float]]]:
    """Number and values of each row that has any."""
    first = True
    for number, cells in enumerate(csv.reader(lines), start=1):
        cells = [cell.strip() for cell in cells]
        if not any(cells):
            continue
        if not (first and _is_header(cells)):
            yield number, _numbers(number, cells)
        first = False


def _is_header(cells: list[str]) -> bool:
    return not any(_is_number(cell) for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(number: int, cells: list[str]) -> list[float]:
    """The values of a row, checked one by one."""
    if len(cells) not in (2, 3):
        raise ValueError(f"row {number}: has {len(cells)} columns; give x, y or x, y, speed, with commas between them")
    values = []
    for name, cell in zip(COLUMNS, cells, strict=False):
        if not _is_number(cell):
            shown = cell if len(cell) <= 20 else cell[:20] + "..."
            raise ValueError(f"row {number}: {name} is not a number: {shown!r}; write metres with a decimal point")
        value = float(cell)
        if not isfinite(value):
            raise ValueError(f"row {number}: {name} is {value:g}; give a finite number, or leave the row out")
        if name == "speed" and not 0 < value <= FASTEST_M_S:
            raise ValueError(f"row {number}: speed is {value:g} m/s; give one above 0 and at most {FASTEST_M_S:g}")
        if abs(value) > FARTHEST_M:
            raise ValueError(
                f"row {number}: {name} is {value:g} m, more than {FARTHEST_M / 1000:g} km from the origin; "
                "subtract the coordinates of a place on the field"
            )
        values.append(value)
    return values
