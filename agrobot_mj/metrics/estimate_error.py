"""Causes of the estimation error, identified by their contributions to the error of the estimated CG.

The error, true minus estimated CG, is a sum of contributions in the frame of the true heading. The contribution of each
cause is computed from the log and the assumptions of the estimator. The causes are:

- shift of the antenna relative to the CG: its height above the CG times the sine of the uncompensated tilt,
- wrong configured antenna position,
- heading error, multiplied by the lever arm of the CG,
- latency and error of the fixes,
- the total error during times without a fix or without fixed ambiguities.

The fraction of a cause is the sum over the ticks of its contribution times the error, divided by the sum of the squared
error. The fractions of all causes and of the filter add up to 1.
"""

from typing import Any

import numpy as np

from agrobot_mj.core.signals import TICK_S, Array, Quality
from agrobot_mj.faults.gnss import GnssLatency
from agrobot_mj.metrics.base import RunView

LEAN, UNIT, HEADING, LATENCY = "antenna lean", "error of the inertial unit", "heading error", "GNSS latency"
GNSS, LOSS, FLOAT = "GNSS error", "no GNSS fix", "GNSS without fixed ambiguities"
ON_IMPLEMENT, PLACE = "antenna on the implement", "configured antenna position"
MAIN = 0.5  # Minimum fraction of the error that a reported cause explains [-], more than all other causes together
SMALLEST_M = 1e-3
"""Root mean square error below which no cause is reported [m]. Assumed value, far below the noise of RTK."""
Vectors = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
"""Horizontal vectors as complex numbers: forward + i left, or east + i north [m]."""


def cause_of(view: RunView, across: bool) -> str:
    """Return the main cause of the lateral (`across`) or horizontal estimation error, or "" if no cause dominates."""
    error, parts = contributions(view)
    total = max(_inner(error, error, across), len(error) * SMALLEST_M**2)
    return next((name for name, part in parts.items() if _inner(error, part, across) > MAIN * total), "")


def _inner(a: Vectors, b: Vectors, across: bool) -> float:
    """Return the inner product of two error contributions [m2]; `across` selects their lateral components."""
    return float(a.imag @ b.imag + (0.0 if across else a.real @ b.real))


def contributions(view: RunView) -> tuple[Vectors, dict[str, Vectors]]:
    """Return the error of the estimated CG and the contribution of each cause [m], as `Vectors` of shape (ticks,)."""
    s: Any = view.log.scenario
    tractor, column = s.tractor, view.column
    turned = np.exp(-1j * column("yaw"))
    cg, rear, cg_hat, rear_hat = (
        turned * (column(x) + 1j * column(y))
        for x, y in (("x", "y"), ("rear_x", "rear_y"), ("x_hat", "y_hat"), ("rear_x_hat", "rear_y_hat"))
    )
    assumed, compensated = _assumed_tilt(view)
    missed = _foot(column("roll"), column("pitch")) - _foot(*assumed)
    arm = complex(tractor.antenna_ahead_m, tractor.antenna_left_m)
    configured = complex(*s.sensors.gnss.configured_position(arm.real, arm.imag))
    antenna = rear + arm + tractor.antenna_height_m * _foot(column("roll"), column("pitch"))
    measured = _delay_rows(antenna / turned, _latency(view)) * turned
    fix = turned * (column("gnss_x") + 1j * column("gnss_y"))
    error, quality = cg - cg_hat, column("gnss_quality")
    with_fix = {
        UNIT if compensated else LEAN: (tractor.cg_height_m - tractor.antenna_height_m) * missed,
        HEADING: (cg - rear) - (cg_hat - rear_hat) - tractor.cg_height_m * missed,
        LATENCY: antenna - measured,
        GNSS: np.nan_to_num(measured - fix),
    }
    if configured != arm:
        with_fix[PLACE] = np.full(len(error), configured - arm)
    if s.implement.receiver:
        with_fix = {HEADING: with_fix[HEADING], ON_IMPLEMENT: error - with_fix[HEADING]}
    found = {name: np.where(quality == Quality.FIX, part, 0.0) for name, part in with_fix.items()}
    found[LOSS] = np.where(quality == Quality.NONE, error, 0.0)
    found[FLOAT] = np.where((quality == Quality.FLOAT) | (quality == Quality.DGPS), error, 0.0)
    return error, found


def _assumed_tilt(view: RunView) -> tuple[tuple[Array, Array], bool]:
    """Return roll and pitch (ticks,) [rad] assumed by the estimator, and whether the estimator compensates for tilt."""
    scenario: Any = view.log.scenario
    if getattr(scenario.estimator, "terrain_compensation", False):
        return (np.nan_to_num(view.column("imu_roll")), np.nan_to_num(view.column("imu_pitch"))), True
    level = np.zeros(len(view.column("t")))
    return (level, level), False


def _foot(roll: Array, pitch: Array) -> Vectors:
    """Return the horizontal shift of a point due to body tilt, divided by the height of the point above R [-]."""
    found: Vectors = np.sin(pitch) * np.cos(roll) - 1j * np.sin(roll)
    return found


def _latency(view: RunView) -> Array:
    """Return the latency of the GNSS receiver at each tick [s], including the effect of faults."""
    scenario: Any = view.log.scenario
    t = view.column("t")
    faults = [fault for fault in scenario.fault if isinstance(fault, GnssLatency)]
    late = [fault.latency_s * np.array([fault.active(at) for at in t]) for fault in faults]
    return np.full(len(t), scenario.sensors.gnss.latency_s) + sum(late)


def _delay_rows(values: Vectors, late_s: Array) -> Vectors:
    """Return the vectors delayed by `late_s` [s], shape (ticks,). Before the start, the first vector is used."""
    ticks = np.round(late_s / TICK_S).astype(int)
    delayed: Vectors = values[np.maximum(np.arange(len(values)) - ticks, 0)]
    return delayed
