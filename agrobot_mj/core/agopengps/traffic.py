"""Record of all datagrams between the simulator and a guidance program: `link.parquet`, the input of `--replay`.

Columns:

- `t` [s]: run time at which the datagram could first take effect; negative while the tractor waits for the host.
- `wall_s` [s]: wall time since the link opened.
- `direction`: `in` (from the guidance program, the host) or `out` (to the host).
- `address`: network address of the sender or receiver.
- `bytes`: content of the datagram.

The metadata key `scenario` contains the resolved scenario as TOML.
"""

from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import absence
from agrobot_mj.core.signals import TICK_S

MOST = 2_000_000  # Maximum number of datagrams in a record; further datagrams are only counted
SCHEMA = pa.schema(
    {"t": pa.float64(), "wall_s": pa.float64(), "direction": pa.string(), "address": pa.string(), "bytes": pa.binary()}
)


SCENARIO = b"scenario"


class Datagram(NamedTuple):
    """Recorded datagram between the simulator and a guidance program."""

    turn: int  # Index of the link cycle in which the datagram could first take effect
    wall: float  # Wall time since the link opened [s]
    direction: str  # Direction: `in` from the host, `out` to the host
    address: str
    data: bytes


class Traffic:
    """Recorder of the datagrams between the simulator and a guidance program."""

    def __init__(self) -> None:
        self.kept: list[Datagram] = []
        self.dropped = 0

    def add(self, datagram: Datagram) -> None:
        """Record a datagram, or only count it if the record is full."""
        if len(self.kept) < MOST:
            self.kept.append(datagram)
        else:
            self.dropped += 1

    def table(self, start: int, scenario: str = "") -> pa.Table:
        """Return the datagrams as a table, with t = 0 in link cycle `start` and the text `scenario` (TOML) as
        metadata."""
        rows = [((d.turn - start) * TICK_S, *d[1:]) for d in self.kept]
        columns = zip(*rows, strict=True) if rows else ((),) * len(SCHEMA)
        schema = SCHEMA.with_metadata({SCENARIO: scenario.encode()} if scenario else None)
        return pa.table([pa.array(c, f.type) for c, f in zip(columns, SCHEMA, strict=True)], schema=schema)


def read_traffic(path: Path) -> list[Datagram]:
    """Return the datagrams in a `link.parquet`, with link cycles counted from 0. Raises `ScenarioError` for an invalid
    file."""
    if not path.is_file():
        fix = "specify the link.parquet of an earlier run with --replay"
        raise ScenarioError(f"{path}: {absence(path, fix)}")
    try:
        table = pq.read_table(path.absolute(), columns=SCHEMA.names).cast(SCHEMA)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ScenarioError(f"{path}: this is not the link.parquet of a run: {str(error).splitlines()[0]}") from None
    rows = list(zip(*(column.to_pylist() for column in table.columns), strict=True))
    if any(None in row for row in rows):
        raise ScenarioError(f"{path}: this is not the link.parquet of a run: it has empty cells")
    turns = [round(row[0] / TICK_S) for row in rows]
    first = min(turns, default=0)
    return [Datagram(turn - first, *row[1:]) for turn, row in zip(turns, rows, strict=True)]
