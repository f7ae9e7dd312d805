"""Grouping of runs by path segment. Errors are comparable only between runs on the same segment."""

from collections.abc import Iterable

import numpy as np

from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.paths import Path, sample
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.scenario.tables import LONGEST_S

SAMPLES, STATIONS = 400, 50
"""Number of points at equal times on a path segment, and number of equidistant points for comparing segments."""
APART = 0.01  # Maximum distance between corresponding points of equal segments per segment length [-]. Assumed value.


def pieces(scenarios: Iterable[Scenario]) -> list[int]:
    """Return the path segment number of each scenario, counted from 1. Equal segments have the same number.

    Runs to the end of a path cover the same segment at any speed. Runs of equal duration cover the same segment only at
    equal speed.
    """
    known: dict[object, int] = {}
    different: list[Array] = []
    found = []
    for scenario in scenarios:
        key = (scenario.path, scenario.ticks)
        if key not in known:
            stations = _stations(scenario)
            same = (k for k, other in enumerate(different, 1) if _close(stations, other))
            known[key] = next(same, len(different) + 1)
            if known[key] > len(different):
                different.append(stations)
        found.append(known[key])
    return found


def at_speed(scenario: Scenario, speed: float) -> Scenario:
    """Return the scenario with another speed [m/s]. A specified duration is adapted to keep the same path segment."""
    changed = scenario.changed({"path.speed_m_s": speed})
    if scenario.duration_s is None:
        return changed
    length, end = _reference_points(scenario.path, scenario.duration_s)[2][-1], scenario.duration_s
    if not length:
        return changed
    while (walked := _reference_points(changed.path, end))[2][-1] < length and end < LONGEST_S:
        end *= 1.5
    return changed.changed({"duration_s": float(np.interp(length, walked[2], walked[0]))})


def _reference_points(path: Path, end: float) -> tuple[Array, Array, Array]:
    """Return times (n,) [s], positions (n, 2) [m] and arc lengths (n,) [m] of the reference up to time `end` [s]."""
    times = np.linspace(0.0, end, SAMPLES)
    points = sample(path, times)
    return times, points, np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))


def _stations(scenario: Scenario) -> Array:
    """Return equidistant points on the path segment of a scenario [m], shape (n, 2). The last row contains the segment
    length twice."""
    _, points, way = _reference_points(scenario.path, scenario.ticks * TICK_S)
    places = np.linspace(0.0, way[-1], STATIONS)
    along = np.stack([np.interp(places, way, column) for column in points.T], axis=1)
    return np.vstack([along, [way[-1], way[-1]]])


def _close(one: Array, other: Array) -> bool:
    length = max(one[-1, 0], other[-1, 0])
    return bool(np.abs(one - other).max() <= APART * length)
