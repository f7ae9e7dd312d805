"""Causes of the estimator's error, distinguished by their effects on the estimated CG.

The error, true minus estimated CG, is a sum of contributions in the frame of the true heading. The contribution of a
cause follows from the log and from the assumptions of the estimator: lateral shift of the antenna above R (its height
times the sine of the uncompensated roll), a wrong heading at the lever arm of the CG, latency and error of the fixes,
and everything during times without a fix or with a float solution. The fraction of a cause is the product of its
contribution with the error, divided by the square of the error, both summed over the ticks; the fractions of all causes
and of the filter itself add up to 1.
"""

from typing import Any

import numpy as np

from agrobot_mj.core.signals import TICK_S, Array, Quality
from agrobot_mj.faults.gnss import GnssLatency
from agrobot_mj.metrics.base import RunView

LEAN, UNIT, HEADING, LATENCY = "antenna lean", "error of the inertial unit", "heading error", "GNSS latency"
GNSS, LOSS, FLOAT = "GNSS error", "no GNSS fix", "GNSS without fixed ambiguities"
ON_IMPLEMENT = "antenna on the implement"
MAIN = 0.5
"""Fraction of the error above which a cause is reported, more than all others together [-]."""
SMALLEST_M = 1e-3
"""Root mean square error below which no cause is reported [m]. Assumed value: far below the noise of RTK."""
Vectors = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
"""Horizontal vectors as complex numbers: ahead + i left, or east + i north [m]."""


def cause_of(view: RunView, across: bool) -> str:
    """Return the cause of more than half of the estimator's error, `across` the heading or in the plane; empty without
    one."""
    error, parts = contributions(view)
    total = max(_inner(error, error, across), len(error) * SMALLEST_M**2)
    return next((name for name, part in parts.items() if _inner(error, part, across) > MAIN * total), "")


def _inner(a: Vectors, b: Vectors, across: bool) -> float:
    """Return the inner product of two contributions over the ticks, `across` the heading or in the plane [m2]."""
    return float(a.imag @ b.imag + (0.0 if across else a.real @ b.real))


def contributions(view: RunView) -> tuple[Vectors, dict[str, Vectors]]:
    """Return the error of the estimated CG and the contribution of each cause, shape (ticks,) each, ahead + i left [m].

    The residual is the contribution of the filter.
    """
    s: Any = view.log.scenario
    tractor, column = s.tractor, view.column
    turned = np.exp(-1j * column("yaw"))
    cg, rear, cg_hat, rear_hat = (
        turned * (column(x) + 1j * column(y))
        for x, y in (("x", "y"), ("rear_x", "rear_y"), ("x_hat", "y_hat"), ("rear_x_hat", "rear_y_hat"))
    )
    assumed, compensated = _assumed_tilt(view)
    missed = _foot(column("roll"), column("pitch")) - _foot(*assumed)
    antenna = rear + tractor.antenna_height_m * _foot(column("roll"), column("pitch"))
    measured = _delayed(antenna / turned, _latency(view)) * turned
    fix = turned * (column("gnss_x") + 1j * column("gnss_y"))
    error, quality = cg - cg_hat, column("gnss_quality")
    with_fix = {
        UNIT if compensated else LEAN: (tractor.cg_height_m - tractor.antenna_height_m) * missed,
        HEADING: (cg - rear) - (cg_hat - rear_hat) - tractor.cg_height_m * missed,
        LATENCY: antenna - measured,
        GNSS: np.nan_to_num(measured - fix),
    }
    if s.implement.receiver:
        with_fix = {HEADING: with_fix[HEADING], ON_IMPLEMENT: error - with_fix[HEADING]}
    found = {name: np.where(quality == Quality.FIX, part, 0.0) for name, part in with_fix.items()}
    found[LOSS] = np.where(quality == Quality.NONE, error, 0.0)
    found[FLOAT] = np.where((quality == Quality.FLOAT) | (quality == Quality.DGPS), error, 0.0)
    return error, found


def _assumed_tilt(view: RunView) -> tuple[tuple[Array, Array], bool]:
    """Return roll and pitch assumed by the estimator, shape (ticks,) [rad], and whether tilt is compensated."""
    scenario: Any = view.log.scenario
    if getattr(scenario.estimator, "terrain_compensation", False):
        return (np.nan_to_num(view.column("imu_roll")), np.nan_to_num(view.column("imu_pitch"))), True
    level = np.zeros(len(view.column("t")))
    return (level, level), False


def _foot(roll: Array, pitch: Array) -> Vectors:
    """Return the horizontal position of a point one metre above R on the body's upright axis [-]."""
    found: Vectors = np.sin(pitch) * np.cos(roll) - 1j * np.sin(roll)
    return found


def _latency(view: RunView) -> Array:
    """Return the latency of the receiver in each tick, including faults [s]."""
    scenario: Any = view.log.scenario
    t = view.column("t")
    faults = [fault for fault in scenario.fault if isinstance(fault, GnssLatency)]
    late = [fault.latency_s * np.array([fault.active(at) for at in t]) for fault in faults]
    return np.full(len(t), scenario.sensors.gnss.latency_s) + sum(late)


def _delayed(values: Vectors, late_s: Array) -> Vectors:
    """Return the values delayed by `late_s` [s], shape (ticks,); the first value replaces those before the start."""
    ticks = np.round(late_s / TICK_S).astype(int)
    delayed: Vectors = values[np.maximum(np.arange(len(values)) - ticks, 0)]
    return delayed
