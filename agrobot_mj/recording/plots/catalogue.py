"""Catalogue of plots: log column, unit, label and colour of each line.

A recording of a run contains `PLOTS` and `network.network_plots`; a comparison contains `COMPARED`. Plots whose columns
are missing in the log are omitted. `estimation_errors` computes further quantities from the log.
"""

from collections.abc import Collection, Mapping, Sequence
from math import degrees
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.palette import BRIGHT_BLUE, GREEN, GREY, ORANGE, PINK, SKY_BLUE, VERMILION, rgba
from agrobot_mj.core.signals import WHEELS, Array, Column
from agrobot_mj.simulation.columns import COLUMNS
from agrobot_mj.simulation.log import Rows

FACTORS = {
    **{"cm": 100.0, "kN": 1e-3, "%": 100.0, "l/min": 6e4, "bar": 1e-5},
    **{"deg": degrees(1), "deg/s": degrees(1), "deg/s2": degrees(1)},
}
"""Conversion factors from log units to plot units, by plot unit. Default: 1."""
TRUE, MEASURED, WANTED = rgba(SKY_BLUE), rgba(ORANGE), rgba(GREY)
PD, NETWORK, BOUND = rgba(VERMILION), rgba(BRIGHT_BLUE), 0x8A8A8AFF
WHEEL_COLOURS = (rgba(SKY_BLUE), rgba(ORANGE), rgba(GREEN), rgba(PINK))


class Series(NamedTuple):
    """Line of a plot: log column, label and style."""

    label: str
    column: str  # Column of the log, or key in the result of `estimation_errors`
    colour: int  # Colour as 0xRRGGBBAA
    sign: float = 1.0
    wider: int = 0  # Number of steps by which the line is wider than normal


class Plot(NamedTuple):
    """Definition of a plot: lines with a common unit, recorded as one entity."""

    path: str
    title: str
    unit: str
    series: tuple[Series, ...]
    every: int = 1  # Number of ticks between points. Slow signals have more than one.
    includes: tuple[float, ...] = ()  # Values that the axis range always includes
    may_be_cut: bool = False  # Whether the axis may cut off rare extreme values, so that other values are readable
    steps: bool = False  # Whether the line has steps, because values are constant between points
    as_logged: bool = False  # Whether the log already contains the values in the unit of the plot
    legend: bool = True

    @property
    def factor(self) -> float:
        """Conversion factor from log units to plot units [-]."""
        return 1.0 if self.as_logged else FACTORS.get(self.unit, 1.0)

    @property
    def entity(self) -> str:
        """Rerun entity path of the plot."""
        return f"plots/{self.path}"

    @property
    def names(self) -> list[str]:
        """Labels of the lines of the plot."""
        return [series.label for series in self.series]


def _loop(path: str, title: str, unit: str, wanted: str, measured: str, true: str) -> Plot:
    reference, sensed = Series("reference", wanted, WANTED), Series("measured", measured, MEASURED)
    return Plot(path, title, unit, (reference, sensed, Series("true", true, TRUE)))


def _estimate_plot(name: str, title: str, unit: str) -> Plot:
    error = Series("error", f"error_{name}", MEASURED)
    bounds = Series("+3 sigma", f"bound_{name}", BOUND), Series("-3 sigma", f"bound_{name}", BOUND, -1.0)
    title = f"{title}: estimate minus truth, 3 sigma"
    return Plot(f"estimator/{name}", title, unit, (*bounds, error), legend=False)


def _wheels(path: str, title: str, unit: str, quantity: str) -> Plot:
    series = (Series(wheel, f"{quantity}_{wheel}", c) for wheel, c in zip(WHEELS, WHEEL_COLOURS, strict=True))
    return Plot(f"tyres/{path}", title, unit, tuple(series), legend=path == "load")  # one legend is sufficient


def _single(path: str, title: str, unit: str, label: str, column: str, colour: int = MEASURED) -> Plot:
    return Plot(path, title, unit, (Series(label, column, colour),))


# The log contains the errors of the paper, reference minus position. Plots show position minus reference, so that
# positive lateral and cross-track errors are to the left of the path.
_ERRORS = (Series("longitudinal", "e_longitudinal", MEASURED, -1.0), Series("lateral", "e_lateral", TRUE, -1.0))
_COMMAND = (
    *(Series("total", "steer_ref", WANTED), Series("PD tau_c", "tau_c", PD)),
    Series("network -tau_n", "tau_n", NETWORK, -1.0),
)
_ATTITUDE = Series("roll, left up", "roll", TRUE), Series("pitch, nose down", "pitch", MEASURED)

PLOTS = (
    Plot("tracking/error", "Tracking error, ahead and left +", "m", _ERRORS),
    _loop("yaw_rate/loop", "Yaw rate", "deg/s", "yaw_rate_ref", "yaw_rate_hat", "yaw_rate"),
    _single("yaw_rate/error", "Yaw rate: reference minus measured", "deg/s", "error", "e_yaw_rate"),
    Plot("control/command", "Steering command", "deg", _COMMAND),
    _loop("steering/angle", "Steering angle", "deg", "steer_ref", "steer_measured", "steer"),
    _single("steering/valve", "Steering valve", "V", "voltage", "valve_voltage"),
    _single("steering/flow", "Oil flow to the cylinder", "l/min", "flow", "valve_flow"),
    _single("steering/pressure", "Pressure in the cylinder", "bar", "pressure", "steer_pressure", TRUE),
    _loop("speed/loop", "Speed", "m/s", "speed_ref", "speed_hat", "speed"),
    _loop("speed/pedal", "Pedal", "-", "pedal_ref", "pedal_measured", "pedal"),
    _single("speed/valve", "Pedal valve", "V", "voltage", "pedal_voltage"),
    _single("speed/torque", "Torque on the driven wheels", "N m", "torque", "drive_torque", TRUE),
    _wheels("load", "Wheel load", "kN", "load"),
    _wheels("friction_use", "Used fraction of the friction", "-", "friction_use"),
    _wheels("slip_angle", "Slip angle", "deg", "slip_angle"),
    _wheels("slip_ratio", "Slip ratio, driving +", "%", "slip_ratio"),
    _wheels("longitudinal_force", "Longitudinal force", "kN", "fx"),
    _wheels("lateral_force", "Lateral force", "kN", "fy"),
    _estimate_plot("east", "East", "cm"),
    _estimate_plot("north", "North", "cm"),
    _estimate_plot("yaw", "Yaw", "deg"),
    _single("estimator/speed", "Speed: estimate minus truth", "m/s", "error", "error_speed"),
    _single("estimator/nees", "NEES of the position (2 if consistent)", "-", "NEES", "position_nees"),
    _single("estimator/nis", "NIS of the position fixes (2 if consistent)", "-", "NIS", "position_nis"),
    _single("estimator/bias", "Estimated bias of the steering sensor", "deg", "estimate", "steer_bias_hat"),
    _single("estimator/faults", "Active faults", "-", "faults", "faults_active")._replace(includes=(0, 1), steps=True),
    _single("estimator/quality", "GNSS quality (2 fix, 1 float, 3 DGPS)", "-", "quality", "gnss_quality")._replace(
        includes=(0, 2), steps=True
    ),
    Plot("attitude", "Attitude", "deg", _ATTITUDE),
)
"""Plots of a run in the order of the tabs, without the plots of the fuzzy neural network."""
DRIVE = ("tracking/", "yaw_rate/loop", "control/command")  # Path prefixes of the plots next to the scene

DIFFERENCE = "difference"
"""Name of a signal in comparisons: cross-track error minus the cross-track error of the first run."""
COMPARED = (
    _single("cross_track", "Cross-track error, left +", "m", "", "cross_track"),
    _single("difference", "Cross-track error minus that of", "m", "", DIFFERENCE),
    _single("command", "Steering command", "deg", "", "steer_ref"),
    _single("network", "Network output in the command, -tau_n", "deg", "", "tau_n"),
    _single("yaw_rate", "Yaw-rate error", "deg/s", "", "e_yaw_rate"),
    _single("speed", "Speed", "m/s", "", "speed"),
)
"""Plots of a comparison. Each plot has one line per run in the run colour."""
NEGATED = ("tau_n",)  # Columns plotted with the opposite sign in a comparison


SHOWN_IN = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2", "N": "kN", "Pa": "bar", "m3/s": "l/min"}
"""Units in which log columns outside the catalogue are plotted, by the unit in the log."""
REPORTED = "reported/"  # Path prefix of the plots of log columns that are not listed in the catalogue


def reported_plots(table: Sequence[Column], elsewhere: Collection[str]) -> list[Plot]:
    """Return a plot for each log column that is marked for plotting and is absent from the catalogue and from
    `elsewhere`."""
    known = {series.column for plot in PLOTS for series in plot.series} | set(elsewhere) | set(COLUMNS)
    return [
        _single(f"{REPORTED}{c.name}", _title(c), SHOWN_IN.get(c.unit, c.unit), c.name, c.name)._replace(
            as_logged=c.unit not in SHOWN_IN
        )
        for c in table
        if c.drawn and c.name not in known
    ]


def _title(column: Column) -> str:
    text = column.description.partition("; null")[0]
    return text[:1].upper() + text[1:]


def estimation_errors(rows: Rows, first: int) -> dict[str, Array]:
    """Return the estimation errors and their 3 sigma bounds in the log rows from `first`, in SI units, by signal
    name."""

    def of(name: str) -> Array:
        return rows.column(name, first)

    return {
        "error_east": of("rear_x_hat") - of("rear_x"),
        "error_north": of("rear_y_hat") - of("rear_y"),
        "error_speed": of("speed_hat") - of("speed"),
        "error_yaw": wrap(of("yaw_hat") - of("yaw")),
        "bound_east": 3 * np.sqrt(of("p_xx")),
        "bound_north": 3 * np.sqrt(of("p_yy")),
        "bound_yaw": 3 * np.sqrt(of("p_yaw")),
    }


def shown_by(plot: Plot, known: Mapping[str, object]) -> bool:
    """Return whether all columns of a plot are keys of `known`."""
    return all(series.column in known for series in plot.series)
