"""Keys of a scenario that contradict each other, though each is valid by itself."""

import re
from collections.abc import Iterator
from math import degrees, inf
from operator import attrgetter
from typing import TYPE_CHECKING

from agrobot_mj.core.contracts import one_line
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.faults import clashes
from agrobot_mj.paths.base import start_of

if TYPE_CHECKING:
    from agrobot_mj.scenario.schema import Scenario

LONGEST_S = 24 * 3600.0
"""Longest run that a log in memory can hold [s]."""
MOST_ASIDE_M_S2 = 8.0
"""Lateral acceleration that no tyre of a tractor holds [m/s2]. Estimate: a friction of 0.8."""
FAR_M = 2000.0
"""Distance from the ground above which coordinates are those of a map grid [m]. Estimate: wider than a field."""
REASONED = ("stopped", "unfinished", "diverged")
"""Outcomes that come with a reason."""
DIVISORS = (5, 8, 10, 16, 20, 25, 40, 50, 80, 100, 125, 200, 250, 400, 500)
"""Numbers of steps in a tick that make a step with few decimals."""


def misfits(s: "Scenario") -> list[str]:
    """Contradictions between keys that are valid by themselves; opens no file."""
    found = []
    if abs(s.steps_per_tick * s.step_s - TICK_S) > 1e-9:
        better = next(TICK_S / n for n in DIVISORS if TICK_S / n <= s.step_s)
        found.append(f"physics_dt_s: {s.step_s:g} does not divide the {TICK_S} s tick; try {better:g}")
    if s.physics != "standard" and s.physics_dt_s is not None:
        found.append(f"physics: {s.physics!r} and physics_dt_s = {s.physics_dt_s:g} both set the step; leave one out")
    if s.plant.kind == "bicycle":
        found += _beyond_the_bicycle(s)
    if s.expected_reason and s.expected_outcome not in REASONED:
        found.append(f'expected_reason: only {", ".join(REASONED)} have one; set expected_outcome = "stopped"')
    found += clashes(s.fault)
    if s.implement.receiver and s.implement.kind == "none":
        found.append('implement.receiver: there is no implement to carry it; set implement.kind = "mounted" or "drawn"')
    found += [
        f"{table}.{why} needs sensors.{name}.enabled = true"
        for table, needs in (("estimator", s.estimator.needs), ("guidance", s.guidance.needs))
        for name, why in needs.items()
        if not attrgetter(name)(s.sensors).enabled
    ]
    return found


def _beyond_the_bicycle(s: "Scenario") -> list[str]:
    """Features of the scenario that the bicycle does not have."""
    found = []
    if s.terrain.kind != "flat":
        found.append(
            f"terrain.kind: the bicycle plant knows only flat ground, got {s.terrain.kind!r}; "
            'set terrain.kind = "flat" or plant.kind = "mujoco"'
        )
    elif s.terrain.patch:
        found.append('terrain.patch: the bicycle plant knows no ground properties; set plant.kind = "mujoco"')
    if s.implement.machine:
        found.append(
            f"implement.kind: the bicycle plant has no body for an implement, got {s.implement.kind!r}; "
            'set implement.kind = "none" or plant.kind = "mujoco"'
        )
    found += [
        f'fault[{k}].kind: {fault.kind!r} acts on what the bicycle plant does not have; set plant.kind = "mujoco"'
        for k, fault in enumerate(s.fault)
        if fault.machine
    ]
    return found


def prefixed(table: str, text: str) -> str:
    """The message of a part with the key of its table in front: a text that begins with a key goes on from there."""
    return f"{table}.{text}" if re.match(r"[a-z0-9_.\[\]]+: ", text) else f"{table}: {text}"


def path_errors(s: "Scenario") -> list[str]:
    """Reasons why the tractor cannot drive the path."""
    numbers = {"duration_s": s.path.duration_s, "max_curvature": s.path.max_curvature}
    for name, value in numbers.items():
        if not (isinstance(value, float | int) and 0.0 <= value < inf):
            return [f"path: {name} of kind {s.path.kind!r} must be finite and not negative, got {one_line(value)}"]
    found = []
    if s.ticks > LONGEST_S / TICK_S:
        found.append(f"path: takes {s.ticks * TICK_S:.0f} s; set duration_s, at most {LONGEST_S:.0f}")
    if s.path.speed_m_s > s.driveline.full_speed_m_s:
        top = f"driveline.full_speed_m_s ({s.driveline.full_speed_m_s:g})"
        found.append(f"path.speed_m_s: must be at most {top}, got {s.path.speed_m_s:g}")
    allowed = getattr(s.path, "lateral_acceleration_m_s2", inf)  # paths whose speed follows from limits keep to it
    if (aside := min(s.path.max_curvature * s.path.speed_m_s**2, allowed)) > MOST_ASIDE_M_S2:
        found.append(
            f"path.speed_m_s: {s.path.speed_m_s:g} m/s in the sharpest bend, {s.path.max_curvature:.3g} 1/m, needs "
            f"{aside:.2g} m/s2 to the side, more than tyres hold ({MOST_ASIDE_M_S2:g}); drive slower or make it wider"
        )
    needed = s.tractor.steering_for(s.path.max_curvature)
    if needed >= s.tractor.steer_limit:
        place = s.path.sharpest
        found.append(
            f"path: its curvature of {s.path.max_curvature:.3g} 1/m at ({place.x:.1f}, {place.y:.1f}) m, "
            f"{place.distance:.1f} m from its start, needs {degrees(needed):.1f} deg of steering, the limit is "
            f"{s.tractor.steer_limit_deg:g} deg, a circle of {s.tractor.tightest_radius:.2f} m; make the path wider"
        )
    return found


def equipment_errors(s: "Scenario") -> Iterator[str]:
    """Reasons why the equipment of a scenario is not there; reads the files of what was learnt in earlier runs."""
    for table, part in (("guidance", s.guidance), ("steering.loop", s.steering.loop)):
        try:
            part.check()
        except ValueError as error:
            yield prefixed(table, str(error))
    if s.sensors.implement_gnss.enabled and s.implement.kind == "none":
        yield 'sensors.implement_gnss: there is no implement to carry it; set implement.kind = "mounted" or "drawn"'


def ground_errors(s: "Scenario") -> list[str]:
    """Reasons why there is no ground, or none under the tractor at its start."""
    start = start_of(s.path)
    try:
        if s.terrain.ground().covers(start.x, start.y):
            return []
    except ValueError as error:
        return [prefixed("terrain", str(error))]
    reach = max(map(abs, s.terrain.ground().extent))
    if max(abs(start.x), abs(start.y)) > reach + FAR_M:
        fix = "shift the path: subtract the coordinates of a place on the field"
    else:
        fix = "make the terrain larger"
    where = f"outside the terrain, which reaches {reach:g} m from its middle at (0, 0)"
    return [f"path: starts at ({start.x:g}, {start.y:g}) m, {where}; {fix}"]
