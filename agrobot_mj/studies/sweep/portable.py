"""A sweep with its data files beside it: names instead of paths, so that results can be moved and shown to others."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

from agrobot_mj.scenario.overrides import FILE_KEY, explicit_values, relocate_files
from agrobot_mj.studies.sweep.schema import Sweep, resolved


class PortableSweep(NamedTuple):
    """What `sweep.toml` and `base.toml` say, and the files that lie beside them."""

    sweep: dict[str, Any]
    """The sweep, as `schema.resolved`."""
    base: dict[str, Any]
    """Its base scenario, defaults left out."""
    files: dict[str, Path]
    """Data files by name, each where it lies now."""

    @property
    def names(self) -> dict[str, str]:
        """Names by path."""
        return {str(path): name for name, path in self.files.items()}


def portable(sweep: Sweep) -> PortableSweep:
    """The sweep with every data file named as if it lay beside it; files of the library keep their names."""
    content, base = resolved(sweep), explicit_values(sweep.base)
    files = relocate_files([base, *_file_tables(content)])
    names = {str(path): name for name, path in files.items()}
    content["axes"] = {key: [renamed(key, v, names) for v in values] for key, values in content["axes"].items()}
    for key, draw in content["draws"].items():
        if "choice" in draw:
            draw["choice"] = [renamed(key, value, names) for value in draw["choice"]]
    for variant in content["variant"]:
        variant["set"] = {key: renamed(key, value, names) for key, value in variant["set"].items()}
    return PortableSweep(content, base, files)


def renamed(key: str, value: Any, names: Mapping[str, str]) -> Any:
    """A value of a dotted key with the paths of files in it replaced by their names."""
    if isinstance(value, str):
        return names.get(value, value) if _last(key) == FILE_KEY else value
    if isinstance(value, Mapping):
        return {inner: renamed(inner, each, names) for inner, each in value.items()}
    return [renamed("", each, names) for each in value] if isinstance(value, list | tuple) else value


def _file_tables(content: dict[str, Any]) -> list[dict[str, Any]]:
    """Values of axes, draws and variants that are names of files, or tables that may hold such, as copies."""
    values = [(key, value) for key, each in content["axes"].items() for value in each]
    values += [(key, value) for key, draw in content["draws"].items() for value in draw.get("choice", [])]
    values += [pair for variant in content["variant"] for pair in variant["set"].items()]
    return [{_last(key): deepcopy(value)} for key, value in values if isinstance(value, str | dict | list)]


def _last(key: str) -> str:
    return key.rpartition(".")[2]
