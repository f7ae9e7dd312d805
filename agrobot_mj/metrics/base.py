"""Input of every metric: the log of a run, its path, its turns, and the position of the tractor relative to the path.

A metric is a function `RunView -> dict`, ready for JSON: lengths in metres, angles in radians. Values that are absent
or not finite are left out of a statistic; a statistic without a single value is None.
"""

from functools import cached_property
from math import isfinite
from typing import Protocol

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.crosstrack import BesidePath, track
from agrobot_mj.paths import Path

RowChoice = slice | np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
"""Rows of a log: a piece of it, or a mask of shape (ticks,)."""


class HasPath(Protocol):
    """The part of a scenario that the metrics need."""

    @property
    def path(self) -> Path:
        """The reference path."""
        ...


class LogLike(Protocol):
    """The part of a log that the metrics and the figures need."""

    @property
    def scenario(self) -> HasPath:
        """The scenario that was run."""
        ...

    def column(self, name: str) -> Array:
        """One signal, shape (ticks,), NaN where absent."""
        ...


class RunView:
    """A log, and what several metrics derive from it."""

    def __init__(self, log: LogLike) -> None:
        self.log, self.path = log, log.scenario.path

    def column(self, name: str) -> Array:
        """One signal, shape (ticks,), NaN where absent."""
        return self.log.column(name)

    @cached_property
    def beside(self) -> BesidePath:
        """Position of the true CG relative to the path at each tick."""
        return track(self.path, self.column("t"), self.column("x"), self.column("y"))

    @cached_property
    def turns(self) -> list[slice]:
        """For each turn that the run reached, the rows that belong to it; time grows from row to row."""
        t, rows = self.column("t"), []
        for k, (start, end) in enumerate(self.path.turns_s):
            first = np.searchsorted(t, start, "right" if k else "left")
            rows.append(slice(int(first), int(np.searchsorted(t, end, "right"))))
        return [of_turn for of_turn in rows if of_turn.stop > of_turn.start]


def mean(values: Array, power: int = 1) -> float | None:
    """Mean of the finite values to a power; None if there are none (or beyond the range of a float)."""
    with np.errstate(over="ignore"):
        terms = values[np.isfinite(values)] ** power
        average = float(np.mean(terms)) if terms.size else np.nan
    return average if isfinite(average) else None


def rms(values: Array) -> float | None:
    """Root mean square of the finite values; None if there are none."""
    mean_square = mean(values, 2)
    return None if mean_square is None else mean_square**0.5


def abs_p95(values: Array) -> float | None:
    """95th percentile of the magnitudes of the finite values; None if there are none."""
    finite = np.abs(values[np.isfinite(values)])
    return float(np.percentile(finite, 95)) if finite.size else None
