"""Reader for lines of a logging program that begin with an ISO time: `time: sentence` or `time: {json}`.

The time at the start of the line applies to all values of the line. Sentences are read as in the `nmea` reader. In a
JSON object, `yaw` is the heading of an inertial unit in degrees from north. Other numbers become columns, for example
`was`, the counts of the steering sensor.
"""

import json
from datetime import datetime
from pathlib import Path
from re import compile as pattern
from typing import Literal

from agrobot_mj.core.agopengps.layouts import from_compass
from agrobot_mj.extensions.logs.readers.base import Head, LogReader, ReadLog, Samples, text_lines
from agrobot_mj.extensions.logs.readers.sentences import KINDS, found_in

LINE = pattern(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?(?:Z|[+-]\d\d:\d\d)?): ?([${].*)")
"""Regular expression for a line, with groups for time and content."""
FIRST = 20  # Number of lines at the start of a file that determine whether the file has this format


class TimedLines(LogReader):
    """Reader for lines that consist of an ISO time and an NMEA sentence or JSON object."""

    kind: Literal["lines"] = "lines"

    def recognises(self, head: Head) -> bool:
        """Return whether most of the first lines match `LINE`, and at least one of these contains a JSON object."""
        first = [LINE.fullmatch(line.strip()) for line in head.lines[:FIRST]]
        found = [match[2] for match in first if match]
        return 2 * len(found) > len(first) and any(text.startswith("{") for text in found)

    def read(self, path: Path) -> ReadLog:
        """Return the values in all lines. Unreadable lines are omitted and counted."""
        samples = Samples(path)
        for number, line in enumerate(text_lines(path), 1):
            try:
                time, text = LINE.fullmatch(line.strip()).groups()  # type: ignore[union-attr]
                t = datetime.fromisoformat(time).timestamp()
                if text.startswith("{"):
                    samples.add(t, "", **_numbers(json.loads(text)))
                else:
                    for found in found_in(text.encode()):
                        samples.add(t, found.kind, **KINDS[found.kind].quantities(found.fields))
            except (AttributeError, ValueError, IndexError, RecursionError):
                samples.count_damaged(number, line)
        return samples.log(f"sentences ({', '.join(KINDS)}) or JSON objects with numbers", speed={"of": "antenna"})


def _numbers(content: dict[str, object]) -> dict[str, float]:
    """Return the numbers in a JSON object by column name."""
    found = {name: float(value) for name, value in content.items() if type(value) in (int, float)}  # type: ignore[arg-type]
    if "yaw" in found:
        found["heading"] = from_compass(found.pop("yaw"))
    return found
