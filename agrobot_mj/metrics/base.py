"""Input of every metric: the log of a run, its path, its turns, and the position of the tractor relative to the path.

A metric is a function `RunView -> dict`, ready for JSON: lengths in metres, angles in radians. Values that are absent
or not finite are left out of a statistic; one of fewer than LEAST values is None. Signals of a long run are read chunk
by chunk (`core.chunked`), so that a day of work takes no more memory than an hour.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from math import isfinite
from typing import Literal, NamedTuple, Protocol

import numpy as np

from agrobot_mj.core.chunked import Chunked
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spill import Spilled
from agrobot_mj.metrics.crosstrack import PIECE, track
from agrobot_mj.paths import Path

LEAST = 20
"""Number of values from which a statistic says something: a second of ticks. Estimate."""

RowChoice = slice | np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
"""Rows of a log: a piece of it, or a mask of shape (ticks,)."""

Values = Array | Chunked
"""Values of shape (ticks,), in memory or read in chunks."""


class HasPath(Protocol):
    """The part of a scenario that the metrics need."""

    @property
    def path(self) -> Path:
        """The reference path."""
        ...

    @property
    def duration_s(self) -> float | None:
        """Planned duration; the path's own when None [s]."""
        ...


class LogLike(Protocol):
    """The part of a log that the metrics and the figures need; one with a method `chunked(name)` is read in chunks."""

    @property
    def scenario(self) -> HasPath:
        """The scenario that was run."""
        ...

    def column(self, name: str) -> Array:
        """One signal, shape (ticks,), NaN where absent."""
        ...


class BesideRun(NamedTuple):
    """`crosstrack.BesidePath` of a complete run."""

    offset: Chunked
    """Signed distance from the path, left positive [m]."""
    time: Chunked
    """Time at which the reference passes the nearest point [s]."""


class RunView:
    """A log, and what several metrics derive from it."""

    def __init__(self, log: LogLike) -> None:
        self.log, self.path = log, log.scenario.path

    def column(self, name: str) -> Array:
        """One signal, shape (ticks,), NaN where absent."""
        return self.log.column(name)

    def chunked(self, name: str) -> Chunked:
        """One signal, read in chunks; raises as `column`."""
        find = getattr(self.log, "chunked", None)
        found: Chunked = find(name) if find else Chunked.of(self.log.column(name))
        return found

    @cached_property
    def beside(self) -> BesideRun:
        """Position of the true CG relative to the path at each tick."""
        return self.beside_path("x", "y")

    def beside_path(self, x: str, y: str) -> BesideRun:
        """Position relative to the path of the point with these columns; of a long run it lies in a temporary file."""
        columns = [self.chunked(name) for name in ("t", x, y)]
        ticks = len(columns[0])
        found = Spilled(ticks, (2,))
        for first in range(0, ticks, PIECE):
            piece = track(self.path, *(column[first : first + PIECE].whole() for column in columns))
            found.put(first, np.column_stack(piece))
        return BesideRun(found.chunked(0, ticks), found.chunked(1, ticks))

    @cached_property
    def turns(self) -> list[slice]:
        """For each turn that the run reached, the rows that belong to it; time grows from row to row."""
        t, spans = self.chunked("t"), self.path.turns_s
        starts, ends = [start for start, _ in spans], [end for _, end in spans]
        firsts = [*rows_until(t, starts[:1], "left"), *rows_until(t, starts[1:])]
        return [slice(first, end) for first, end in zip(firsts, rows_until(t, ends), strict=True) if end > first]


def rows_until(t: Chunked, times: Sequence[float], side: Literal["left", "right"] = "right") -> list[int]:
    """How many rows are not later than each of `times`, or earlier with `left`; `t` grows from row to row."""
    counts = np.zeros(len(times), dtype=int)
    for chunk in t:
        counts += np.searchsorted(chunk, times, side)
    return counts.tolist()


def chunks(values: Values) -> Iterable[Array]:
    """The values in chunks; one if they are in memory."""
    return values if isinstance(values, Chunked) else [values]


def mean(values: Values, power: int = 1) -> float | None:
    """Mean of the finite values to a power; None of fewer than LEAST (or beyond the range of a float)."""
    return _average(chunk**power for chunk in _finite(values))


def mean_magnitude(values: Values) -> float | None:
    """Mean magnitude of the finite values; None of fewer than LEAST."""
    return _average(np.abs(chunk) for chunk in _finite(values))


def rms(values: Values) -> float | None:
    """Root mean square of the finite values; None of fewer than LEAST."""
    mean_square = mean(values, 2)
    return None if mean_square is None else mean_square**0.5


def abs_p95(values: Values) -> float | None:
    """95th percentile of the magnitudes of the finite values, as `np.percentile` has it; None of fewer than LEAST.

    Between the values of rank floor(r) and ceil(r), r = 0.95 (n - 1): only the largest twentieth is held.
    """
    count = sum(chunk.size for chunk in _finite(values))
    if count < LEAST:
        return None
    rank = 0.95 * (count - 1)
    held, largest = count - int(rank), np.empty(0)
    for chunk in _finite(values):
        largest = np.concatenate((largest, np.abs(chunk)))
        if largest.size > held:
            largest = np.partition(largest, -held)[-held:]
    share, above = rank % 1, min(1, held - 1)
    low, high = np.partition(largest, above)[[0, above]].tolist()
    return float(low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share))


def _finite(values: Values) -> Iterator[Array]:
    """The finite ones of each chunk."""
    return (chunk[np.isfinite(chunk)] for chunk in chunks(values))


def _average(parts: Iterable[Array]) -> float | None:
    """Mean of all terms; None of fewer than LEAST, or beyond the range of a float."""
    total, count = 0.0, 0
    with np.errstate(over="ignore"):
        for terms in parts:
            total, count = total + float(np.sum(terms)), count + terms.size
    average = total / count if count >= LEAST else np.nan
    return average if isfinite(average) else None
