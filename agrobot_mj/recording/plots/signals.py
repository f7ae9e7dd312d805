"""The plots of a recording: which signals, in which unit, name and colour.

One entity `plots/<path>` holds the series of one plot, sent as columns: row by row costs ten times as much.
A row where a series has no value is left out, so a signal that may be absent has a plot to itself.
"""

from collections.abc import Sequence
from math import degrees, pi
from typing import NamedTuple

import numpy as np
import rerun as rr
from rerun.components import ScalarBatch

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.recording.plots.axes import Range, value_range
from agrobot_mj.recording.transport.timeline import TIMELINE, Index, Times, partitioned
from agrobot_mj.simulation.log import Rows

Early = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
UNITS = {
    **{"m": 1.0, "m/s": 1.0, "V": 1.0, "-": 1.0, "cm": 100.0, "kN": 1e-3, "%": 100.0},
    **{"deg": degrees(1), "deg/s": degrees(1), "deg/s2": degrees(1), "l/min": 6e4, "bar": 1e-5, "N m": 1.0},
}
"""Factor from the SI unit of the log."""
TRUE, MEASURED, WANTED = 0x56B4E9FF, 0xE69F00FF, 0x999999FF
"""Sky blue, orange and grey, of the colour-blind-safe palette of Okabe and Ito, as are the others."""
PD, NETWORK, BOUND = 0xD55E00FF, 0x3A9BDCFF, 0x8A8A8AFF
SETTLED_S = 5.0
"""From then on the axis shows the bounds of the estimate, which begin far away [s]."""
SCALARS = rr.Scalars.descriptor_scalars()
WHEEL_COLOURS = (0x56B4E9FF, 0xE69F00FF, 0x009E73FF, 0xCC79A7FF)


class Series(NamedTuple):
    """One line of a plot."""

    label: str
    column: str
    """Of the log, or of `derived`."""
    colour: int
    """0xRRGGBBAA."""
    sign: float = 1.0


class Plot(NamedTuple):
    """The series of one entity, all in the same unit."""

    path: str
    title: str
    unit: str
    series: tuple[Series, ...]
    every: int = 1
    """Ticks from one point to the next; more than one for what moves slowly."""
    includes: tuple[float, ...] = ()
    """Values that the axis shows in any case."""
    may_be_cut: bool = False
    """Whether the axis may end below rare values that would flatten the others."""
    steps: bool = False
    """Whether the values stay from one point to the next."""

    @property
    def entity(self) -> str:
        """Where the plot is in the recording."""
        return f"plots/{self.path}"

    @property
    def names(self) -> list[str]:
        """Of the series, with unit."""
        return [f"{series.label} [{self.unit}]" for series in self.series]


def _loop(path: str, title: str, unit: str, wanted: str, measured: str, true: str) -> Plot:
    reference, sensed = Series("reference", wanted, WANTED), Series("measured", measured, MEASURED)
    return Plot(path, title, unit, (reference, sensed, Series("true", true, TRUE)))


def _estimated(name: str, title: str, unit: str) -> Plot:
    error = Series("error", f"error_{name}", MEASURED)
    bounds = Series("+3 sigma", f"bound_{name}", BOUND), Series("-3 sigma", f"bound_{name}", BOUND, -1.0)
    return Plot(f"estimator/{name}", title, unit, (*bounds, error))


def _wheels(path: str, title: str, unit: str, quantity: str) -> Plot:
    series = (Series(wheel, f"{quantity}_{wheel}", c) for wheel, c in zip(WHEELS, WHEEL_COLOURS, strict=True))
    return Plot(f"tyres/{path}", title, unit, tuple(series))


def _single(path: str, title: str, unit: str, label: str, column: str, colour: int = MEASURED) -> Plot:
    return Plot(path, title, unit, (Series(label, column, colour),))


_ERRORS = Series("longitudinal", "e_longitudinal", MEASURED), Series("lateral", "e_lateral", TRUE)
_COMMAND = (
    *(Series("total", "steer_ref", WANTED), Series("PD tau_c", "tau_c", PD)),
    Series("network -tau_n", "tau_n", NETWORK, -1.0),
)
_ATTITUDE = Series("roll, left up", "roll", TRUE), Series("pitch, nose down", "pitch", MEASURED)

PLOTS = (
    Plot("tracking/error", "Tracking error", "m", _ERRORS),
    _loop("yaw_rate/loop", "Yaw rate", "deg/s", "yaw_rate_ref", "yaw_rate_hat", "yaw_rate"),
    _single("yaw_rate/error", "Yaw rate: reference less measured", "deg/s", "error", "e_yaw_rate"),
    Plot("control/command", "Steering command: PD and network", "deg", _COMMAND),
    _loop("steering/angle", "Steering angle", "deg", "steer_ref", "steer_measured", "steer"),
    _single("steering/valve", "Steering valve", "V", "voltage", "valve_voltage"),
    _single("steering/flow", "Oil flow to the cylinder", "l/min", "flow", "valve_flow"),
    _single("steering/pressure", "Pressure in the cylinder", "bar", "pressure", "steer_pressure", TRUE),
    _loop("speed/loop", "Speed", "m/s", "speed_ref", "speed_hat", "speed"),
    _loop("speed/pedal", "Pedal", "-", "pedal_ref", "pedal_measured", "pedal"),
    _single("speed/valve", "Pedal valve", "V", "voltage", "pedal_voltage"),
    _single("speed/torque", "Torque on the driven wheels", "N m", "torque", "drive_torque", TRUE),
    _wheels("load", "Wheel load", "kN", "load"),
    _wheels("friction_use", "Friction used: force over what the ground can hold", "-", "friction_use"),
    _wheels("slip_angle", "Slip angle", "deg", "slip_angle"),
    _wheels("slip_ratio", "Slip ratio", "%", "slip_ratio"),
    _wheels("longitudinal_force", "Longitudinal force", "kN", "fx"),
    _wheels("lateral_force", "Lateral force", "kN", "fy"),
    _estimated("east", "East of R: estimate less truth", "cm"),
    _estimated("north", "North of R: estimate less truth", "cm"),
    _estimated("yaw", "Yaw: estimate less truth", "deg"),
    _single("estimator/speed", "Speed: estimate less truth", "m/s", "error", "error_speed"),
    _single("estimator/nees", "NEES of the position (2 on average if consistent)", "-", "NEES", "position_nees"),
    _single("estimator/nis", "NIS of the position fixes (2 on average if consistent)", "-", "NIS", "position_nis"),
    _single("estimator/bias", "Bias of the steering sensor: estimate", "deg", "estimate", "steer_bias_hat"),
    _single("estimator/faults", "Faults that act", "-", "faults", "faults_active")._replace(
        includes=(0, 1), steps=True
    ),
    _single("estimator/quality", "GNSS quality (2 fix, 1 float, 0 none)", "-", "quality", "gnss_quality")._replace(
        includes=(0, 2), steps=True
    ),
    Plot("attitude", "Attitude", "deg", _ATTITUDE),
)
"""Every plot but those of the network, in the order of the tabs."""


def derived(rows: Rows, first: int) -> dict[str, Array]:
    """What the log implies, from row `first` on: errors of the estimate and their 3 sigma, SI units."""

    def of(name: str) -> Array:
        return rows.column(name, first)

    yaw = of("yaw_hat") - of("yaw")
    return {
        "error_east": of("rear_x_hat") - of("rear_x"),
        "error_north": of("rear_y_hat") - of("rear_y"),
        "error_speed": of("speed_hat") - of("speed"),
        "error_yaw": pi - (pi - yaw) % (2 * pi),
        "bound_east": 3 * np.sqrt(of("p_xx")),
        "bound_north": 3 * np.sqrt(of("p_yy")),
        "bound_yaw": 3 * np.sqrt(of("p_yaw")),
    }


class _Lines(NamedTuple):
    """A plot with its place in a table of all signals."""

    plot: Plot
    columns: Index
    """Of the table, one a series."""
    factors: Array
    """From the SI unit of the log to the plot's, with the sign."""


class Signals:
    """Sends the plots of a run, each with its style as soon as it has a value."""

    def __init__(self, rows: Rows, more: Sequence[Plot] = ()) -> None:
        """`more` plots come after those of every run."""
        self.rows, self.shown = rows, list[Plot]()
        known = {name: k for k, name in enumerate((*rows.columns, *derived(rows, 0)))}
        self.lines = [
            _Lines(
                plot,
                np.array([known[series.column] for series in plot.series]),
                np.array([UNITS[plot.unit] * series.sign for series in plot.series]),
            )
            for plot in (*PLOTS, *more)
            if all(series.column in known for series in plot.series)
        ]

    def ranges(self) -> dict[str, Range | None]:
        """What the axes of the plots should show of all rows, by the path of the plot."""
        table = {name: self.rows.column(name) for name in self.rows.columns} | derived(self.rows, 0)
        early, found = self.rows.column("t") < SETTLED_S, dict[str, Range | None]()
        for plot, _, factors in self.lines:
            if plot in self.shown:
                numbers = np.column_stack([table[series.column] for series in plot.series]) * factors
                found[plot.path] = _range(plot, numbers, early)
        return found

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Rows `first` to `rows.filled` at `times` (n,)."""
        table = np.column_stack([self.rows.values[first : self.rows.filled], *derived(self.rows, first).values()])
        finite, turns = np.isfinite(table), first + np.arange(len(times))
        clocks: dict[bytes, rr.TimeColumn] = {}
        for plot, columns, factors in self.lines:
            there = finite[:, columns].all(axis=1) & (turns % plot.every == 0)
            if not there.any():
                continue
            if plot not in self.shown:
                self.shown.append(plot)
                stream.log(plot.entity, _style(plot), static=True)
            which = there.tobytes()
            if which not in clocks:
                clocks[which] = rr.TimeColumn(TIMELINE, duration=times[there])
            numbers = table[:, columns][there] * factors
            stream.send_columns(
                plot.entity, [clocks[which]], [partitioned(SCALARS, ScalarBatch(numbers.ravel()), len(columns))]
            )


def _range(plot: Plot, numbers: Array, early: Early) -> Range | None:
    """Of the numbers (rows, series) of a plot; bounds of the `early` rows (n,) do not count."""
    bounds = [series.column.startswith("bound_") for series in plot.series]
    numbers[np.outer(early, bounds)] = np.nan
    return value_range(numbers, plot.includes, plot.may_be_cut)


def _style(plot: Plot) -> rr.SeriesLines:
    """Names and colours; spikes survive zooming out."""
    return rr.SeriesLines(
        names=plot.names,
        colors=np.array([series.colour for series in plot.series], dtype=np.uint32),
        widths=[1.5] * len(plot.series),
        aggregation_policy=rr.components.AggregationPolicy.MinMax,
        interpolation_mode=rr.components.InterpolationMode.StepAfter if plot.steps else None,
    )
