"""Scenario: description of one experiment, and its construction from plain data.

`resolve` applies machine, overrides and kinds, validates the data (`tables`), and checks the files (`checks`).
"""

import json
from collections.abc import Mapping
from copy import deepcopy
from functools import cache, lru_cache
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import Any

import tomli_w

from agrobot_mj.core.contracts import check_overrides
from agrobot_mj.core.identity import Identity, code, digest, file_digest, joint_digest
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.checks import check_files
from agrobot_mj.scenario.machines import COMPACT, embody, machine_file, machine_tables
from agrobot_mj.scenario.overrides import (
    complete,
    explicit_values,
    files,
    forget,
    override,
    read_spec,
    relocate_files,
)
from agrobot_mj.scenario.tables import Tables

SAID = {"version", "name", "title", "expected_outcome", "expected_reason", "gains", "machine"}
"""Keys excluded from the run identity, because they have no effect on a run or only set defaults of other keys."""


class Scenario(Tables):
    """Complete description of one simulated experiment."""

    @property
    def hash8(self) -> str:
        """Hash of the scenario and of its files, as eight hexadecimal digits."""
        return joint_digest(self.identity[:2])

    @property
    def identity(self) -> Identity:
        """Digests of the scenario (without the keys in `SAID`), of its files, and of the code of this process."""
        content = self.model_dump(mode="json", exclude=SAID)
        read = files(content)
        relocate_files(content)  # the locations of files are not part of the experiment
        said = digest(json.dumps(content, sort_keys=True).encode())
        return Identity(said, joint_digest(file_digest(file) for file in read), *code())

    def to_toml(self) -> str:
        """Return the scenario with all values, including defaults, as TOML text.

        A run of this text with the same package version reproduces the same signals.
        """
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True) | {"version": __version__})

    def portable(self) -> tuple[str, dict[str, FilePath]]:
        """Return the scenario as TOML text with file names instead of paths, and the original path of each file
        name."""
        data = self.model_dump(mode="json", exclude_none=True) | {"version": __version__}
        moved = relocate_files(data)
        return tomli_w.dumps(data), moved

    def changed(self, overrides: Mapping[str, Any], files: bool = True) -> "Scenario":
        """Return a validated copy with overrides by dotted key. Raises `ScenarioError` for invalid overrides.

        Without `files`, path and ground are not checked, and `check_files` must be called before a run.
        """
        check_overrides(overrides)
        return resolve(explicit_values(self), self.name or "scenario", overrides, files)


def resolve(
    data: dict[str, Any], source: str, overrides: Mapping[str, Any] | None = None, files: bool = True
) -> Scenario:
    """Return a scenario built from plain data (nested dicts) with overrides by dotted key.

    `source` names the data in error messages. If `files` is false, path and ground are not checked.
    """
    overrides = overrides or {}
    default = on_machine(data, overrides)
    for key, value in sorted(overrides.items(), key=lambda item: item[0] != "machine"):
        override(data, key, value, default)
    own = deepcopy(data)
    complete(data, default)
    scenario = _validate(data, source)
    forget(scenario, own)
    if files:
        check_files(scenario, source)
    return scenario


def _validate(data: dict[str, Any], source: str) -> Scenario:
    added = embody(data, source)
    scenario = read_spec(Scenario, data, source)
    scenario.tractor.model_fields_set.difference_update(added)
    return scenario


def on_machine(data: Mapping[str, Any], overrides: Mapping[str, Any] = MappingProxyType({})) -> Scenario:
    """Return the default scenario of the machine selected by plain data or overrides.

    The guidance law of the machine is omitted if data or overrides set only a yaw controller. Raises `ScenarioError`
    for an unknown machine.
    """
    name = overrides.get("machine", data.get("machine", COMPACT))
    if not isinstance(name, str) or (found := machine_file(name)) is None:
        return compact()
    laws = (data.get("guidance"), overrides.get("guidance"))
    named = "guidance.kind" in overrides or any(isinstance(law, Mapping) and "kind" in law for law in laws)
    inner = any(key.partition(".")[0] == "controller" for key in (*data, *overrides))
    return _on_machine(inner and not named, *found)


@cache
def compact() -> Scenario:
    """Return the default scenario, which uses the default machine `compact`."""
    return Scenario.model_construct()


@lru_cache(maxsize=64)
def _on_machine(cascade: bool, path: FilePath, *_changed: int) -> Scenario:
    tables = machine_tables(path)
    if cascade:
        tables.pop("guidance", None)
    complete(tables, Scenario())
    return _validate(tables, path.name)
