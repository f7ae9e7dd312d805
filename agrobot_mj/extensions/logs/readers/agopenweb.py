"""Return a value rounded to the second significant digit of a half width, or to six digits without an interval."""

from math import radians
from pathlib import Path
from typing import Literal

from agrobot_mj.core.agopengps.layouts import from_compass
from agrobot_mj.extensions.logs.readers.base import DayClock, Head, LogReader, ReadLog, Samples, text_lines

NEEDED = {"timestamp", "easting", "northing", "heading", "speed", "fix", "steer_angle"}
"""Columns that identify the format. Newer versions append further columns."""


class AgOpenWebRecorder(LogReader):
    """CSV file of AgOpenWeb's GPS data recorder: position, heading, speed, commanded wheel angle."""

    kind: Literal["agopenweb"] = "agopenweb"

    def recognises(self, head: Head) -> bool:
        """Return whether the first line contains the columns of the recorder."""
        return bool(head.lines) and set(head.lines[0].split(",")) >= NEEDED

    def read(self, path: Path) -> ReadLog:
        """Return the rows of the file. Rows without a fix have only a quality."""
        samples, lines, clock = Samples(path), text_lines(path), DayClock()
        names = next(lines).strip().split(",")
        for number, line in enumerate(lines, 2):
            cells = line.strip().split(",")
            row = dict(zip(names, cells, strict=False))
            try:
                if len(cells) != len(names):
                    raise ValueError(line)
                t, quality = clock.at(row["timestamp"]), int(row["fix"])
                samples.add(t, quality=quality)
                if row.get("has_guidance", "1") == "1":
                    samples.add(t, steer_demand=-radians(float(row["steer_angle"])))
                if quality:
                    samples.add(
                        t,
                        east=float(row["easting"]),
                        north=float(row["northing"]),
                        heading=from_compass(float(row["heading"])),
                        speed=float(row["speed"]),
                        roll=radians(float(row.get("roll") or "nan")),
                    )
            except ValueError:
                samples.damaged(number, line)
        return samples.log("rows", position={"up_m": 0.0})
