"""Checks of the files used by a scenario: the path, the ground, and the tables learned in earlier runs."""

import re
from collections.abc import Iterator
from math import degrees, inf
from typing import Any

from agrobot_mj.core.contracts import one_line, without_exit
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.paths.base import start_of
from agrobot_mj.scenario.tables import LONGEST_S, Tables

MOST_ASIDE_M_S2 = 8.0
"""Maximum plausible lateral acceleration [m/s2]. Assumed value for a friction coefficient of 0.8, which tyres do not
reach."""
FAR_M = 2000.0
"""Distance from the ground above which a path is probably in map coordinates [m]. Assumed value, larger than a
field."""


def check_files(scenario: Tables, source: str, ground: bool = True) -> None:
    """Check the path, the ground and other files of a scenario, and their suitability for the tractor.

    If `ground` is false, the ground is not checked. Raises `ScenarioError` with all errors; `source` names the
    scenario.
    """
    with without_exit():
        try:
            scenario.path.check()
        except ValueError as error:
            raise ScenarioError(f"{source}: {prefix_key('path', str(error))}") from None
        errors = [*path_errors(scenario), *equipment_errors(scenario), *(ground_errors(scenario) if ground else [])]
    if errors:
        raise ScenarioError("\n".join(f"{source}: {error}" for error in errors))


def prefix_key(table: str, text: str) -> str:
    """Prefix an error message with the key `table`. If the message starts with a key, a dot joins the two keys."""
    return f"{table}.{text}" if re.match(r"[a-z0-9_.\[\]]+: ", text) else f"{table}: {text}"


def path_errors(s: Tables) -> list[str]:
    """Return error messages about the path, for example a curvature that the tractor cannot follow."""
    duration, curvature = s.path.duration_s, s.path.max_curvature
    for name, value in (("duration_s", duration), ("max_curvature", curvature)):
        if not (isinstance(value, float | int) and 0.0 <= value < inf):
            return [f"path: {name} of kind {s.path.kind!r} must be finite and not negative, got {one_line(value)}"]
    if not _are_spans(s.path.turns_s):
        wanted = "must have at least one pair (start, end), finite and not negative"
        return [f"path: turns_s of kind {s.path.kind!r} {wanted}, got {one_line(s.path.turns_s)}"]
    found = []
    if s.duration_s is None and round(duration / TICK_S) > LONGEST_S / TICK_S:
        found.append(f"path: the path takes {duration:.0f} s; set duration_s to at most {LONGEST_S:.0f}")
    if s.path.speed_m_s > s.driveline.full_speed_m_s:
        top = f"driveline.full_speed_m_s ({s.driveline.full_speed_m_s:g})"
        found.append(f"path.speed_m_s: must be at most {top}, got {s.path.speed_m_s:g}")
    allowed = getattr(s.path, "lateral_acceleration_m_s2", inf)  # paths that compute their speed observe this limit
    if (aside := min(curvature * s.path.speed_m_s**2, allowed)) > MOST_ASIDE_M_S2:
        found.append(
            f"path.speed_m_s: {s.path.speed_m_s:g} m/s in the sharpest bend ({curvature:.3g} 1/m) needs a lateral "
            f"acceleration of {aside:.2g} m/s2, but tyres provide only {MOST_ASIDE_M_S2:g}; reduce speed or curvature"
        )
    needed = s.tractor.steering_for(curvature)
    if needed >= s.tractor.steer_limit:
        place, key = s.path.sharpest, s.path.radius_key
        remedy = f" (path.{key})" if key else ", or move the points of the path apart"
        found.append(
            f"path: the curvature of {curvature:.3g} 1/m at ({place.x:.1f}, {place.y:.1f}) m, "
            f"{place.distance:.1f} m from the start, needs {degrees(needed):.1f} deg of steering, but the limit is "
            f"{s.tractor.steer_limit_deg:g} deg (radius {s.tractor.tightest_radius:.2f} m); use a larger radius{remedy}"
        )
    return found


def _are_spans(turns: Any) -> bool:
    try:
        return len(turns) > 0 and all(0.0 <= start <= end < inf for start, end in turns)
    except (TypeError, ValueError):
        return False


def equipment_errors(s: Tables) -> Iterator[str]:
    """Yield an error message for each missing implement and for each missing file of learned tables."""
    for table, part in (("guidance", s.guidance), ("steering.loop", s.steering.loop)):
        try:
            part.check()
        except ValueError as error:
            yield prefix_key(table, str(error))
    if s.sensors.implement_gnss.enabled and s.implement.kind == "none":
        yield ('sensors.implement_gnss: the scenario has no implement; set implement.kind = "mounted" or "drawn"')


def ground_errors(s: Tables) -> list[str]:
    """Return error messages about invalid ground, or about a path that starts outside the ground."""
    start = start_of(s.path)
    try:
        if s.terrain.ground().covers(start.x, start.y):
            return []
    except ValueError as error:
        return [prefix_key("terrain", str(error))]
    reach = max(map(abs, s.terrain.ground().extent))
    if max(abs(start.x), abs(start.y)) > reach + FAR_M:
        fix = "shift the path: subtract the coordinates of a point on the field"
    else:
        fix = "make the terrain larger"
    where = f"outside the terrain, which extends {reach:g} m from its centre at (0, 0)"
    return [f"path: the start at ({start.x:g}, {start.y:g}) m is {where}; {fix}"]
