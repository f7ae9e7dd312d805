"""Machine files: TOML files with the scenario tables of one machine, given by name (`scenarios/machines/`) or path.

The key `machine` of a scenario selects the machine. Keys of the scenario take precedence over keys of the machine, and
both take precedence over the defaults. Keys and error messages are the same as in scenario files. The table
`[guidance]` of a machine applies if the scenario sets neither a guidance law nor a yaw controller.

An MJCF body file (`tractor.mjcf`) defines keys of `[tractor]`. Values given for these keys must agree with the file.
"""

from math import isclose
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError, shorten, suggestion
from agrobot_mj.core.resources import absence, machine_files, stamp
from agrobot_mj.plants.mujoco.own_body import measures
from agrobot_mj.scenario.overrides import machine_data, names_file

COMPACT = "compact"  # Default machine of a scenario
TABLES = ("tractor", "implement", "steering", "driveline", "sensors", "estimator", "plant", "speed", "guidance")
"""Tables that a machine file may contain, in addition to the key `title`."""


def machine_file(name: str) -> tuple[Path, int, int, int] | None:
    """Return path, modification time, status-change time and size of a machine file, or None for the default machine.

    Raises `ScenarioError` for a missing file.
    """
    if name == COMPACT:
        return None
    shipped = machine_files()
    path = shipped.get(name, Path(name))
    if name not in shipped and not names_file("machine", name):
        known = ", ".join(shipped)
        raise ScenarioError(f"machine: unknown {shorten(name)!r}{suggestion(name, list(shipped))} (known: {known})")
    if (content := stamp(str(path))) is None or not path.is_file():
        raise ScenarioError(f"machine: {shorten(str(path))}: {absence(path)}")
    return path, *content[1:]


def machine_tables(path: Path) -> dict[str, Any]:
    """Return the tables of a machine file with absolute paths. Raises `ScenarioError` for an invalid file."""
    data = machine_data(path)
    data.pop("title", None)
    if other := sorted(set(data) - set(TABLES)):
        raise ScenarioError(f"{path.name}: {other[0]}: unknown table (known: title, {', '.join(TABLES)})")
    return data


TYRE_KEYS = ("pressure_bar", "stiffness_n_m", "damping_n_s_m")
SPRINGS = tuple(f"{end}_tyre_{what}" for end in ("front", "rear") for what in TYRE_KEYS)
"""Keys of `[tractor]` for the tyres, which affect the height of the tractor body."""
EXACT = 1e-6  # Maximum relative difference between a given value and the value from the body file [-]


def embody(data: dict[str, Any], source: str) -> set[str]:
    """Add the keys of `[tractor]` that the MJCF body file defines to the plain data `data`, and return their names."""
    tractor = data.get("tractor")
    if not isinstance(tractor, dict) or not isinstance(name := tractor.get("mjcf"), str) or not name:
        return set()
    springs = {key: float(k) for key in SPRINGS if isinstance(k := tractor.get(key), int | float) and k > 0}
    try:
        found = measures(name, springs)
    except ValueError as error:
        raise ScenarioError("\n".join(f"{source}: tractor.mjcf: {line}" for line in str(error).split("\n"))) from None
    wrong = [
        f"{source}: tractor.{key}: the body of {Path(name).name} has {value:g}, got {tractor[key]}; omit the key"
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
