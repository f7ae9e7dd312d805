"""Log of a run, with one row per tick.

`Rows` is filled during the run, and `run` returns a `Log`. Units are SI and radians, as in `core.signals`. A missing
value (no fix, no network) is NaN in arrays and null in tables. Rows of long runs are stored in a temporary file
(`long_array`), and tables are built in blocks.
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from agrobot_mj.core.contracts import check_argument
from agrobot_mj.core.errors import suggestion
from agrobot_mj.core.learned import Learned
from agrobot_mj.core.long_array import PIECE, LongArray
from agrobot_mj.core.signals import Array, Column, Vector
from agrobot_mj.metrics.base import RunView
from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.columns import COLUMNS, table
from agrobot_mj.terrain.memory import RutMap

COMMON = len(COLUMNS)  # Number of columns of every log
BLOCK = 32  # Number of rows in a block of a saved log


class SavedRows(NamedTuple):
    """Saved log: full blocks, which the snapshots of a run share, and the remaining rows."""

    filled: int
    blocks: tuple[tuple[Array, Array], ...]
    """Values (BLOCK, columns) and poses (BLOCK, bodies, 7) of the full blocks; read-only."""
    rest: tuple[Array, Array]  # Values and poses of the remaining rows


class Rows:
    """Arrays that store the log of a run, filled row by row."""

    def __init__(self, ticks: int, wheels: int, bodies: int, reported: Sequence[Column] = ()) -> None:
        """Create empty arrays for up to `ticks` rows, with `wheels` wheel signals and the `reported` columns."""
        self.table = table(wheels > 0, reported)
        self.columns = tuple(column.name for column in self.table)
        self.ticks = ticks
        self._values = LongArray(ticks, (len(self.columns),))
        self._poses = LongArray(ticks, (bodies, 7))
        self.filled = 0
        self._blocks: list[tuple[Array, Array]] = []
        self._wheels = slice(COMMON, COMMON + wheels)
        places = [self.columns.index(column.name) for column in reported]
        first = min(places, default=0)
        in_a_row = places == list(range(first, first + len(places)))
        self._reported = slice(first, first + len(places)) if in_a_row else np.array(places, dtype=np.intp)

    def append(self, row: Sequence[float] | Vector, wheels: Array, poses: Array, report: Sequence[float] = ()) -> None:
        """Append the row of a tick: common signals, wheel signals, body poses, and signals reported by the stages."""
        self._make_room(self.filled + 1)
        values = self._values.numbers[self.filled]
        values[:COMMON] = row
        values[self._wheels] = wheels
        if len(self.columns) > COMMON or len(report):
            values[self._reported] = np.frombuffer(array("d", report))
        self._poses.numbers[self.filled] = poses
        self.filled += 1

    @property
    def values(self) -> Array:
        """Values of all columns, shape (ticks, columns), in SI units. Rows with an index of `filled` or more are
        undefined."""
        return self._values.numbers

    @property
    def poses(self) -> Array:
        """Poses of the bodies, shape (ticks, bodies, 7). Rows with an index of `filled` or more are undefined."""
        return self._poses.numbers

    def _make_room(self, end: int) -> None:
        self._values.make_room(end)
        self._poses.make_room(end)

    def release(self) -> None:
        """Free the memory of rows that are stored in a file."""
        self._values.release()
        self._poses.release()

    def save(self) -> SavedRows:
        """Return a copy of the filled rows. Snapshots of a run share full blocks, which are copied only once."""
        whole = self.filled // BLOCK
        for k in range(len(self._blocks), whole):
            self._blocks.append(self._copy(k * BLOCK, (k + 1) * BLOCK))
        return SavedRows(self.filled, tuple(self._blocks), self._copy(whole * BLOCK, self.filled))

    def _copy(self, first: int, end: int) -> tuple[Array, Array]:
        return self.values[first:end].copy(), self.poses[first:end].copy()

    def restore(self, saved: SavedRows) -> None:
        """Restore saved rows of a run of the same scenario. Blocks that are already present are not written."""
        here = self._blocks
        shared = next((k for k, (a, b) in enumerate(zip(here, saved.blocks, strict=False)) if a is not b), None)
        shared = min(len(here), len(saved.blocks)) if shared is None else shared
        self.filled, self._blocks = min(shared * BLOCK, self.filled), list(saved.blocks)
        for values, poses in (*saved.blocks[shared:], saved.rest):
            self.extend(values, poses)

    def extend(self, values: Array, poses: Array) -> None:
        """Append n rows with the column values `values` (n, columns) and the body poses `poses` (n, bodies, 7)."""
        begin, end = self.filled, self.filled + len(values)
        self._make_room(end)
        self.values[begin:end], self.poses[begin:end] = values, poses
        self.filled = end

    def column(self, name: str, first: int = 0) -> Array:
        """Return the values of the column `name` in the filled rows, starting with row `first`; shape (n,), a view."""
        return self.values[first : self.filled, self.columns.index(name)]


class MissingColumnError(ValueError):
    """Error for an unknown column. The message is composed on demand, because metrics often catch the error."""

    def __str__(self) -> str:
        name, known = self.args
        return f"name: there is no column {name!r}{suggestion(name, known)}"


@dataclass(frozen=True)
class Log:
    """Log of a finished run."""

    scenario: Scenario
    rows: Rows
    scene: Scene
    outcome: str  # Outcome of the run, one of `core.signals.Outcome`
    wall_s: float  # Wall time of the run [s]
    metrics: dict[str, Any] = field(default_factory=dict)  # Metrics of the run, see `metrics.metrics`
    ruts: RutMap | None = None  # Ruts at the end of the run, or None on rigid ground
    learned: Learned = field(default_factory=dict)
    """Learned values of guidance law and steering loop, or an empty mapping if neither learns."""
    view: RunView | None = field(default=None, repr=False, compare=False)
    """View of the log from which `metrics` was computed, with positions relative to the path, or None."""

    @cached_property
    def signals(self) -> pa.Table:
        """Table of all signals, one row per tick: float64, null for missing values, with units and descriptions."""
        return self._piece(0, self.rows.filled)

    @property
    def as_expected(self) -> bool:
        """Whether the run ended with the outcome and the stop reason that its scenario expects."""
        return self.scenario.expects(self.outcome, self.metrics.get("stop_reason", ""))

    @property
    def schema(self) -> pa.Schema:
        """Arrow schema of `signals`."""
        return pa.schema(
            pa.field(column.name, pa.float64(), metadata={"unit": column.unit, "description": column.description})
            for column in self.rows.table
        )

    def pieces(self) -> Iterator[pa.Table]:
        """Yield the table `signals` in blocks of PIECE rows."""
        for first in range(0, max(self.rows.filled, 1), PIECE):
            yield self._piece(first, min(first + PIECE, self.rows.filled))
            self.rows.release()

    def _piece(self, first: int, end: int) -> pa.Table:
        arrays = [_arrow(self.rows.values[first:end, k].copy()) for k in range(len(self.rows.columns))]
        return pa.Table.from_arrays(arrays, schema=self.schema)

    @property
    def rut_table(self) -> pa.Table | None:
        """Table of the ground cells with sinkage, or None on rigid ground. The metadata contain the cell size [m]."""
        if self.ruts is None:
            return None
        columns = {
            "x": (self.ruts.x, "Middle of the cell, east"),
            "y": (self.ruts.y, "Middle of the cell, north"),
            "depth": (self.ruts.depth, "Plastic sinkage of the soil"),
        }
        fields = [
            pa.field(name, pa.float32(), metadata={"unit": "m", "description": text})
            for name, (_, text) in columns.items()
        ]
        arrays = [_arrow(values.astype(np.float32)) for values, _ in columns.values()]
        return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={"cell_m": f"{self.ruts.cell:g}"}))

    @property
    def poses(self) -> Array:
        """Poses of the bodies of the scene, shape (ticks, bodies, 7): x, y, z [m] and quaternion w, x, y, z."""
        return self.rows.poses[: self.rows.filled]

    def column(self, name: str) -> Array:
        """Return the values of the column `name`, shape (ticks,).

        Raises ValueError for an unknown name, and TypeError if `name` is not a string.
        """
        check_argument("name", name, isinstance(name, str), "the name of a column")
        if name not in self.rows.columns:
            raise MissingColumnError(name, self.rows.columns)
        self.rows.release()
        return self.rows.column(name)


def _arrow(values: np.ndarray[tuple[int, ...], np.dtype[np.floating]]) -> pa.Array:
    """Return the contiguous `values` (n,) as an Arrow array with null for NaN, without copying. `pa.array` would import
    pandas if installed, which takes 46 MB and almost 1 s."""
    absent = np.isnan(values)
    count = int(absent.sum())
    valid = pa.py_buffer(np.packbits(~absent, bitorder="little")) if count else None
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [valid, pa.py_buffer(values)], count)
