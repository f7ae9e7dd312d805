"""Base class of metrics, their input (log, path and laps of a run), and statistics of signals.

Lengths are in metres, and angles in radians. Statistics ignore missing and infinite samples, and are None for fewer
than LEAST samples.
"""

from collections.abc import Sequence
from functools import cached_property
from math import isfinite
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.core.spec import Spec
from agrobot_mj.metrics.crosstrack import BesidePath, track
from agrobot_mj.metrics.progress import PathProgress, progress_of
from agrobot_mj.paths import Path
from agrobot_mj.paths.route import SampledRoute

LEAST = 20  # Minimum number of samples for a statistic: the ticks of one second. Assumed value.

RowChoice = slice | np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
"""Selection of log rows: a slice, or a mask of shape (ticks,)."""


class HasPath(Protocol):
    """Protocol of a scenario with the attributes that metrics use."""

    @property
    def path(self) -> Path:
        """Reference path of the scenario."""
        ...

    @property
    def duration_s(self) -> float | None:
        """Planned duration of the run [s]; None stands for the duration of the path."""
        ...


class LogLike(Protocol):
    """Protocol of a log with the attributes that metrics and figures use."""

    @property
    def scenario(self) -> HasPath:
        """Scenario of the run."""
        ...

    def column(self, name: str) -> Array:
        """Return the samples of the signal `name`, shape (ticks,), with NaN for missing samples."""
        ...


class RunView:
    """Log of a run, with quantities that several metrics use. By default `route` samples the path of the scenario."""

    def __init__(self, log: LogLike, route: SampledRoute | None = None) -> None:
        self.log, self.path = log, log.scenario.path
        self.route = route or SampledRoute(self.path)

    def column(self, name: str) -> Array:
        """Return the samples of the signal `name`, shape (ticks,), with NaN for missing samples."""
        return self.log.column(name)

    def reported_samples(self, name: str) -> Array | None:
        """Return the samples of the signal `name`, shape (ticks,), or None if the log does not contain the signal."""
        try:
            return self.column(name)
        except (KeyError, ValueError):
            return None

    @cached_property
    def cg_on_path(self) -> BesidePath:
        """Position of the true CG relative to the path at each tick."""
        return self.beside_path("x", "y")

    @cached_property
    def progress(self) -> PathProgress:
        """Driven length of the path up to the end of the run."""
        return progress_of(self.route, self.log.scenario.duration_s, [self.column(name) for name in ("t", "x", "y")])

    def beside_path(self, x: str, y: str) -> BesidePath:
        """Return the position of a point relative to the path. `x` and `y` are the log columns of its coordinates."""
        return track(self.path, self.column("t"), self.column(x), self.column(y), self.route)

    @cached_property
    def turns(self) -> list[slice]:
        """Rows of the log in each lap that the run reached, as slices."""
        t, spans = self.column("t"), self.path.turns_s
        starts, ends = [start for start, _ in spans], [end for _, end in spans]
        firsts = [*rows_until(t, starts[:1], "left"), *rows_until(t, starts[1:])]
        return [slice(first, end) for first, end in zip(firsts, rows_until(t, ends), strict=True) if end > first]


class Metric(Spec):
    """Base class of metrics of a finished run; subclasses override `evaluate`."""

    kind: str
    columns: ClassVar[tuple[Column, ...]] = ()
    """Name, unit and description of each number of the metric. A number inside a table is named `table.number`."""

    @property
    def names(self) -> set[str]:
        """Names of the numbers and tables that `evaluate` may return."""
        return {column.name.partition(".")[0] for column in self.columns}

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the metric as JSON values by name, or an empty dict if the metric does not apply to the run."""
        raise NotImplementedError


def rows_until(t: Array, times: Sequence[float], side: Literal["left", "right"] = "right") -> list[int]:
    """Return the number of rows at or before each time in `times`; the times `t` of the rows increase.

    With `side` = "left", rows exactly at the time do not count.
    """
    counts: list[int] = np.searchsorted(t, times, side).tolist()
    return counts


def mean(values: Array, power: int = 1) -> float | None:
    """Return the mean of the finite values, each raised to `power`; None for fewer than LEAST values or on overflow."""
    return _average(_finite(values), power)


def mean_magnitude(values: Array) -> float | None:
    """Return the mean magnitude of the finite values; None for fewer than LEAST values or on overflow."""
    return _average(np.abs(_finite(values)))


def rms(values: Array) -> float | None:
    """Return the root mean square of the finite values; None for fewer than LEAST values or on overflow."""
    mean_square = mean(values, 2)
    return None if mean_square is None else mean_square**0.5


def abs_p95(values: Array) -> float | None:
    """Return the 95th percentile of the magnitudes of the finite values, or None for fewer than LEAST values."""
    finite = _finite(values)
    return float(np.percentile(np.abs(finite), 95)) if finite.size >= LEAST else None


def abs_max(values: Array) -> float | None:
    """Return the maximum magnitude of the finite values, or None for fewer than LEAST values."""
    finite = _finite(values)
    return float(np.abs(finite).max()) if finite.size >= LEAST else None


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def _average(values: Array, power: int = 1) -> float | None:
    if values.size < LEAST:
        return None
    with np.errstate(over="ignore"):
        average = float(np.sum(values**power)) / values.size
    return average if isfinite(average) else None
