"""A link's record as a log: what its boards told the host, decoded, one row for each instant.

Columns `t` [s]; from position sentences `latitude`, `longitude` [deg], `quality` as in GGA, `speed` [m/s], and where
there are two antennas or an inertial unit `yaw` [rad, ENU]; from message 253 `steer` [rad, left positive]. Null where
an instant has none. The drive of message 253 is a magnitude without direction: no valve can be replayed from it.
"""

from math import isnan
from pathlib import Path

import pyarrow as pa

from agrobot_mj.core.agopengps.messages import SteerState
from agrobot_mj.core.agopengps.position import read
from agrobot_mj.core.agopengps.traffic import SCHEMA, read_traffic
from agrobot_mj.core.agopengps.wire import decode
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S

COLUMNS = ("t", "steer", "latitude", "longitude", "quality", "speed", "yaw")
"""Columns of the log; `yaw` only where it was sent."""


def is_link_record(names: list[str]) -> bool:
    """Whether these are the columns of a `link.parquet`."""
    return set(names) == set(SCHEMA.names)


def link_log(path: Path) -> pa.Table:
    """The log in a `link.parquet`. Raises `ScenarioError` for a file that is none, or holds no positions."""
    rows: dict[int, dict[str, float]] = {}
    for datagram in read_traffic(path):
        if datagram.direction != "out":
            continue
        row = rows.setdefault(datagram.turn, {"t": datagram.turn * TICK_S})
        if position := read(datagram.data):
            s = position.solution
            row |= {"latitude": s.latitude, "longitude": s.longitude, "quality": s.quality, "speed": s.speed}
            if not isnan(position.attitude.yaw):
                row["yaw"] = position.attitude.yaw
        elif isinstance(message := decode(datagram.data), SteerState):
            row["steer"] = message.steer
    if not any("latitude" in row for row in rows.values()) or not any("steer" in row for row in rows.values()):
        raise ScenarioError(f"{path.name}: holds no position and no message 253 from the boards to the host")
    ordered = [rows[turn] for turn in sorted(rows)]
    names = COLUMNS if any("yaw" in row for row in ordered) else COLUMNS[:-1]
    return pa.table({name: pa.array([row.get(name) for row in ordered], pa.float64()) for name in names})
