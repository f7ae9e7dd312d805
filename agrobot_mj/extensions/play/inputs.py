"""Driver inputs of an interactive drive, stored in a CSV file with one row for each change of the input.

Columns: first tick of the input, number of the active guidance law (0 for the driver), steering angle [rad], and speed
[m/s]. An empty speed means the speed of the path. Numbers are stored with all digits, so that the drive can be repeated
exactly.
"""

import csv
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from functools import lru_cache
from math import isfinite, isnan, nan
from pathlib import Path
from typing import NamedTuple

from agrobot_mj.core.resources import checked_path, refuse, stamp

INPUTS = "inputs.csv"  # Name of the CSV file in the results folder of a drive
HEADER = ("tick", "law", "steer_rad", "speed_m_s")
MOST_BYTES = 20_000_000
"""Maximum size of an input file [bytes], sufficient for several hours with a change in each tick."""


class PlayInput(NamedTuple):
    """Driver input in one tick. By default, the driver controls the tractor with zero speed."""

    law: int = 0  # Number of the active guidance law, counted from 1, or 0 for the driver
    steer: float = 0.0  # Steering angle of the driver [rad], left positive
    speed: float = 0.0  # Speed setpoint, negative in reverse [m/s], or NaN for a law that uses the speed of the path


class PlayTable(NamedTuple):
    """Changes of the driver input during a drive, ordered by tick."""

    ticks: Sequence[int]
    given: Sequence[PlayInput]

    def at(self, tick: int) -> PlayInput:
        """Return the driver input in a tick, or the default input before the first change."""
        k = bisect_right(self.ticks, tick) - 1
        return self.given[k] if k >= 0 else PlayInput()


def write_inputs(path: Path, changes: Iterable[tuple[int, PlayInput]]) -> None:
    """Write changes of the driver input, as pairs of tick and input, to a CSV file."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for tick, given in changes:
            writer.writerow((tick, given.law, repr(given.steer), "" if isnan(given.speed) else repr(given.speed)))


def read_inputs(name: str) -> PlayTable:
    """Return the inputs in a CSV file. Raise a ValueError that names the line and a remedy if the file is invalid.

    The result is cached until the file changes.
    """
    return _read_inputs(name, stamp(name))


@lru_cache(maxsize=8)
def _read_inputs(name: str, _changed: object) -> PlayTable:
    path = checked_path(name, [".csv"], MOST_BYTES)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeError, csv.Error) as error:
        refuse(path, f"the file is not a table of inputs ({error}); specify the {INPUTS} of a drive")
    if not rows or tuple(rows[0]) != HEADER:
        refuse(path, f"the first line must be {','.join(HEADER)}; specify the {INPUTS} of a drive")
    ticks: list[int] = []
    given: list[PlayInput] = []
    for number, row in enumerate(rows[1:], start=2):
        tick, one = _row(row, f"{path.name}, line {number}")
        if ticks and tick <= ticks[-1]:
            raise ValueError(f"{path.name}, line {number}: tick must increase, got {tick} after {ticks[-1]}")
        ticks.append(tick)
        given.append(one)
    return PlayTable(ticks, given)


def _row(row: Sequence[str], place: str) -> tuple[int, PlayInput]:
    try:
        tick, law, steer, speed = row
        one = PlayInput(int(law), float(steer), float(speed) if speed else nan)
        whole = int(tick)
    except ValueError:
        raise ValueError(f"{place}: must contain four numbers ({', '.join(HEADER)}), got {','.join(row)!r}") from None
    if whole < 0 or one.law < 0 or not isfinite(one.steer) or not (isfinite(one.speed) or not speed):
        raise ValueError(
            f"{place}: tick and law (an index) must not be negative, and all numbers must be finite; "
            f"got {','.join(row)!r}"
        )
    if not speed and not one.law:
        raise ValueError(f"{place}: speed_m_s is missing for the driver; specify a number, 0 for standstill")
    return whole, one
