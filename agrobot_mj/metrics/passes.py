"""Accuracy on parallel passes, similar to ISO 12188-2 [ISO2012].

The standard tests guidance on straight, level passes. It interpolates the cross-track error along each pass. The result
is the 95th percentile of the unsigned difference between the errors of successive passes.

Here the true CG is evaluated on the passes of the path without their run-in (`passes_s`), at stations STATION_M apart.
Errors are positive to the left of the first pass, also on passes in the opposite direction. The difference between
neighbouring passes is therefore the excess width of the swath between them, negative for an overlap.

The result is not a test according to the standard: the scenario defines vehicle, courses, number of passes and time
between passes.
"""

from itertools import pairwise
from math import cos, sin
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import Metric, RunView, abs_p95, mean, rms
from agrobot_mj.paths import Parallel

LABEL = "12188-2-style"
STATION_M = 0.1  # Distance between the stations of a pass [m]
COMPLETE = 0.99  # Minimum fraction of a pass that is driven if the pass is complete [-]


class Passed(NamedTuple):
    """Driven part of a pass. Positions are relative to the first pass, positive in its direction and to its left."""

    line: float  # Lateral position of the planned pass [m]
    direction: int  # Direction of travel: 1 in the direction of the first pass, -1 in the opposite direction
    span: float  # Length of the pass without the run-in [m]
    stations: Array  # Stations passed, as integer multiples of STATION_M, shape (n,) [-]
    errors: Array
    """Lateral offset of the CG from `line` at `stations` [m], positive to the left of the first pass, shape (n,)."""

    def numbers(self, number: int) -> dict[str, Any]:
        """Return the error statistics of the pass, with errors positive to the left of its direction; each statistic is
        None for fewer than LEAST stations."""
        error = self.errors * self.direction
        return {
            "pass": number,
            "complete": bool(error.size * STATION_M >= COMPLETE * self.span - 2 * STATION_M),
            "xte_mean": mean(error),
            "xte_rms": rms(error),
            "xte_abs_p95": abs_p95(error),
        }


class PassAccuracy(Metric):
    """Pass-to-pass accuracy on parallel passes, similar to ISO 12188-2."""

    kind: Literal["passes"] = "passes"
    columns: ClassVar = (
        Column("iso_12188_2_style.label", "-", "text: standard similar to the method"),
        Column("iso_12188_2_style.pass_to_pass_p95_m", "m", "95th percentile of the error between neighbouring passes"),
        Column(
            "iso_12188_2_style.pass_to_pass_mean_m",
            "m",
            "mean error between neighbouring passes, positive where swaths are too wide",
        ),
        Column("iso_12188_2_style.pass_xte_abs_p95_m", "m", "95th percentile of the cross-track error on all passes"),
        Column("iso_12188_2_style.per_pass", "m", "list: xte_mean, xte_rms, xte_abs_p95 of each `pass`, if `complete`"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the pass-to-pass accuracy as a table, or an empty dict for a path without parallel passes."""
        if not isinstance(view.path, Parallel):
            return {}
        return {"iso_12188_2_style": pass_to_pass(view.path, view.cg_on_path.time, view.column("x"), view.column("y"))}


def pass_to_pass(path: Parallel, time: Array, x: Array, y: Array) -> dict[str, Any]:
    """Return the pass-to-pass accuracy of a run as JSON values, lengths in metres.

    `time` [s] is the time at which the reference passes the path point nearest to the CG, and `x`, `y` [m] the position
    of the CG, each of shape (ticks,). Without two neighbouring passes the pass-to-pass error is None.
    """
    passed = driven_passes(path, time, x, y)
    by_line = sorted(passed, key=lambda one: one.line)
    wide = list[Array]()  # excess widths of the swaths between neighbouring passes at their common stations [m]
    for right, left in pairwise(by_line):
        _, a, b = np.intersect1d(right.stations, left.stations, assume_unique=True, return_indices=True)
        wide.append(left.errors[b] - right.errors[a])
    differences = np.concatenate([np.empty(0), *wide])
    everything = np.concatenate([one.errors for one in passed])
    return {
        "label": LABEL,
        "pass_to_pass_p95_m": abs_p95(differences),
        "pass_to_pass_mean_m": mean(differences),
        "pass_xte_abs_p95_m": abs_p95(everything),
        "per_pass": [one.numbers(k) for k, one in enumerate(passed, 1)],
    }


def driven_passes(path: Parallel, time: Array, x: Array, y: Array) -> list[Passed]:
    """Return the driven part of each pass in driving order. The arguments are the same as for `pass_to_pass`."""
    origin = path.at(0.0)
    c, s = cos(origin.yaw), sin(origin.yaw)
    found = []
    for start, end in path.passes_s:
        with np.errstate(invalid="ignore"):
            rows = np.flatnonzero((time >= start) & (time <= end))
        place = x[rows] - origin.x, y[rows] - origin.y
        along, left = c * place[0] + s * place[1], -s * place[0] + c * place[1]
        a, b = path.at(start), path.at(end)
        stations_m = [c * (p.x - origin.x) + s * (p.y - origin.y) for p in (a, b)]
        line = -s * (a.x - origin.x) + c * (a.y - origin.y)
        stations, errors = _errors_at_stations(along, left - line, min(stations_m), max(stations_m))
        direction = 1 if stations_m[1] > stations_m[0] else -1
        found.append(Passed(line, direction, abs(stations_m[1] - stations_m[0]), stations, errors))
    return found


def _errors_at_stations(along: Array, errors: Array, low: float, high: float) -> tuple[Array, Array]:
    """Return the stations passed between `low` and `high` [m], and the interpolated errors at these stations [m]."""
    if along.size < 2:
        return np.empty(0), np.empty(0)
    order = np.argsort(along)
    along, errors = along[order], errors[order]
    low, high = max(low, along[0]), min(high, along[-1])
    stations = np.arange(np.ceil(low / STATION_M - 1e-9), np.floor(high / STATION_M + 1e-9) + 1)
    return stations, np.interp(stations * STATION_M, along, errors)
