"""Positions from a CSV file, with columns identified by name.

A title row, or a comment above the first row of numbers, names the columns. Positions are x and y, or east and north,
in metres, or lat and lon in degrees. The columns speed, working and direction are also read; other columns, such as a
heading, are ignored. A file without column names has the columns x, y and optionally speed. A third column with
other quantities is ignored. Points that would be too close together for metres and have the decimals of degrees are
read as latitudes and longitudes.

Columns are separated by commas, semicolons, tabs or spaces; numbers with decimal commas need semicolons or tabs. Rows
that begin with # or % are comments. Every error is a ValueError that gives the row number of the file and the fix.
"""

import csv
import re
from collections.abc import Iterator
from itertools import chain
from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.errors import suggestion
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.arc import FASTEST_M_S, SLOWEST_M_S
from agrobot_mj.paths.imports.shapes import DEGREES, Polyline, ShapeFile

NAMES = {
    "x": ("x", "east", "easting", "e", "x_axis", "tx"),
    "y": ("y", "north", "northing", "n", "y_axis", "ty"),
    "lat": ("lat", "latitude"),
    "lon": ("lon", "lng", "long", "longitude"),
    "speed": ("speed", "velocity", "v", "target_speed", "speed_limit"),
    "working": ("working", "work", "implement", "on"),
    "direction": ("direction", "gear"),
}
"""Accepted names of each column in lower case, without prefix and unit."""
PREFIX = re.compile(r"^(?:(?:field|pose|pos|position|point|translation|transform|fix|gps|odom|location|utm|local)_)+")
"""Pattern of the prefixes of column names, such as field.pose.position in ROS recordings."""
KNOWN = {name: key for key, names in NAMES.items() for name in names}
COMMENTS, MOST_TITLES = ("#", "%"), 50  # First characters of comments, and maximum number of rows above the numbers
UNITS = {"km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6, "km_h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600}
"""Factors for the conversion of a speed to m/s, by the name of the speed unit."""
UNIT = re.compile(r"[_\s]*(?:[\[(]([^\])]*)[\])]|_(m_s|mps|m|deg|km_h|kmh|kph|mph|kn))\s*$")
"""Pattern of the unit at the end of a column name."""
WORDS = {"true": 1.0, "yes": 1.0, "on": 1.0, "forward": 1.0, "false": 0.0, "no": 0.0, "off": 0.0, "backward": -1.0}
"""Numerical values of the words in the columns working and direction."""
DECIMALS = "write decimal points instead of decimal commas"
"""Fix given in error messages about numbers that are split at decimal commas."""
MOST_DEGREES = 180.0  # Maximum absolute longitude [deg]
FAR_DEG, EXTENT_DEG, DECIMALS_DEG = 1.0, 0.2, 4
"""Limits for the detection of degrees without column names: minimum latitude or longitude and maximum extent of the
points [deg], and number of decimals exceeded by most coordinates [-]. Paths in metres are longer than 0.2 m."""
FEWEST, NEAR_RAD = 5, 0.2
"""Minimum number of rows for detecting a column of heading angles, and maximum median difference between the column and
the direction of the path [rad]."""


class TableColumn(NamedTuple):
    """Column of a CSV file: name of the quantity, column index, and conversion factor."""

    name: str
    place: int
    factor: float = 1.0  # Conversion factor from the unit of a speed column to m/s, or 1 for other quantities


def read_table(text: str) -> ShapeFile:
    """Return the points in the text of a CSV file as one shape. Raise a ValueError that gives the first invalid row."""
    lines = text.splitlines()
    titles, names = _titles(lines)
    rows = _rows(lines, titles)
    number, cells = next(rows, (0, list[str]()))
    if not (titles or cells):
        raise ValueError("the file contains no positions; export the file again")
    if titles:
        columns, notes = _name_columns(titles, names)
    elif not any(map(_is_number, cells)):
        columns, notes = _name_columns(number, cells)
    else:
        names = _without_empty_end(cells)
        columns, notes = _positional(number, names), ()
    read = [(k, _numbers(k, row, columns, len(names))) for k, row in chain([(number, cells)] if cells else [], rows)]
    found = np.array([k for k, row in read if row])
    values = np.array([row for _, row in read if row]).reshape(len(found), len(columns))
    if omitted := len(read) - len(found):
        rows_are = "row without a position is" if omitted == 1 else "rows without a position are"
        notes = (*notes, f"{omitted} {rows_are} omitted")
    if not titles and len(columns) == 3 and not _is_speed(values):
        columns, values = columns[:2], values[:, :2]
        notes = (*notes, "the third column does not contain speeds and is ignored")
    if not titles and _are_degrees(values[:, :2]):
        columns = [TableColumn("lat", 0), TableColumn("lon", 1), *columns[2:]]
        notes = (
            *notes,
            "the first two columns are read as latitude and longitude; for another order, name the columns",
        )
    names = [column.name for column in columns]
    if "speed" in names and (empty := np.isnan(speeds := values[:, names.index("speed")])).any():
        if empty.all():
            values = values[:, keep := [k for k, name in enumerate(names) if name != "speed"]]
            names = [names[k] for k in keep]
        else:
            speeds[empty] = np.interp(found[empty], found[~empty], speeds[~empty])
            notes = (*notes, f"missing speeds in {np.count_nonzero(empty)} rows are interpolated")
    geographic = "lat" in names
    points = values[:, 1::-1] if geographic else values[:, :2]
    more = {name: values[:, k] for k, name in enumerate(names[2:], start=2)} | {"row": found}
    return ShapeFile((Polyline(points, columns=more),), DEGREES if geographic else "", notes=notes)


def _titles(lines: list[str]) -> tuple[int, list[str]]:
    """Return the row number and cells of the last title row above the numbers, or 0 and [] if there are no titles."""
    found = 0, list[str]()
    for number, line in enumerate(lines[:MOST_TITLES], start=1):
        cells = _cells(line.strip().lstrip("".join(COMMENTS)), _separator(line))
        if not line.lstrip().startswith(COMMENTS) and any(map(_is_number, cells)):
            break
        keys = {_key(cell)[0] for cell in cells}
        if {"x", "y"} <= keys or {"lat", "lon"} <= keys:
            found = number, _without_empty_end(cells)
    return found


def _without_empty_end(cells: list[str]) -> list[str]:
    return cells[: max((k + 1 for k, cell in enumerate(cells) if cell), default=0)]


def _is_speed(values: Array) -> bool:
    """Return whether the third column of an untitled table, shape (n, 3), contains speeds instead of heights or
    headings."""
    points, third = values[:, :2], values[:, 2]
    speeds = np.count_nonzero((third >= SLOWEST_M_S) & (third <= FASTEST_M_S))
    along = np.diff(points, axis=0)
    direction = np.arctan2(along[:, 1], along[:, 0])
    turned = [np.median(np.abs(wrap(third[:-1] - angle))) for angle in (direction, np.pi / 2 - direction) if len(angle)]
    heading = np.ptp(third) > NEAR_RAD if len(third) >= FEWEST else False
    if 2 * speeds >= len(third) and not (heading and min(turned) < NEAR_RAD):
        return True
    if len(points) and np.ptp(points, axis=0).min() == 0 < np.ptp(third):
        raise ValueError(
            "the columns cannot be recognised, because the third column does not contain speeds and one of the first "
            "two is constant; name the columns in the first row"
        )
    return False


def _are_degrees(points: Array) -> bool:
    """Return whether the points of an untitled table, shape (n, 2), are latitudes and longitudes instead of metres."""
    points = points[points.any(axis=1)]  # without the points (0, 0) of receivers without position
    if len(points) < 3:
        return False
    smaller, larger = np.sort(np.abs(points).max(axis=0))
    within = smaller <= MOST_DEGREES / 2 and FAR_DEG < larger <= MOST_DEGREES
    fine = np.abs(points - np.round(points, DECIMALS_DEG)) > 1e-9
    return bool(within and 0 < np.ptp(points, axis=0).max() < EXTENT_DEG and fine.mean(axis=0).min() > 0.5)


def _separator(line: str) -> str:
    return next((mark for mark in "\t;," if mark in line), " ")


def _cells(line: str, split: str) -> list[str]:
    return line.split() if split == " " else [cell.strip() for cell in next(csv.reader([line], delimiter=split), [])]


def _rows(lines: list[str], first: int) -> Iterator[tuple[int, list[str]]]:
    split = ""
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip(",;\t ") or line.lstrip().startswith(COMMENTS):
            continue
        split = split or _separator(line)
        if split in ", " and any(mark in line for mark in ";\t"):
            raise ValueError(f"row {number}: the row contains semicolons or tabs; use the same separator in all rows")
        yield number, _cells(line if split == "," else line.replace(",", "."), split)


def _key(cell: str) -> tuple[str, float]:
    """Return the quantity of a column named `cell` ("" if unknown), and the conversion factor of its unit."""
    unit = UNIT.search(cell)
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", (cell[: unit.start()] if unit else cell).strip())
    key = KNOWN.get(PREFIX.sub("", re.sub(r"[\s./-]+", "_", name).lower().strip("_")), "")
    return key, UNITS.get((unit[1] or unit[2] or "").strip().lower(), 1.0) if unit and key == "speed" else 1.0


def _name_columns(number: int, cells: list[str]) -> tuple[list[TableColumn], tuple[str, ...]]:
    columns, unused = dict[str, TableColumn](), list[str]()
    for k, cell in enumerate(cells):
        key, factor = _key(cell)
        if not key or key in columns:
            unused.append(cell)
        else:
            columns[key] = TableColumn(key, k, factor)
    for pair, other in ((("x", "y"), ("lat", "lon")), (("lat", "lon"), ("x", "y"))):
        if set(pair) <= columns.keys():
            unused += [cells[columns.pop(name).place] for name in other if name in columns]
            noun, are = ("columns", "are") if len(unused) > 1 else ("column", "is")
            left = f"{noun} {', '.join(unused)} {are} ignored"
            return [columns.pop(name) for name in pair] + list(columns.values()), (left,) if unused else ()
    near = next((found for cell in unused if (found := suggestion(cell, [*KNOWN]))), "")
    shown = ", ".join(cells[:12])
    missing = "the file has no columns x and y, or lat and lon"
    raise ValueError(f"row {number}: {missing}{near} (available: {shown}); rename the columns")


def _positional(number: int, cells: list[str]) -> list[TableColumn]:
    if len(cells) not in (2, 3):
        fix = "write x, y or x, y, speed, or name them in the first row"
        raise ValueError(
            f"row {number}: the row has {len(cells)} columns; {fix}{f'; {DECIMALS}' * _split_decimals(cells)}"
        )
    return [TableColumn(name, k) for k, name in enumerate(("x", "y", "speed")[: len(cells)])]


def _split_decimals(cells: list[str]) -> bool:
    """Return whether the cells of a row are fragments of numbers with decimal commas."""
    return len(cells) in (4, 6) and all(cell.lstrip("+-").isdecimal() for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _numbers(number: int, cells: list[str], columns: list[TableColumn], width: int) -> list[float]:
    """Return the numbers of a row in the order of `columns`, or an empty list for a row without a position."""
    if len(cells) < width or any(cells[width:]):
        fix = DECIMALS if len(cells) == 2 * width and _split_decimals(cells) else "use the same number in all rows"
        raise ValueError(f"row {number}: the row has {len(cells)} columns, but other rows have {width}; {fix}")
    if not any(cells[place] for _, place, _ in columns[:2]):
        return []
    values = []
    for name, place, factor in columns:
        cell = cells[place]
        if name in ("working", "direction") and cell.lower() in WORDS:
            values.append(WORDS[cell.lower()])
            continue
        if not cell and name == "speed":
            values.append(nan)
            continue
        if not _is_number(cell):
            shown = cell if len(cell) <= 20 else cell[:20] + "..."
            raise ValueError(f"row {number}: {name} is not a number: {shown!r}; write a number, or remove the row")
        value = float(cell) * factor
        if not isfinite(value):
            raise ValueError(f"row {number}: {name} is {value:g}; use a finite number, or remove the row")
        if (name == "lat" and abs(value) > MOST_DEGREES / 2) or (name == "lon" and abs(value) > MOST_DEGREES):
            raise ValueError(f"row {number}: {name} is {value:g}, not an angle in degrees; correct the column names")
        values.append(value)
    return values
