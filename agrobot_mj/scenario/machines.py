"""Machine files: the scenario tables that define a machine, by name from `scenarios/machines/` or by path.

A scenario names its machine. A key such as `tractor.mass_kg` has the value of the scenario, otherwise that of the
machine, otherwise the default. A machine file has the same keys and messages as a scenario. Its `[guidance]` applies if
the scenario names neither a guidance law nor a yaw controller, which belongs to the paper's law.

A body file, `tractor.mjcf`, defines keys of `[tractor]`; given values must agree with it.
"""

from math import isclose
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError, shortened, suggestion
from agrobot_mj.core.resources import absence, machine_files, stamp
from agrobot_mj.plants.mujoco.own_body import measures
from agrobot_mj.scenario.overrides import machine_data, names_file

COMPACT = "compact"
"""Machine of scenarios without `machine`."""
TABLES = ("tractor", "implement", "steering", "driveline", "sensors", "plant", "speed", "guidance")
"""Tables that a machine may have, in addition to its title."""


def machine_file(name: str) -> tuple[Path, int, int, int] | None:
    """Return the file of a machine with modification times and size, None for the default. Raises `ScenarioError`."""
    if name == COMPACT:
        return None
    shipped = machine_files()
    path = shipped.get(name, Path(name))
    if name not in shipped and not names_file("machine", name):
        known = ", ".join(shipped)
        raise ScenarioError(f"machine: unknown {shortened(name)!r}{suggestion(name, list(shipped))} (known: {known})")
    if (content := stamp(str(path))) is None or not path.is_file():
        raise ScenarioError(f"machine: {shortened(str(path))}: {absence(path)}")
    return path, *content[1:]


def machine_tables(path: Path) -> dict[str, Any]:
    """Return the plain data of a machine without its title, with absolute paths. Raises `ScenarioError`."""
    data = machine_data(path)
    data.pop("title", None)
    if other := sorted(set(data) - set(TABLES)):
        raise ScenarioError(f"{path.name}: {other[0]}: not a table of a machine (known: title, {', '.join(TABLES)})")
    return data


SPRINGS = tuple(f"{end}_tyre_{what}" for end in ("front", "rear") for what in ("stiffness_n_m", "damping_n_s_m"))
"""Keys that change the height of a body on its tyres."""
EXACT = 1e-6
"""Relative difference above which a given value contradicts the body [-]."""


def embody(data: dict[str, Any], source: str) -> set[str]:
    """Add the keys of `[tractor]` defined by its body file to plain data; return their names.

    Raises `ScenarioError` with all errors of the body, or all keys that contradict it.
    """
    tractor = data.get("tractor")
    if not isinstance(tractor, dict) or not isinstance(name := tractor.get("mjcf"), str) or not name:
        return set()
    springs = {key: float(k) for key in SPRINGS if isinstance(k := tractor.get(key), int | float) and k > 0}
    try:
        found = measures(name, springs)
    except ValueError as error:
        raise ScenarioError("\n".join(f"{source}: tractor.mjcf: {line}" for line in str(error).split("\n"))) from None
    wrong = [
        f"{source}: tractor.{key}: the body of {Path(name).name} has {value:g}, got {tractor[key]}; leave it out"
        for key, value in found.items()
        if key in tractor and not _same(tractor[key], value)
    ]
    if wrong:
        raise ScenarioError("\n".join(wrong))
    added = set(found) - set(tractor)
    tractor.update(found)
    return added


def _same(given: Any, value: float) -> bool:
    return isinstance(given, int | float) and isclose(given, value, rel_tol=EXACT)
