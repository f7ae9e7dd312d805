"""Files of an AgOpenGPS field: Boundary.txt, Headland.txt, TrackLines.txt, Tram.txt, RecPath.txt and Field.txt.

Points consist of east, north and compass heading [rad] in a local plane, whose geographic origin is in Field.txt.
Numbers may have decimal commas; a row then has twice as many comma-separated cells.
"""

import re
from collections.abc import Iterator
from math import cos, sin
from pathlib import Path

import numpy as np

from agrobot_mj.core.geodesy import Origin
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.shapes import Polyline, ShapeFile, parts_inside

HEADS = {
    "$Boundary": "boundary",
    "$Headland": "headland",
    "$HeadLines": "headlines",
    "$TrackLines": "track",
    "$TwolTracks": "track",
    "$Tram": "tram",
    "$RecPath": "recorded",
}
"""Role of the shapes in an AgOpenGPS file, keyed by the first line of the file."""
LINE_M = 1000.0  # Length by which an AB line extends beyond each of its points [m], as in exports of AgOpenGPS
SHORT_M = 200.0  # Length by which a path without a field boundary extends beyond the points of an AB line [m]
BOUNDARY, TRACKS = "Boundary.txt", "TrackLines.txt"
AB_LINE, PIVOT = 2, 64  # Modes of tracks: straight line through two points, and circle
WHOLE, DECIMALS = re.compile(r"[+-]?\d+"), re.compile(r"\d+(?:[eE][+-]?\d+)?")
"""Patterns of the integer part and the decimal part of a number with a decimal comma."""


class _Lines:
    """Reader of the lines of a text file."""

    def __init__(self, text: str) -> None:
        self.lines = [line.strip() for line in text.splitlines()]
        self.at, self.head = 0, ""

    def __bool__(self) -> bool:
        return any(self.lines[self.at :])

    def peek(self) -> str:
        """Return the next line without advancing, or an empty string at the end of the file."""
        return self.lines[self.at] if self.at < len(self.lines) else ""

    def next(self) -> str:
        """Return the next line and advance. Raise ValueError at the end of the file."""
        if self.at >= len(self.lines):
            raise ValueError("the file ends within a list of points; export the file again")
        self.at += 1
        return self.lines[self.at - 1]

    def count(self) -> int:
        """Return the count on the next line. Raise ValueError if the line is not an integer."""
        line = self.next()
        if not line.isdecimal():
            raise ValueError(f"line {self.at}: {line[:30]!r} is not a number of points; export the file again")
        return int(line)

    def numbers(self, count: int) -> list[float]:
        """Return the first `count` numbers of the next line, with decimal points or commas, or raise ValueError."""
        line = self.next()
        found = comma_numbers(line, count)
        if len(found) < count or not np.isfinite(found).all():
            raise ValueError(f"line {self.at}: {line[:40]!r} does not have {count} numbers; export the file again")
        return found[:count]

    def points(self) -> Array:
        """Read a line with the point count and one line for each point. Return the points, shape (n, 2) [m]."""
        return self.table()[:, :2]

    def table(self, width: int = 2) -> Array:
        """Read a line with the row count and one line of `width` numbers for each row. Return the rows, shape (n,
        width)."""
        count = self.count()
        if count > len(self.lines) - self.at:
            raise ValueError(
                f"line {self.at}: the file declares {count} points, but contains fewer; export the file again"
            )
        return np.array([self.numbers(width) for _ in range(count)]).reshape(count, width)


def comma_numbers(line: str, count: int) -> list[float]:
    """Return up to `count` numbers of a comma-separated line, or an empty list if a cell is not a number.

    Two adjacent integer cells form one number if the line uses decimal commas.
    """
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) >= 2 * count and not any("." in cell for cell in cells):
        pairs = list(zip(cells[::2], cells[1::2], strict=False))
        if all(WHOLE.fullmatch(a) and DECIMALS.fullmatch(b) for a, b in pairs[:count]):
            cells = [f"{a}.{b}" for a, b in pairs]
    try:
        return [float(cell) for cell in cells[:count]]
    except ValueError:
        return []


def read_agopengps(text: str) -> ShapeFile:
    """Return the shapes in the text of one AgOpenGPS field file. Raise ValueError for damaged text or another file
    type."""
    lines = _Lines(text)
    while lines and lines.peek() not in HEADS:
        lines.next()
    if not lines:
        raise ValueError(f"the file has no shapes of an AgOpenGPS field; choose a file with {', '.join(HEADS)}")
    lines.head = lines.next()
    readers = {"track": _tracks, "tram": _tram, "headlines": _headlines, "recorded": _recorded_paths}
    shapes = tuple(readers.get(HEADS[lines.head], _rings)(lines))
    return ShapeFile(shapes, name=shapes[0].name if shapes else "")


def _rings(lines: _Lines) -> Iterator[Polyline]:
    outer = role = HEADS[lines.head]
    while lines:
        over = True
        while lines.peek() in ("True", "False", ""):
            over = lines.next() != "False"
        inner = "hole" if over else "obstacle"
        if len(points := lines.points()):
            yield Polyline(points, True, role)
            role = inner if outer == "boundary" else outer


def _headlines(lines: _Lines) -> Iterator[Polyline]:
    """Yield the headland lines of a Headlines.txt that have more than three points."""
    while lines:
        name = lines.next()
        for _ in range(3):
            lines.next()  # distance, mode, first point
        points = lines.points()
        if len(points) > 3:
            yield Polyline(points, False, "headline", name)


def _tracks(lines: _Lines) -> Iterator[Polyline]:
    """Yield the guidance lines of TrackLines.txt. AB lines extend by LINE_M beyond both points."""
    extra = 2 if lines.head == "$TwolTracks" else 0
    while lines:
        if not lines.peek():
            lines.next()
            continue
        name = lines.next()
        (heading,) = lines.numbers(1)
        a, b = np.array(lines.numbers(2)), np.array(lines.numbers(2))
        (nudge,), mode = lines.numbers(1), lines.count()
        for _ in range(1 + extra):
            lines.next()  # whether it is shown
        points = lines.points()
        if mode == AB_LINE:
            along = np.array([sin(heading), cos(heading)])
            points = np.array([a - LINE_M * along, b + LINE_M * along])
            points = points + nudge * np.array([cos(heading), -sin(heading)])
        if mode != PIVOT and len(points) >= 2:
            yield Polyline(points, False, "track", name, properties={"extends": mode == AB_LINE})


def cut_line(points: Array, boundary: ShapeFile | None) -> tuple[Array, str]:
    """Return the longest part of an AB line, shape (2, 2) [m], that is inside the field, and a note.

    Without a boundary, the line extends SHORT_M beyond the points A and B. Raise ValueError for a line outside the
    field.
    """
    if boundary is None or not boundary.shapes:
        along = (points[1] - points[0]) / np.hypot(*(points[1] - points[0]))
        cut = (LINE_M - SHORT_M) * np.array([along, -along])
        return points + cut, f"the AB line extends {SHORT_M:g} m beyond A and B, because there is no {BOUNDARY}"
    parts = parts_inside(points, [shape.points for shape in boundary.shapes])
    if not parts:
        raise ValueError(f"the AB line does not cross the field in {BOUNDARY}; choose another line")
    longest = max(parts, key=lambda part: float(np.hypot(*(part[1] - part[0]))))
    more = f", and the longest of {len(parts)} parts is used" if len(parts) > 1 else ""
    return longest, f"the AB line is cut at {BOUNDARY}{more}"


def _tram(lines: _Lines) -> Iterator[Polyline]:
    """Yield the tramlines of Tram.txt: outer, inner and single lines."""
    for name in ("outer", "inner"):
        if len(points := lines.points()):
            yield Polyline(points, False, "tram", name)
    for k in range(lines.count() if lines else 0):
        yield Polyline(lines.points(), False, "tram", f"tramline {k + 1}")


def _recorded_paths(lines: _Lines) -> Iterator[Polyline]:
    """Yield the recorded path of RecPath.txt, whose rows contain east, north, heading, speed [km/h] and button
    state."""
    rows = lines.table(4)
    if len(rows):
        yield Polyline(rows[:, :2], False, "recorded", "recorded path", {"speed": rows[:, 3] / 3.6})


def read_origin(text: str) -> Origin | None:
    """Return the geographic origin in the text of a Field.txt, or None if the entry `StartFix` is missing."""
    lines = [line.strip() for line in text.splitlines()]
    if "StartFix" not in lines[:-1]:
        return None
    found = comma_numbers(lines[lines.index("StartFix") + 1], 2)
    if len(found) < 2 or abs(found[0]) > 90 or abs(found[1]) > 180:
        raise ValueError("Field.txt: StartFix is not a latitude and longitude in degrees; export the file again")
    return Origin(*found)


def is_folder_of_field(folder: Path) -> bool:
    """Return whether a folder contains a file `Field.txt` or `Boundary.txt` of AgOpenGPS."""
    return any((folder / name).is_file() for name in ("Field.txt", "Boundary.txt"))
