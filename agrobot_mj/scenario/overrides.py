"""Processing of scenario data before validation: overrides by dotted key, default values, and file paths."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from agrobot_mj.core.errors import ScenarioError, shorten
from agrobot_mj.core.learned import LEARNED
from agrobot_mj.core.messages import explain
from agrobot_mj.core.resources import SCENARIOS, absence, is_file, library_file
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.core.walk import elsewhere, places
from agrobot_mj.paths.imports.agopengps import BOUNDARY, TRACKS
from agrobot_mj.plants.mujoco.own_files import own_files

S = TypeVar("S", bound=Spec)
FILE_KEYS = ("file", "machine", "mjcf")
"""Names of the keys whose values are file paths, relative to the folder of the scenario or of the shipped scenarios."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file as a dict. Raises `ScenarioError` if the file cannot be read."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ScenarioError(f"{path}: {absence(path)}")  # reading a pipe would block
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # includes huge integers and text that is not UTF-8
        raise ScenarioError(f"{path.name}: not valid TOML: {error}") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None


def json_text(data: Mapping[str, Any], source: str) -> bytes:
    """Return a mapping as JSON text in bytes; tuples become lists. Raises `ScenarioError` for invalid values."""
    try:
        return json.dumps(data, default=_as_plain, ensure_ascii=False).encode()
    except ValueError:  # includes UnicodeEncodeError
        reason = "a number has thousands of digits, or a string is not valid UTF-8"
        raise ScenarioError(f"{source}: {reason}; correct the value") from None


def _as_plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


def read_spec(kind: type[S], data: Mapping[str, Any], source: str) -> S:
    """Validate data as a `Spec` of class `kind`; `source` names the data. Raises `ScenarioError` with all errors."""
    try:
        return kind.model_validate_json(json_text(data, source))
    except ValidationError as error:
        raise ScenarioError(explain(error, source, data, kind)) from None


def override(data: dict[str, Any], dotted: str, value: Any, default: Spec) -> None:
    """Set the value of a dotted key in scenario data. List items are numbered from 0.

    A table whose `kind` changes retains the keys that both kinds have. A table without `kind` has the kind of
    `default`. Raises `ScenarioError` for an invalid key.
    """
    *tables, last = dotted.split(".")
    if not all([*tables, last]):
        raise ScenarioError(f"--set {shorten(dotted)}: this is not a key; specify table.key=value")
    table: Any = data
    for depth, name in enumerate(tables):
        if isinstance(table, list):
            table = _item(table, name, dotted, ".".join(tables[:depth]))
        else:
            counted = (*tables, last)[depth + 1].isdecimal()
            table = table.setdefault(name, [] if counted else {})
        if not isinstance(table, dict | list):
            near = elsewhere(type(default), last)
            raise ScenarioError(f"--set {shorten(dotted)}: {'.'.join(tables[: depth + 1])} is not a table{near}")
    if isinstance(table, list):
        key = ".".join(tables)
        raise ScenarioError(
            f"--set {shorten(dotted)}: {key} is a list; specify {key}.0.key=value, or set the complete list"
        )
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


def _item(items: list[Any], name: str, dotted: str, key: str) -> Any:
    if not name.isdecimal():
        raise ScenarioError(f"--set {shorten(dotted)}: {key} is a list; specify {key}.0.key=value")
    if len(name) > 9 or int(name) >= len(items):
        has = f"the scenario has {len(items)} tables [[{key}]], and 0 is the first; add one to the file"
        raise ScenarioError(f"--set {shorten(dotted)}: {has}")
    return items[int(name)]


def _kind(data: Any, tables: list[str], default: Spec) -> Any:
    """Return the kind of the table at the key path `tables`, or None for a table without kinds. A table that does not
    set `kind` has the kind of `default`."""
    data = deepcopy(data)
    complete(data, default)
    for name in tables:
        data = data[int(name)] if isinstance(data, list) else data[name]
    return data.get("kind")


def flat(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return the values of nested tables as pairs of dotted key and value. A list is one value."""
    found = []
    for key, value in table.items():
        found += flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(prefix + key, value)]
    return found


def complete(table: dict[str, Any], default: Spec) -> None:
    """Complete a partial table with the kind and the explicitly set values of `default`."""
    for name, field in type(default).model_fields.items():
        value, given = getattr(default, name), table.get(name)
        if isinstance(given, dict) and isinstance(value, Spec):
            kind = getattr(value, "kind", None)
            if given.setdefault("kind", kind) is None:
                del given["kind"]
            if kind is None or given.get("kind") == kind:
                complete(given, value)
            elif isinstance(given["kind"], str) and (other := members(field.annotation).get(given["kind"])):
                complete(given, other.model_construct())
        elif name not in table and name in default.model_fields_set:
            table[name] = _plain(value)


def explicit_values(spec: Spec) -> dict[str, Any]:
    """Return the explicitly set values of a configuration as dicts and lists. The key `kind` is always included."""
    explicit = spec.model_fields_set | {"kind"}
    fields = {name: getattr(spec, name) for name in type(spec).model_fields if name in explicit}
    return {key: _plain(value) for key, value in fields.items() if value is not None}


def forget(spec: Spec, own: Mapping[str, Any]) -> None:
    """Mark only the keys in `own` as explicitly set, in the configuration `spec` and its nested tables."""
    for name in list(spec.model_fields_set):
        if name not in own:
            spec.model_fields_set.discard(name)
        elif isinstance(value := getattr(spec, name), Spec) and isinstance(own[name], Mapping):
            forget(value, own[name])


def _plain(value: Any) -> Any:
    if isinstance(value, Spec):
        return explicit_values(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def absolute_paths(data: Any, *folders: Path) -> None:
    """Make the file paths in scenario data absolute.

    The base is the first of `folders` that contains the file, or the last of `folders` if the file is missing in all.
    """
    others = [folder for folder in folders if folder != SCENARIOS.resolve()]
    for table, key in naming_files(data) if others else ():
        file = table[key]
        found = next((folder / file for folder in others if is_file(folder / file)), None)
        if found or not is_file(SCENARIOS / file):
            # Gives one path per file, even if the file has several names.
            table[key] = str(found.parent.resolve() / found.name if found else others[-1] / file)


def absolute_values(overrides: Mapping[str, Any], *folders: Path) -> dict[str, Any]:
    """Return a copy of overrides by dotted key, with file paths made absolute by `absolute_paths`."""
    return {key: absolute_value(key, value, *folders) for key, value in overrides.items()}


def absolute_value(key: str, value: Any, *folders: Path) -> Any:
    """Return a copy of the value of a dotted key, with file paths made absolute by `absolute_paths`."""
    table = {key.rpartition(".")[2]: deepcopy(value)}
    absolute_paths(table, *folders)
    return table.popitem()[1]


def beside_copies(data: Any, folder: Path) -> None:
    """Replace the paths of missing files by the paths of files with the same names in `folder`, such as a results
    folder."""
    for table, key in naming_files(data):
        path = Path(table[key])
        if path.is_absolute() and not is_file(path) and is_file(folder / path.name):
            table[key] = str(folder / path.name)


def files(data: Any) -> list[Path]:
    """Return the files named in scenario data, and recursively the files named in these files, without duplicates."""
    found = [(key, library_file(table[key])) for table, key in naming_files(data)]
    return list(dict.fromkeys(file for key, path in found for file in (path, *beside(key, path))))


def relocate_files(data: Any) -> dict[str, Path]:
    """Replace absolute file paths in scenario data by unique file names; return the original path of each file name."""
    named = [(table, key) for table, key in naming_files(data) if Path(table[key]).is_absolute()]
    found: dict[str, Path] = {}
    for other in (other for table, key in named for other in beside(key, Path(table[key]))):
        if (known := found.setdefault(other.name, other)) != other:
            raise ScenarioError(f"{other}: has the same name as {known}, and other files refer to both; rename one")
    for table, key in named:
        path = Path(table[key])
        numbered = (path.name if n == 1 else f"{path.stem}-{n}{path.suffix}" for n in count(1))
        name = next(name for name in numbered if name != LEARNED and found.get(name, path) == path)
        found[name], table[key] = path, name
    return found


def beside(key: str, path: Path) -> tuple[Path, ...]:
    """Return the files named in a machine file or body file, recursively. For guidance lines of AgOpenGPS, return the
    field boundary in the same folder; for a shapefile, its .prj file. The tuple is empty for other files."""
    ends = (".prj", ".PRJ") if path.suffix.lower() == ".shp" else ()
    others = [path.with_name(BOUNDARY)] if path.name == TRACKS else [path.with_suffix(end) for end in ends]
    if found := [other for other in others if other.is_file()]:
        return tuple(found)
    try:
        if key == "mjcf":
            return own_files(str(path)).others
        tables = machine_data(path) if key == "machine" else {}
    except ValueError:  # the error is reported when the file is read
        return ()
    named = [(inner, library_file(table[inner])) for table, inner in naming_files(tables) if inner != "machine"]
    return tuple(file for inner, path in named for file in (path, *beside(inner, path)))


def machine_data(path: Path) -> dict[str, Any]:
    """Return the tables of a machine file with absolute paths. Raises `ScenarioError` for an unreadable file."""
    data = read_toml(path)
    absolute_paths(data, path.parent.resolve())
    beside_copies(data, path.parent.resolve())
    return data


def naming_files(data: Any) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield each table of scenario data that contains a file path, and the key of the path. Inner tables come first."""
    for table in data.values() if isinstance(data, dict) else data if isinstance(data, list) else ():
        if isinstance(table, dict | list):
            yield from naming_files(table)
    if isinstance(data, dict):
        yield from (
            (data, key) for key in FILE_KEYS if isinstance(value := data.get(key), str) and names_file(key, value)
        )


def names_file(key: str, value: str) -> bool:
    """Return whether the value of a key in `FILE_KEYS` is a path; the value of `machine` may also be a name."""
    return key != "machine" or value.endswith(".toml") or len(Path(value).parts) > 1
