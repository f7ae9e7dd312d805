"""Loading of scenario files by name or path, with overrides by dotted key."""

from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

from agrobot_mj.core.contracts import check_argument, check_overrides
from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.resources import absence, scenario_files
from agrobot_mj.core.spec import UNPRINTABLE
from agrobot_mj.scenario.overrides import absolute_paths, absolute_values, read_toml
from agrobot_mj.scenario.plugins import with_plugin_options
from agrobot_mj.scenario.schema import Scenario, resolve

__all__ = ["load_scenario", "read_toml", "scenario_files"]


def load_scenario(source: str | FilePath, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Load a scenario by name or path, with overrides by dotted key.

    File paths in overrides are relative to the working directory or, if the file is missing there, to the folder of the
    scenario. Raises `ScenarioError` with all errors of the input, and TypeError for an argument of a wrong type.
    """
    check_argument("scenario", source, isinstance(source, str | FilePath), "a name or a path")
    check_overrides({} if overrides is None else overrides)
    files = scenario_files()
    path = files.get(str(source)) or find_file(source, "scenario", files, "", "see agrobot-mj list")
    try:
        data, folder = read_toml(path), path.parent.resolve()
        absolute_paths(data, folder)
        data.setdefault("name", UNPRINTABLE.sub("_", path.stem)[:200])
        return resolve(data, path.name, absolute_values(overrides or {}, FilePath.cwd(), folder))
    except ScenarioError as error:
        raise with_plugin_options(error, path) from None
    except RecursionError:
        raise ScenarioError(f"{path.name}: the tables or overrides are nested too deeply") from None


def find_file(source: str | FilePath, noun: str, shipped: Mapping[str, FilePath], folder: str, known: str) -> FilePath:
    """Find a file by path or name, with or without `.toml`. User files take precedence over the `shipped` files.

    `noun` names the type of file in error messages. A message ends with `folder` if the source is a folder, and with
    `known` if the name is unknown. Raises `ScenarioError` if there is no file.
    """
    path = FilePath(source)
    if path.is_dir():
        raise ScenarioError(f"{path}: {absence(path, f'specify a {noun} file{folder}')}")
    if path.is_file():
        return path
    if str(source) in shipped:
        return shipped[str(source)]
    if path.suffix == ".toml" or len(path.parts) > 1 or path.exists():
        raise ScenarioError(f"{path}: {absence(path)}")
    if (beside := path.with_name(f"{path.name}.toml")).is_file():
        return beside
    near = suggestion(str(source), list(shipped))
    raise ScenarioError(f"unknown {noun} {str(source)!r}{near} ({known})")
