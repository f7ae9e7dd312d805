"""Hints about keys of a valid scenario that have no effect or probably not the intended effect.

A hint does not end the run. Hints about the path concern tight bends, fast changes of curvature, and a path that
extends beyond the height grid of the ground.

For a step dk of the curvature, the wheels need the time T = d(delta) / rate, in which the tractor travels v T. The
lateral offset after the step is at least dk (v T)^2 / 24. The guidance law reaches this minimum if it starts to steer
at half of the distance v T before the step. For a gradual change, T is the time that the wheels need in addition to the
duration of the change.
"""

from collections.abc import Iterator
from math import ceil, degrees, floor, sqrt
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.contracts import without_exit
from agrobot_mj.core.learned import read_learned
from agrobot_mj.core.roots import root
from agrobot_mj.core.signals import ROUNDING_S, TICK_S
from agrobot_mj.faults.line import LineFault
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths.base import PathOutline
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.paths.transition import Transitions
from agrobot_mj.scenario.overrides import explicit_values, flat
from agrobot_mj.scenario.schema import Scenario, on_machine
from agrobot_mj.sensors.suite import LINES

SENSORS = {**{line: sensor for line, (sensor, _) in LINES.items()}, "heading": "gnss.dual_antenna"}
"""Key of the sensor in the table `[sensors]`, by name of the signal line of the sensor."""
OTHER_LAP = 0.02
"""Relative difference between the lap lengths of a learned table and of the path, above which a hint is given [-].
Assumed value."""


def hints(scenario: Scenario) -> list[str]:
    """Return a line of text for each key that has no effect, or that does not suit the machine size or the path."""
    own = (_faults, _late, _overridden_keys, _machine, _learned_lap_mismatch, path_hints)
    return [line for part in own for line in part(scenario)]


def _faults(scenario: Scenario) -> Iterator[str]:
    end = scenario.ticks * TICK_S
    for k, fault in enumerate(scenario.fault):
        first = max(0, ceil((fault.start_s - ROUNDING_S) / TICK_S)) * TICK_S
        sensor = SENSORS.get(fault.line) if isinstance(fault, LineFault) else None
        if sensor and not getattr(attrgetter(sensor)(scenario.sensors), "enabled", True):
            absent = f"the tractor has no such sensor; set sensors.{sensor}.enabled = true"
            yield f"fault[{k}]: {fault.kind} has no effect, because {absent}"
        elif first >= end - ROUNDING_S:
            late = f"{fault.start_s:g} s is not before the end of the run ({end:g} s)"
            yield f"fault[{k}].start_s: {late}, so the fault has no effect"
        elif not fault.active(first):
            window = f"{fault.start_s:g} to {fault.last_s:g} s"
            yield f"fault[{k}]: the window {window} contains no tick of {TICK_S:g} s, so the fault has no effect"


def _late(scenario: Scenario) -> Iterator[str]:
    late, most = scenario.sensors.gnss.latency_s, scenario.supervisor.coasting_after_s
    if scenario.supervisor.enabled and late > most:
        why = f"is always below the latency of the fixes (sensors.gnss.latency_s = {late:g} s), so the tractor coasts"
        yield f"supervisor.coasting_after_s: {most:g} s {why}"


def _overridden_keys(scenario: Scenario) -> Iterator[str]:
    given = flat(explicit_values(on_machine({"machine": scenario.machine})))
    used = dict(flat(scenario.model_dump(mode="json")))
    other = [key for key, value in given if used.get(key) != value]
    if len(other) > len(given) / 2:
        first = f"{other[0]} = {used.get(other[0])!r}"
        yield f"machine: the scenario overrides {len(other)} of {len(given)} keys of {scenario.machine!r} ({first})"


def _machine(scenario: Scenario) -> list[str]:
    try:
        with without_exit():
            return list(scenario.plant.hints(scenario.vehicle, scenario.path.speed_m_s))
    except ValueError:
        return []  # the machine is invalid, and its construction reports the error


def _learned_lap_mismatch(scenario: Scenario) -> Iterator[str]:
    if (file := getattr(scenario.guidance, "file", None)) is None:
        return
    lap = SampledRoute(scenario.path).lap()
    for places in (rows[:, 0] for rows in read_learned(file).values() if len(rows) > 1):
        learnt = float(places[0] + places[-1])  # map points are at the centres of equal segments of the lap
        if abs(learnt - lap) > OTHER_LAP * lap:
            laps = f"a lap of {learnt:.4g} m, but the lap of this path is {lap:.4g} m"
            yield f"guidance.file: the file was learned on {laps}; check that the path is the same"
            return


LEAVES_M = 0.15
"""Minimum lateral offset after a change of curvature for which a hint is given [m].

Assumed value; guidance laws without preview deviate by about twice the minimum offset.
"""
MOST_LOCK = 0.9  # Fraction of the steering limit above which a bend leaves no margin for control [-]. Assumed value.
EDGE_M = 0.5
"""Distance from the edge of the ground below which a hint is given [m]. Assumed value for deviations from the path."""
WIDEST = 100.0  # Maximum factor by which the search for a feasible radius increases the radius [-]


class Change(NamedTuple):
    """Change of the curvature at a location along the path."""

    begin: float  # Curvature before the change [1/m]
    end: float  # Curvature after the change [1/m]
    takes: float  # Duration of the change at the speed of the path [s]
    speed: float  # Speed at the change [m/s]
    place: tuple[float, float]  # Position of the change (east, north) [m]

    def late(self, tractor: TractorParameters, rate: float) -> float:
        """Return the delay of the wheels at the end of the change of curvature [s], at the steering rate `rate`
        [rad/s]."""
        turned = abs(tractor.steering_for(self.end) - tractor.steering_for(self.begin))
        return max(turned / rate - self.takes, 0.0)

    def leaves(self, tractor: TractorParameters, rate: float) -> float:
        """Return the minimum lateral offset [m] of the tractor after the change at the steering rate `rate` [rad/s]."""
        return abs(self.end - self.begin) * (self.speed * self.late(tractor, rate)) ** 2 / 24

    def wider(self, factor: float) -> "Change":
        """Return the change of curvature if all radii of the path are multiplied by `factor` [-]."""
        return self._replace(begin=self.begin / factor, end=self.end / factor)


def path_hints(scenario: Scenario) -> Iterator[str]:
    """Yield hints about the files of path and terrain, about bends, and about a path that leaves the ground."""
    for table, spec in (("path", scenario.path), ("terrain", scenario.terrain)):
        yield from (f"{table}.file: {note}" for note in spec.notes)
    if scenario.guidance.using(scenario.controller).follows_path:
        outline = scenario.path.outline()
        yield from _turns(scenario, outline)
        yield from _ground(scenario, outline)


def _turns(s: Scenario, outline: PathOutline) -> Iterator[str]:
    tractor, rate = s.tractor, s.vehicle.steering_rate
    if not s.path.max_curvature or not rate:
        return
    lock, worst = tractor.steering_for(s.path.max_curvature), _worst(s, outline, rate)
    leaves, tight = worst.leaves(tractor, rate), lock > MOST_LOCK * tractor.steer_limit
    if not tight and leaves <= LEAVES_M:
        return
    wide = f"{_radius(s)[0]} of {_wide_enough(s, worst, rate):g} m or more"
    if tight:
        place, limit = (s.path.sharpest, (f"the limit of {tractor.steer_limit_deg:g} deg leaves no margin"))
        bend = f"the bend at ({place.x:.1f}, {place.y:.1f}) m needs {degrees(lock):.1f} deg of steering"
        yield f"{_radius(s)[1]}: {bend}, {limit}; set {wide}"
    else:
        slow = f"{_speed_key(s, worst)} = {floor(100 * worst.speed * sqrt(LEAVES_M / leaves)) / 100:g}"
        smooth = isinstance(s.path, Transitions) and s.path.transition == "none"
        fixes = [wide, slow, *(['path.transition = "clothoid"'] if smooth else [])]
        turned = degrees(abs(tractor.steering_for(worst.end) - tractor.steering_for(worst.begin)))
        where = f"at ({worst.place[0]:.1f}, {worst.place[1]:.1f}) m the steering angle changes by {turned:.0f} deg"
        late = f"which at {degrees(rate):.0f} deg/s takes {worst.late(tractor, rate):.1f} s longer than the path allows"
        yield f"{_radius(s)[1]}: {where}, {late}, and the error is {leaves:.2f} m; set {' or '.join(fixes)}"


def _worst(s: Scenario, outline: PathOutline, rate: float) -> Change:
    """Return the change of curvature, to the left or to the right, that causes the maximum lateral offset."""
    changes = []
    curvatures, where = np.unique(outline.curvature, return_inverse=True)
    needed = np.array([s.tractor.steering_for(curvature) / rate for curvature in curvatures.tolist()])[where]
    for side in (1.0, -1.0):
        later = side * needed - outline.t
        least = np.minimum.accumulate(later)
        end = int(np.argmax(later - least))
        begin = int(np.argmax(later == least[end]))
        takes, speed = outline.t[end] - outline.t[begin], (outline.speed[begin] + outline.speed[end]) / 2
        ends = float(outline.curvature[begin]), float(outline.curvature[end])
        changes.append(Change(*ends, float(takes), float(speed), (float(outline.x[end]), float(outline.y[end]))))
    return max(changes, key=lambda change: change.leaves(s.tractor, rate))


def _wide_enough(s: Scenario, worst: Change, rate: float) -> float:
    """Return the minimum radius [m] that the steering limit and the steering rate permit, rounded up to 0.1 m."""

    def excess(radius: float) -> float:
        lock = s.tractor.steering_for(1 / radius) / (MOST_LOCK * s.tractor.steer_limit)
        change = worst.wider(radius * s.path.max_curvature)
        return max(lock, change.leaves(s.tractor, rate) / LEAVES_M) - 1.0

    tightest = 1 / s.path.max_curvature
    return ceil(10 * root(excess, tightest, WIDEST * tightest, rtol=1e-6)) / 10


def _radius(s: Scenario) -> tuple[str, str]:
    key = s.path.radius_key
    return (f"path.{key}", f"path.{key}") if key else ("bends", "path")


def _speed_key(s: Scenario, worst: Change) -> str:
    turning = getattr(s.path, "turn_speed_m_s", s.path.speed_m_s)
    return "path.turn_speed_m_s" if worst.speed <= 1.001 * turning and turning < s.path.speed_m_s else "path.speed_m_s"


def _ground(s: Scenario, outline: PathOutline) -> Iterator[str]:
    if s.expected_outcome == "left_terrain":
        return
    try:
        west, east, south, north = s.terrain.ground().extent
    except ValueError:
        return  # the construction of the ground reports this error
    within = outline.t <= s.ticks * TICK_S
    x, y = outline.x, outline.y
    inside = np.minimum(np.minimum(x - west, east - x), np.minimum(y - south, north - y))
    off = within & (inside < EDGE_M)
    if not off.any():
        return
    k = int(np.argmax(off))
    place = f"({x[k]:.0f}, {y[k]:.0f}) m after {outline.t[k]:.0f} s"
    reach = f"the terrain extends from ({west:g}, {south:g}) to ({east:g}, {north:g}) m"
    yield f"path: the path leaves the terrain at {place}; {reach}; make it larger"
