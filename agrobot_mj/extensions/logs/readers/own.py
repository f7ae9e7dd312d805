"""Readers for files of this program (run folder, `link.parquet`) and for tables with arbitrary columns (CSV,
Parquet)."""

import re
from math import isnan
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.parquet as pq

from agrobot_mj.core.agopengps.messages import SteerState
from agrobot_mj.core.agopengps.position import decode_position as read_position
from agrobot_mj.core.agopengps.traffic import MOST, SCHEMA, read_traffic
from agrobot_mj.core.agopengps.wire import decode
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.core.table_columns import CONTROL, FieldLogError, column_names, is_parquet
from agrobot_mj.extensions.logs.readers.base import Head, LogReader, ReadLog, Samples

DECIMAL = re.compile(r"[+-]?\d+\.\d+(?:[eE][+-]?\d+)?")
"""Pattern of a number, which in the first line of a file indicates missing column names."""


class RunFolder(LogReader):
    """Reader for the folder of a simulated run: measurements of the simulated sensors."""

    kind: Literal["run"] = "run"

    def recognises(self, head: Head) -> bool:
        """Return whether a path is a folder with the signals of a run."""
        return (head.path / "signals.parquet").is_file()

    def read(self, path: Path) -> ReadLog:
        """Return the path of the signals file, which has a built-in column map."""
        return ReadLog(path / "signals.parquet")


class LinkRecord(LogReader):
    """Reader for the record of a link (`link.parquet`): messages from the boards to the guidance program.

    The valve voltage is missing, because the motor output in message 253 has no sign. The yaw rate in PANDA sentences
    is omitted, because its resolution of 1 deg/s is lower than the resolution of the heading derivative.
    """

    kind: Literal["link"] = "link"

    def recognises(self, head: Head) -> bool:
        """Return whether the file is a Parquet file with the columns of a link record."""
        try:
            return is_parquet(head.data) and set(pq.read_schema(head.path.absolute()).names) == set(SCHEMA.names)
        except (pa.ArrowException, OSError, ValueError):
            return False

    def read(self, path: Path) -> ReadLog:
        """Return the quantities in the position sentences and the steering messages (number 253) of the boards."""
        if (rows := pq.read_metadata(path.absolute()).num_rows) > MOST:
            raise FieldLogError(
                f"{path.name}: the file has {rows:.3g} rows, but the limit is {MOST:.3g}; use a shorter run"
            )
        samples = Samples(path)
        for datagram in read_traffic(path):
            if datagram.direction != "out":
                continue
            t = datagram.turn * TICK_S
            if position := read_position(datagram.data):
                s, yaw = position.solution, position.attitude.yaw
                samples.add(t, latitude=s.latitude, longitude=s.longitude, quality=s.quality, speed=s.speed)
                if not isnan(yaw):
                    samples.add(t, heading=yaw)
            elif isinstance(message := decode(datagram.data), SteerState):
                samples.add(t, steer=message.steer)
        return samples.log("position and no message 253 from the boards to the host")


class FreeColumns(LogReader):
    """Reader for a CSV or Parquet file with arbitrary columns: signals of a run, or a user-defined table with a column
    map."""

    kind: Literal["columns"] = "columns"

    def recognises(self, head: Head) -> bool:
        """Return whether the file is a Parquet file, or a text file whose first line contains several names."""
        if is_parquet(head.data):
            return True
        first = head.lines[0] if head.lines else ""
        return (
            any(mark in first for mark in ",;\t")
            and not first.startswith(("$", "<", "\x1b"))
            and not CONTROL.search(first)
            and not head.text_type
        )

    def read(self, path: Path) -> ReadLog:
        """Return the path for reading columns with a column map. Raises `FieldLogError` if the file has no column
        names."""
        names = column_names(path)
        if not any(names) or (number := next(filter(DECIMAL.fullmatch, names), "")):
            found = f"the number {number}" if any(names) else "no names"
            raise FieldLogError(f"{path.name}: the first line has {found}; write the column names in the first line")
        return ReadLog(path)
