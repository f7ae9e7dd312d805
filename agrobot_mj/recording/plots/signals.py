"""Recorder of the plots of a run, as defined by `catalogue`.

The entity `plots/<path>` contains the series of one plot. Series are sent as columns, which is ten times as fast as
sending rows. Rows with a missing value are omitted; therefore signals that may be missing have separate plots. At the
end of the run, a bold moving mean is added to noisy series, in the entity `plots/<path>/mean`.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
from rerun.components import ScalarBatch

from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.core.smoothing import moving_mean
from agrobot_mj.recording.plots.axes import Frame, frame
from agrobot_mj.recording.plots.catalogue import DRIVE, PLOTS, Plot, estimation_errors, shown_by
from agrobot_mj.recording.transport.timeline import TIMELINE, Index, Times, data_column, nanoseconds
from agrobot_mj.simulation.log import Rows

SETTLED_S = 5.0  # Time after which axes include the bounds of the estimate [s]. The initial bounds are wide.
SCALARS = rr.Scalars.descriptor_scalars()
WIDTH, PALE_WIDTH, BOLD_WIDTH, WIDER = 1.5, 1.0, 2.5, 1.25
"""Line widths of a signal, of a signal with moving mean, and of the mean; increase per step of `wider` [pixels]."""
PALE = 0x48  # Opacity of a signal that has a mean, out of 0xFF
MEAN_S = 2.0  # Window length of the moving mean [s]: two furrows of 0.75 m at 0.8 m/s
MEAN_TICKS = 5  # Number of ticks between points of the moving mean
MEAN = "mean"  # Name of the entity with the moving means, below the entity of the plot
WINDOWS = 100
"""Number of time windows in which the noise of a run is evaluated. In the plot a window is 6 pixels wide, so that noisy
lines overlap."""
MOST_NOISE = 0.1
"""Noise above which a moving mean is drawn [-]: mean noise amplitude in the noisier half of the windows, divided by the
signal range. Assumed value."""


class _Lines(NamedTuple):
    """Plot with the log columns and conversion factors of its series."""

    plot: Plot
    columns: Index  # Column of each series in the table of all signals
    factors: Array  # Factor of each series from the SI unit of the log to the unit of the plot, including the sign


class Signals:
    """Recorder that sends the plotted signals to a recording, in blocks of log rows."""

    def __init__(self, rows: Rows, more: Sequence[Plot] = (), without: Collection[str] = ()) -> None:
        """Select the catalogue plots and the plots `more` whose columns are logged; omit the columns `without`."""
        self.rows, self.shown = rows, list[Plot]()
        known = {name: k for k, name in enumerate((*rows.columns, *estimation_errors(rows, 0)))}
        self.lines = [
            _Lines(
                plot,
                np.array([known[series.column] for series in plot.series]),
                np.array([plot.factor * series.sign for series in plot.series]),
            )
            for each in (*PLOTS, *more)
            if (plot := each._replace(series=tuple(s for s in each.series if s.column not in without))).series
            if shown_by(plot, known)
        ]

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the log rows from `first` to `rows.filled`. `times` (n,) are the times of the rows."""
        table = self._table(first)
        finite, turns = np.isfinite(table), first + np.arange(len(times))
        clocks: dict[bytes, rr.TimeColumn] = {}
        for plot, columns, factors in self.lines:
            there = finite[:, columns].all(axis=1) & (turns % plot.every == 0)
            if not there.any():
                continue
            if plot not in self.shown:
                self.shown.append(plot)
                stream.log(plot.entity, style(plot), static=True)
            which = there.tobytes()
            if which not in clocks:
                clocks[which] = rr.TimeColumn(TIMELINE, duration=times[there])
            _send(stream, plot.entity, clocks[which], table[:, columns][there] * factors)

    def finish(self, stream: rr.RecordingStream) -> dict[str, Frame]:
        """Send the moving means of noisy signals; return the axes of all plots with varying values, by plot path."""
        found, t, width = dict[str, Frame](), self.rows.column("t"), len(self.rows.columns)
        for plot, columns, factors in self.lines:
            if plot not in self.shown:
                continue
            further = self._errors(0) if columns.max() >= width else []
            of_plot = [self.rows.values[: len(t), k] if k < width else further[k - width] for k in columns.tolist()]
            values = np.column_stack(of_plot)
            self.rows.release()
            numbers = np.where(np.isfinite(values), values * factors, np.nan)
            if not _varies(numbers):
                continue
            means = None if plot.steps else noisy_means(numbers)
            if means is not None:
                send_means(stream, plot, t, means)
            bounds = [series.column.startswith("bound_") for series in plot.series]
            numbers[np.outer(t < SETTLED_S, bounds)] = np.nan
            found[plot.path] = frame(t, numbers, plot, plot.path.startswith(DRIVE))._replace(
                mean_s=None if means is None else MEAN_S
            )
        return found

    def _table(self, first: int) -> Array:
        return np.column_stack([self.rows.values[first : self.rows.filled], *self._errors(first)])

    def _errors(self, first: int) -> list[Array]:
        with np.errstate(over="ignore", invalid="ignore"):  # diverged runs may contain infinite values
            return list(estimation_errors(self.rows, first).values())


def _send(stream: rr.RecordingStream, entity: str, column: rr.TimeColumn, numbers: Array) -> None:
    scalars = data_column(SCALARS, ScalarBatch(numbers.ravel()), numbers.shape[1])
    stream.send_columns(entity, [column], [scalars])


def _varies(numbers: Array) -> bool:
    columns = [column[np.isfinite(column)] for column in numbers.T]
    return any(column.size > 0 and column.max() > column.min() for column in columns)


def noisy_means(numbers: Array) -> Array | None:
    """Return the moving means of `numbers` (rows, series), or None if no series is noisy. Missing values give NaN."""
    finite = np.isfinite(numbers)
    span = np.max(numbers, where=finite, initial=-np.inf) - np.min(numbers, where=finite, initial=np.inf)
    if len(numbers) < 2 * WINDOWS or not 0 < span < np.inf:
        return None
    means = np.column_stack([moving_mean(column, round(MEAN_S / TICK_S)) for column in numbers.T])
    swing, starts = numbers - means, np.linspace(0, len(numbers), WINDOWS, endpoint=False).astype(int)
    extent = np.nan_to_num(np.fmax.reduceat(swing, starts) - np.fmin.reduceat(swing, starts)) / span
    noise = np.sort(extent, axis=0)[WINDOWS // 2 :].mean(axis=0).max()
    return np.where(finite, means, np.nan) if noise > MOST_NOISE else None


def send_means(stream: rr.RecordingStream, plot: Plot, t: Array, means: Array) -> None:
    """Send the moving `means` (rows, series) of a noisy plot, and reduce the opacity of its signals."""
    there = np.isfinite(means).all(axis=1) & (np.arange(len(t)) % MEAN_TICKS == 0)
    entity = f"{plot.entity}/{MEAN}"
    stream.log(plot.entity, style(plot, PALE, PALE_WIDTH), static=True)
    # A signal and its mean have the same name. The legend then has one entry, in the colour of the mean.
    stream.log(entity, style(plot, width=BOLD_WIDTH), static=True)
    _send(stream, entity, rr.TimeColumn(TIMELINE, duration=nanoseconds(t[there])), means[there])


def style(plot: Plot, opacity: int = 0xFF, width: float = WIDTH) -> rr.SeriesLines:
    """Return names, colours and widths of the lines of a plot. All spikes remain visible in a zoomed-out plot."""
    colours = [series.colour & ~0xFF | opacity for series in plot.series]
    return rr.SeriesLines(
        names=plot.names,
        colors=np.array(colours, dtype=np.uint32),
        widths=[width + WIDER * series.wider for series in plot.series],
        aggregation_policy=rr.components.AggregationPolicy.MinMax,
        interpolation_mode=rr.components.InterpolationMode.StepAfter if plot.steps else None,
    )
