"""Reader for `gps_data_log.csv`, which AgOpenWeb writes in a debug dump (one minute at 10 Hz).

The position belongs to the rear axle, corrected for roll and drift by AgOpenWeb. The heading in degrees from north is
fused from antennas, inertial unit and course. The speed is in m/s. The roll in degrees is positive with the right side
down, as in the messages of boards. Times of day are UTC, from the clock of the program and not of the receiver. The
steering angle, right positive, is the command of the guidance, because the recorder has no measured angle.
"""

from math import radians
from pathlib import Path
from typing import Literal

from agrobot_mj.core.agopengps.layouts import from_compass
from agrobot_mj.extensions.logs.readers.base import DayClock, Head, LogReader, ReadLog, Samples, text_lines

NEEDED = {"timestamp", "easting", "northing", "heading", "speed", "fix", "steer_angle"}
"""Columns that identify the format. Newer versions append further columns."""


class AgOpenWebRecorder(LogReader):
    """Reader for the CSV file of AgOpenWeb's GPS data recorder: position, heading, speed, commanded wheel angle."""

    kind: Literal["agopenweb"] = "agopenweb"

    def recognises(self, head: Head) -> bool:
        """Return whether the first line contains the column names `NEEDED`."""
        return bool(head.lines) and set(head.lines[0].split(",")) >= NEEDED

    def read(self, path: Path) -> ReadLog:
        """Return the values of all rows. Rows without a fix provide no position, heading or speed."""
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
                samples.count_damaged(number, line)
        return samples.log("rows", position={"up_m": 0.0})
