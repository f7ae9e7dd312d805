"""Operational results of field work: turns, pass-to-pass accuracy, and field capacity.

The definitions are those of [ASABE2006]. The effective field capacity is the field area divided by the time. The
theoretical field capacity is the working width times the planned working speed. The field efficiency is the effective
capacity divided by the theoretical capacity.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.boom import ImplementMotion

STATION_M = 0.1  # Distance between the points along a pass at which neighbouring passes are compared [m]
LEAST = 20  # Minimum number of points for a statistical result


class StraightPass(NamedTuple):
    """Planned straight swath with the implement motion on the swath."""

    along: tuple[float, float]  # Unit vector in the direction of the swaths (east, north)
    motion: ImplementMotion  # Motion of the working point of the implement while the implement works
    planned: float  # Planned offset of the pass from the origin [m], to the left of the swath direction


def pass_to_pass(lines: Sequence[StraightPass], width: float) -> dict[str, Any]:
    """Return the pass-to-pass errors of adjacent passes and the cross-track errors at the implement [m].

    Errors from fewer than `LEAST` points are None.
    """
    ranked = sorted(((line.planned, *_errors(line)) for line in lines), key=lambda each: each[0])
    differences = [np.empty(0)]
    for k, (across, stations, errors) in enumerate(ranked):
        for other, there, more in ranked[k + 1 :]:
            if abs(other - across - width) < 0.01 * width:
                _, a, b = np.intersect1d(stations, there, assume_unique=True, return_indices=True)
                differences.append(more[b] - errors[a])
    excess, own = np.concatenate(differences), np.concatenate([np.empty(0), *(errors for _, _, errors in ranked)])
    return {
        "pass_to_pass_p95_m": _p95(excess),
        "pass_to_pass_mean_m": float(excess.mean()) if excess.size >= LEAST else None,
        "cross_track_p95_m": _p95(own),
    }


def _errors(line: StraightPass) -> tuple[Array, Array]:
    """Return the indices of points spaced by STATION_M along a pass, and the lateral errors at these points [m],
    positive to the left."""
    (c, s), motion = line.along, line.motion
    along, error = c * motion.x + s * motion.y, -s * motion.x + c * motion.y - line.planned
    order = np.argsort(along)
    low, high = along[order[0]], along[order[-1]]
    stations = np.arange(np.ceil(low / STATION_M - 1e-9), np.floor(high / STATION_M + 1e-9) + 1)
    return stations, np.interp(stations * STATION_M, along[order], error[order])


def _p95(values: Array) -> float | None:
    return float(np.percentile(np.abs(values), 95)) if values.size >= LEAST else None


def turn_of(boxes: Array, at: tuple[float, float, float], t: Array, steer: Array) -> dict[str, float]:
    """Return the position, duration [s], swept width [m] and peak steering angle [deg] of a turn.

    `boxes` contains outlines of tractor and implement in the turn; `at` is the implement pose at the end of the pass.
    The swept width is the maximum distance of the outlines beyond this pose, in the direction of the pass.
    """
    x, y, yaw = at
    corners = shapely.get_coordinates(boxes)
    beyond = (corners[:, 0] - x) * np.cos(yaw) + (corners[:, 1] - y) * np.sin(yaw)
    return {
        "x": x,
        "y": y,
        "time_s": float(t[-1] - t[0]),
        "swept_width_m": float(max(beyond.max(), 0.0)),
        "peak_steer_deg": float(np.degrees(np.abs(steer).max())),
    }


def summary(turns: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the count, total and median duration, maximum swept width and peak steering angle of turns."""
    if not turns:
        return {"count": 0}
    values = {key: [turn[key] for turn in turns] for key in ("time_s", "swept_width_m", "peak_steer_deg")}
    return {
        "count": len(turns),
        "total_s": float(np.sum(values["time_s"])),
        "median_s": float(np.median(values["time_s"])),
        "swept_width_max_m": max(values["swept_width_m"]),
        "peak_steer_deg": max(values["peak_steer_deg"]),
    }


def capacity(area_m2: float, time_s: float, width: float, speed: float) -> dict[str, float]:
    """Return the effective and theoretical field capacity [ha/h], and the field efficiency [-]."""
    theoretical = width * speed * 0.36
    effective = area_m2 / 1e4 / (time_s / 3600)
    return {
        "effective_ha_h": effective,
        "theoretical_ha_h": theoretical,
        "field_efficiency": effective / theoretical,
    }
