"""Configuration as plain data, before validation: overrides by dotted key, completion by defaults, paths of files."""

from collections.abc import Iterable, Mapping
from copy import deepcopy
from itertools import count
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError, shortened
from agrobot_mj.core.learned import LEARNED
from agrobot_mj.core.resources import SCENARIOS, is_file, library_file
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.scenario.walk import places

FILE_KEY = "file"
"""A key of this name holds the path of a file, relative to the scenario's own folder or to the library's."""


def override(data: dict[str, Any], dotted: str, value: Any, default: Spec) -> None:
    """Set one key (of a list, items count from 0); a new `kind` keeps those keys of the old one that it has too.

    `default` is what `data` says only a part of: a table without a kind is of the default's. Raises `ScenarioError`.
    """
    *tables, last = dotted.split(".")
    dotted = shortened(dotted)
    if not all([*tables, last]):
        raise ScenarioError(f"--set {dotted}: not a key; write it as table.key=value")
    table: Any = data
    for depth, name in enumerate(tables):
        if isinstance(table, list):
            table = _item(table, name, dotted, ".".join(tables[:depth]))
        else:
            counted = (*tables, last)[depth + 1].isdecimal()
            table = table.setdefault(name, [] if counted else {})
        if not isinstance(table, dict | list):
            raise ScenarioError(f"--set {dotted}: {'.'.join(tables[: depth + 1])} is not a table")
    if isinstance(table, list):
        key = ".".join(tables)
        raise ScenarioError(f"--set {dotted}: {key} is a list; write {key}.0.key=value, or set the list as a whole")
    if last == "kind" and _kind(data, tables, default) != value:
        of_kind = (".".join(names := [name for name in tables if not name.isdecimal()]), value)
        known = {key for place in places(default, names) if of_kind in place.kinds for key in place.owner.model_fields}
        for key in [key for key in table if key not in known]:
            del table[key]
    if isinstance(value, Mapping) and isinstance(table.get(last), dict):
        for key, inner in value.items():
            override(data, f"{dotted}.{key}", inner, default)
    else:
        table[last] = dict(value) if isinstance(value, Mapping) else value


def check_overrides(overrides: object) -> None:
    """Raise TypeError unless these are overrides by dotted key."""
    if not isinstance(overrides, Mapping) or not all(isinstance(key, str) for key in overrides):
        raise TypeError(f"overrides: must be a mapping of dotted keys to values, got {shortened(repr(overrides))}")


def _item(items: list[Any], name: str, dotted: str, key: str) -> Any:
    if not name.isdecimal():
        raise ScenarioError(f"--set {dotted}: {key} is a list; write {key}.0.key=value")
    if len(name) > 9 or int(name) >= len(items):
        raise ScenarioError(
            f"--set {dotted}: the scenario has {len(items)} of [[{key}]], counted from 0; write it into the file"
        )
    return items[int(name)]


def _kind(data: Any, tables: list[str], default: Spec) -> Any:
    """Kind of the table under `tables`, that of the default where the data names none; None where neither has one."""
    data = deepcopy(data)
    complete(data, default)
    for name in tables:
        data = data[int(name)] if isinstance(data, list) else data[name]
    return data.get("kind")


def flat(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Keys and values of nested tables, keys dotted; lists stay whole."""
    found = []
    for key, value in table.items():
        found += flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(prefix + key, value)]
    return found


def complete(table: dict[str, Any], default: Spec) -> None:
    """Add to a partial table its kind, and the values in which the default differs from its class."""
    for name, field in type(default).model_fields.items():
        value, given = getattr(default, name), table.get(name)
        if isinstance(given, dict) and isinstance(value, Spec):
            kind = getattr(value, "kind", None)
            if given.setdefault("kind", kind) is None:
                del given["kind"]
            kinds = members(field.annotation)
            if kind is None or given.get("kind") == kind:
                complete(given, value)
            elif isinstance(given["kind"], str) and given["kind"] in kinds:
                complete(given, kinds[given["kind"]]())
        elif name not in table and name in default.model_fields_set:
            table[name] = _plain(value)


def explicit_values(spec: Spec) -> dict[str, Any]:
    """Values set explicitly on a spec, defaults left out, as plain data; kinds always stay."""
    fields = {name: getattr(spec, name) for name in type(spec).model_fields if name in (*spec.model_fields_set, "kind")}
    return {key: _plain(value) for key, value in fields.items() if value is not None}


def _plain(value: Any) -> Any:
    if isinstance(value, Spec):
        return explicit_values(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def absolute_paths(data: Any, *folders: Path) -> None:
    """Make the paths of files absolute: the first folder that has the file counts, else the last.

    Files of the library keep their names, unless one of the folders has a file of the same name.
    """
    for table in _children(data):
        absolute_paths(table, *folders)
    others = [folder for folder in folders if folder != SCENARIOS.resolve()]
    if others and isinstance(data, dict) and isinstance(file := data.get(FILE_KEY), str):
        found = next((folder / file for folder in others if is_file(folder / file)), None)
        if found or not is_file(SCENARIOS / file):
            data[FILE_KEY] = str(found or others[-1] / file)


def files(data: Any) -> list[Path]:
    """Every file that plain data names."""
    found = [file for table in _children(data) for file in files(table)]
    if isinstance(data, dict) and isinstance(file := data.get(FILE_KEY), str):
        found.append(library_file(file))
    return found


def relocate_files(data: Any) -> dict[str, Path]:
    """Replace the paths of files in plain data by names, under which they can lie beside it; the file of each name.

    Files of the library keep theirs. Two files of one name get numbers.
    """
    found: dict[str, Path] = {}
    _name_files(data, found)
    return found


def _name_files(data: Any, found: dict[str, Path]) -> None:
    for table in _children(data):
        _name_files(table, found)
    if not (isinstance(data, dict) and isinstance(file := data.get(FILE_KEY), str) and Path(file).is_absolute()):
        return
    path = Path(file)
    numbered = (path.name if n == 1 else f"{path.stem}-{n}{path.suffix}" for n in count(1))
    name = next(name for name in numbered if name != LEARNED and found.get(name, path) == path)
    found[name], data[FILE_KEY] = path, name


def _children(data: Any) -> Iterable[Any]:
    return data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
