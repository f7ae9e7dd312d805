"""Operational results of field work: turns, pass-to-pass accuracy, and field capacity.

The definitions follow [ASABE2006]. The effective field capacity is the area worked at least once, divided by the time.
The theoretical field capacity is the working width times the planned working speed. The field efficiency is the
effective capacity divided by the theoretical capacity.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.boom import ImplementMotion

STATION_M = 0.25  # Distance between the points along a pass at which errors are evaluated [m]
TOLERANCE = 0.1  # Maximum relative deviation of the distance between neighbouring passes from the planned spacing [-]
PARALLEL = 0.98  # Minimum cosine of the angle between neighbouring passes [-]
LEAST = 20  # Minimum number of points for statistics of errors


class WorkedPass(NamedTuple):
    """Planned and actual motion of the implement on one swath."""

    planned: ImplementMotion  # Planned motion of the working point of the implement
    motion: ImplementMotion  # Actual motion of the working point while the implement works


class PassErrors(NamedTuple):
    """Lateral errors of the implement at n points along a planned swath. Arrays have the shape (n,) or (n, 2)."""

    line: shapely.LineString  # Planned swath
    points: Array  # Points on the planned swath [m], east and north
    ahead: Array  # Unit vectors in the direction of the swath at these points, east and north
    stations: Array  # Distances of the points from the start of the swath [m]
    errors: Array  # Lateral errors at the points [m], positive to the left of the swath


def pass_to_pass(passes: Sequence[WorkedPass], spacing: float) -> dict[str, Any]:
    """Return the pass-to-pass errors between neighbouring passes and the cross-track errors of the implement [m].

    Neighbours are sections of passes, straight or curved, at the distance `spacing` [m]. The pass-to-pass error is the
    actual distance minus the planned distance. Errors from fewer than `LEAST` points are None.
    """
    found = [each for one in passes if (each := _errors(one)) is not None]
    lines, excess = np.array([each.line for each in found]), list[Array]()
    for k, one in enumerate(found):
        near = shapely.dwithin(one.line, lines[k + 1 :], (1.0 + TOLERANCE) * spacing)
        excess += [_excess(one, found[k + 1 + j], spacing) for j in np.flatnonzero(near)]
    differences, own = (np.concatenate([np.empty(0), *parts]) for parts in (excess, [each.errors for each in found]))
    return {
        "pass_to_pass_p95_m": _p95(differences),
        "pass_to_pass_mean_m": float(differences.mean()) if differences.size >= LEAST else None,
        "cross_track_p95_m": _p95(own),
    }


def _errors(one: WorkedPass) -> PassErrors | None:
    """Return the lateral errors on a pass, or None for a pass shorter than the point spacing `STATION_M`."""
    line = shapely.LineString(np.column_stack((one.planned.x, one.planned.y)))
    places = np.column_stack((one.motion.x, one.motion.y))
    along = shapely.line_locate_point(line, shapely.points(places))
    inside = (along > 0.0) & (along < line.length)  # points before and after the swath have no lateral error
    along, places = along[inside], places[inside]
    if along.size < 2 or np.ptp(along) < STATION_M:
        return None
    feet, ahead = _on(line, along)
    aside = places - feet
    errors, order = ahead[:, 0] * aside[:, 1] - ahead[:, 1] * aside[:, 0], np.argsort(along)
    stations = np.arange(along.min(), along.max(), STATION_M)
    points, ahead = _on(line, stations)
    return PassErrors(line, points, ahead, stations, np.interp(stations, along[order], errors[order]))


def _on(line: shapely.LineString, distances: Array) -> tuple[Array, Array]:
    """Return points at `distances` [m] along a line, and unit vectors of its direction, shape (n, 2) each."""
    corners = shapely.get_coordinates(line)
    corners = corners[np.concatenate(([True], np.diff(corners, axis=0).any(axis=1)))]
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(*steps.T)
    starts = np.concatenate(([0.0], np.cumsum(lengths)))
    k = np.clip(np.searchsorted(starts, distances, "right") - 1, 0, len(lengths) - 1)
    ahead = steps[k] / lengths[k, None]
    return corners[k] + (distances - starts[k])[:, None] * ahead, ahead


def _excess(one: PassErrors, other: PassErrors, spacing: float) -> Array:
    """Return the actual minus the planned distance of two passes [m], at the points where they are neighbours."""
    along = shapely.line_locate_point(other.line, shapely.points(one.points))
    feet, direction = _on(other.line, along)
    towards = feet - one.points
    left = one.ahead[:, 0] * towards[:, 1] - one.ahead[:, 1] * towards[:, 0]
    beside = np.abs(np.abs(left) - spacing) < TOLERANCE * spacing
    beside &= (along >= other.stations[0]) & (along <= other.stations[-1])
    cosine = (one.ahead * direction).sum(axis=1)
    beside &= np.abs(cosine) > PARALLEL
    found: Array = np.sign(left) * (np.sign(cosine) * np.interp(along, other.stations, other.errors) - one.errors)
    return found[beside]


def _p95(values: Array) -> float | None:
    return float(np.percentile(np.abs(values), 95)) if values.size >= LEAST else None


def turn_of(boxes: Array, at: tuple[float, float, float], t: Array, steer: Array) -> dict[str, float]:
    """Return the position [m], duration [s], swept width [m] and peak steering angle [deg] of a turn.

    `boxes` contains outlines of the tractor and implement in the turn; `at` is the implement pose at the end of the
    pass. The swept width is the maximum distance of the outlines beyond this pose, in the direction of the pass.
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
    """Return number, total and median duration, maximum swept width and peak steering angle of turns, by name."""
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
    """Return effective and theoretical field capacity [ha/h], and field efficiency [-], for a worked area and time."""
    theoretical = width * speed * 0.36
    effective = area_m2 / 1e4 / (time_s / 3600)
    return {
        "effective_ha_h": effective,
        "theoretical_ha_h": theoretical,
        "field_efficiency": effective / theoretical,
    }
