"""Positions from a CSV file, by column names.

A first row of words names the columns: x and y, or east and north, in metres; or lat and lon in degrees. The columns
speed, working and direction are also read; other columns, such as a heading, are ignored. A file without names has the
columns x, y[, speed]. Columns are separated by commas, semicolons or tabs; numbers with decimal commas need semicolons
or tabs. Every error is a ValueError that names the row, as numbered in an editor, and the fix.
"""

import csv
import re
from collections.abc import Iterator
from math import isfinite
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.errors import suggestion
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.shapes import DEGREES, Polyline, ShapeFile

NAMES = {
    "x": ("x", "east", "easting", "e", "pos_x", "position_x", "point_x", "utm_x", "utm_e", "utm_easting"),
    "y": ("y", "north", "northing", "n", "pos_y", "position_y", "point_y", "utm_y", "utm_n", "utm_northing"),
    "lat": ("lat", "latitude"),
    "lon": ("lon", "lng", "long", "longitude"),
    "speed": ("speed", "velocity", "v", "target_speed", "speed_limit"),
    "working": ("working", "work", "implement", "on"),
    "direction": ("direction", "gear"),
}
"""Accepted names of each column, without units, in lower case."""
UNITS = {"km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6, "km_h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600}
"""Conversion factors to m/s, by unit of speed."""
UNIT = re.compile(r"[_\s]*(?:[\[(]([^\])]*)[\])]|_(m_s|mps|m|deg|km_h|kmh|kph|mph|kn))\s*$")
"""Pattern of the unit at the end of a column name."""
WORDS = {"true": 1.0, "yes": 1.0, "on": 1.0, "forward": 1.0, "false": 0.0, "no": 0.0, "off": 0.0, "backward": -1.0}
"""Words in the columns working and direction, and their values."""
SMALLEST_M = 1.0  # Extent of the points below which values in columns of metres are regarded as degrees [m]
MOST_DEGREES = 180.0  # Maximum absolute longitude [deg]


class TableColumn(NamedTuple):
    """Column of a CSV file that contains a known quantity."""

    name: str
    place: int
    factor: float = 1.0  # Conversion factor from the unit of a speed column to m/s, or 1 for other quantities


def read_table(text: str) -> ShapeFile:
    """Return the points in the text of a CSV file as one shape. Raise ValueError naming the invalid row."""
    lines = text.splitlines()
    split = _separator(lines)
    rows = _rows(lines, split)
    number, cells = next(rows, (0, list[str]()))
    notes = tuple[str, ...]()
    if any(_is_number(cell, split) for cell in cells):
        columns, width = _positional(number, cells, split), len(cells)
        found = [(number, _numbers(number, cells, columns, width, split))]
    else:
        columns, notes = _named(number, cells) if cells else ([], ())
        width, found = len(cells), []
    found += [(number, _numbers(number, cells, columns, width, split)) for number, cells in rows]
    values = np.array([row for _, row in found]).reshape(len(found), len(columns))
    return _shape([column.name for column in columns], values, np.array([row for row, _ in found]), notes)


def _shape(names: list[str], values: Array, rows: Array, notes: tuple[str, ...]) -> ShapeFile:
    geographic = "lat" in names
    points = values[:, [names.index(name) for name in (("lon", "lat") if geographic else ("x", "y")) if name in names]]
    if not geographic and len(points) > 1 and np.abs(points).max() <= MOST_DEGREES:
        extent = float(np.hypot(*np.ptp(points, axis=0)))
        if 0 < extent < SMALLEST_M and np.abs(points).max() > SMALLEST_M:
            raise ValueError(
                f"the points extend over only {extent:.2g} m, so the numbers are probably degrees; name the columns "
                "lat, lon or lon, lat in the first row"
            )
    more = {name: values[:, k] for k, name in enumerate(names) if name not in ("x", "y", "lat", "lon")} | {"row": rows}
    return ShapeFile((Polyline(points, columns=more),), DEGREES if geographic else "", notes=notes)


def _separator(lines: list[str]) -> str:
    first = next((line for line in lines if line.strip()), "")
    return next((mark for mark in "\t;" if mark in first), ",")


def _rows(lines: list[str], split: str) -> Iterator[tuple[int, list[str]]]:
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in next(csv.reader([line], delimiter=split), [])]
        if not any(cells):
            continue
        if split == "," and any(mark in line for mark in ";\t"):
            raise ValueError(f"row {number}: it has semicolons or tabs; separate all columns in the same way")
        yield number, cells


def _named(number: int, cells: list[str]) -> tuple[list[TableColumn], tuple[str, ...]]:
    known, columns, unused = {name: key for key, names in NAMES.items() for name in names}, dict[str, TableColumn](), []
    for k, cell in enumerate(cells):
        unit = UNIT.search(cell)
        word = re.sub(r"[\s.]+", "_", (cell[: unit.start()] if unit else cell).strip().lower())
        key = known.get(word, "")
        if not key or key in columns:
            unused.append(cell)
            continue
        factor = UNITS.get((unit[1] or unit[2] or "").strip().lower(), 1.0) if unit and key == "speed" else 1.0
        columns[key] = TableColumn(key, k, factor)
    for pair, other in ((("x", "y"), ("lat", "lon")), (("lat", "lon"), ("x", "y"))):
        if set(pair) <= columns.keys():
            unused += [cells[columns.pop(name).place] for name in other if name in columns]
            left = f"column{'s' * (len(unused) > 1)} {', '.join(unused)} ignored"
            return list(columns.values()), (left,) if unused else ()
    near = next((found for cell in unused if (found := suggestion(cell, [*known]))), "")
    shown = ", ".join(cells[:12])
    raise ValueError(f"row {number}: no columns x and y, or lat and lon{near} (available: {shown}); rename some")


def _positional(number: int, cells: list[str], split: str) -> list[TableColumn]:
    if len(cells) not in (2, 3):
        raise ValueError(
            f"row {number}: it has {len(cells)} columns; write x, y or x, y, speed, or name them in the first row"
        )
    return [TableColumn(name, k) for k, name in enumerate(("x", "y", "speed")[: len(cells)])]


def _is_number(cell: str, split: str) -> bool:
    try:
        float(cell if split == "," else cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell


def _numbers(number: int, cells: list[str], columns: list[TableColumn], width: int, split: str) -> list[float]:
    if len(cells) != width:
        raise ValueError(f"row {number}: it has {len(cells)} columns, but others have {width}; use the same number")
    values = []
    for name, place, factor in columns:
        cell = cells[place]
        if name in ("working", "direction") and cell.lower() in WORDS:
            values.append(WORDS[cell.lower()])
            continue
        if not _is_number(cell, split):
            shown = cell if len(cell) <= 20 else cell[:20] + "..."
            raise ValueError(f"row {number}: {name} is not a number: {shown!r}; write a number, or remove the row")
        value = float(cell if split == "," else cell.replace(",", ".")) * factor
        if not isfinite(value):
            raise ValueError(f"row {number}: {name} is {value:g}; use a finite number, or remove the row")
        if (name == "lat" and abs(value) > MOST_DEGREES / 2) or (name == "lon" and abs(value) > MOST_DEGREES):
            raise ValueError(f"row {number}: {name} is {value:g}, not an angle in degrees; correct the column names")
        values.append(value)
    return values
