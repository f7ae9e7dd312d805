"""A sweep with its data files beside it: names instead of paths, so that results can be moved and shown to others."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

from agrobot_mj.scenario.overrides import FILE_KEYS, explicit_values, relocate_files
from agrobot_mj.studies.sweep.schema import Sweep, changed_values, last, resolved


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
    content, base, tables = resolved(sweep), explicit_values(sweep.base), list[dict[str, Any]]()
    changed_values(content, lambda key, value: tables.append({last(key): deepcopy(value)}))
    files = relocate_files([base, *tables])
    names = {str(path): name for name, path in files.items()}
    return PortableSweep(changed_values(content, lambda key, value: renamed(key, value, names)), base, files)


def renamed(key: str, value: Any, names: Mapping[str, str]) -> Any:
    """A value of a dotted key with the paths of files in it replaced by their names."""
    if isinstance(value, str):
        return names.get(value, value) if last(key) in FILE_KEYS else value
    if isinstance(value, Mapping):
        return {inner: renamed(inner, each, names) for inner, each in value.items()}
    return [renamed("", each, names) for each in value] if isinstance(value, list | tuple) else value
