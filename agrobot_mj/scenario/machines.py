"""Machines as files: the tables of a scenario that make a machine, by name from `scenarios/machines/` or by path.

A scenario names its machine, whose keys stand below its own: `tractor.mass_kg` is the scenario's, else the machine's,
else the default. The machine is data as a scenario is, with the same keys and messages.
"""

from pathlib import Path
from typing import Any

from agrobot_mj.core.datafile import stamp
from agrobot_mj.core.errors import ScenarioError, shortened, suggestion
from agrobot_mj.core.resources import machine_files
from agrobot_mj.scenario.overrides import absolute_paths, names_file, read_toml

COMPACT = "compact"
"""Machine of a scenario that names none."""
TABLES = ("tractor", "implement", "steering", "driveline", "sensors", "plant", "speed")
"""Tables that a machine may have, beside its title."""


def machine_file(name: str) -> tuple[Path, int, int] | None:
    """File of a machine with time and size of its content, None for the default. Raises `ScenarioError`."""
    if name == COMPACT:
        return None
    shipped = machine_files()
    path = shipped.get(name, Path(name))
    if name not in shipped and not names_file("machine", name):
        known = ", ".join(shipped)
        raise ScenarioError(f"machine: unknown {shortened(name)!r}{suggestion(name, list(shipped))} (known: {known})")
    if (content := stamp(str(path))) is None or not path.is_file():
        raise ScenarioError(f"machine: {shortened(str(path))}: no such file")
    return path, *content[1:]


def machine_tables(path: Path) -> dict[str, Any]:
    """Plain data of a machine without its title; paths in it are absolute. Raises `ScenarioError`."""
    data = read_toml(path)
    data.pop("title", None)
    if other := sorted(set(data) - set(TABLES)):
        raise ScenarioError(f"{path.name}: {other[0]}: no part of a machine (known: title, {', '.join(TABLES)})")
    absolute_paths(data, path.parent.resolve())
    return data
