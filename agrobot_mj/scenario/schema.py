"""Scenario: one experiment as data, and its construction from plain data.

`resolve` applies the steps: machine, overrides, kinds, schema (`tables`), and files (`checks`).
"""

import json
from collections.abc import Mapping
from copy import deepcopy
from functools import lru_cache
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import Any

import tomli_w

from agrobot_mj.core.contracts import check_overrides
from agrobot_mj.core.identity import Identity, code, digest, file_digest, joined
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
"""Keys that have no effect on a run, or that repeat other keys."""


class Scenario(Tables):
    """One experiment."""

    @property
    def hash8(self) -> str:
        """Eight hex digits of the scenario's content and of the files that it names."""
        return joined(self.identity[:2])

    @property
    def identity(self) -> Identity:
        """Identity of the run with the code of this process; the expected outcome is excluded."""
        content = self.model_dump(mode="json", exclude=SAID)
        read = files(content)
        relocate_files(content)  # the same files in another place are the same experiment
        said = digest(json.dumps(content, sort_keys=True).encode())
        return Identity(said, joined(file_digest(file) for file in read), *code())

    def to_toml(self) -> str:
        """Return the resolved scenario as TOML, which reproduces the same signals."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True) | {"version": __version__})

    def portable(self) -> tuple[str, dict[str, FilePath]]:
        """Return `to_toml` with data files by names in the same folder, and the present path of each file."""
        data = self.model_dump(mode="json", exclude_none=True) | {"version": __version__}
        moved = relocate_files(data)
        return tomli_w.dumps(data), moved

    def changed(self, overrides: Mapping[str, Any], files: bool = True) -> "Scenario":
        """Return a copy with overrides by dotted key, validated again. Raises `ScenarioError`.

        Without `files` neither path nor ground is built; `check_files` must follow before a run.
        """
        check_overrides(overrides)
        return resolve(explicit_values(self), self.name or "scenario", overrides, files)


def resolve(
    data: dict[str, Any], source: str, overrides: Mapping[str, Any] | None = None, files: bool = True
) -> Scenario:
    """Return a scenario from plain data with overrides by dotted key; `source` names it in messages.

    Without `files` neither path nor ground is built. Raises `ScenarioError`.
    """
    overrides = overrides or {}
    default = on_machine(data, overrides)
    for key, value in sorted(overrides.items(), key=lambda item: item[0] != "machine"):
        override(data, key, value, default)
    own = deepcopy(data)
    complete(data, default)
    scenario = _validated(data, source)
    forget(scenario, own)
    if files:
        check_files(scenario, source)
    return scenario


def _validated(data: dict[str, Any], source: str) -> Scenario:
    added = embody(data, source)
    scenario = read_spec(Scenario, data, source)
    scenario.tractor.model_fields_set.difference_update(added)
    return scenario


def on_machine(data: Mapping[str, Any], overrides: Mapping[str, Any] = MappingProxyType({})) -> Scenario:
    """Return the default scenario on the machine named in plain data, which data and overrides then modify.

    Omits the machine's guidance law if these have a yaw controller and name no law. Raises `ScenarioError` for an
    unknown machine.
    """
    name = overrides.get("machine", data.get("machine", COMPACT))
    if not isinstance(name, str) or (found := machine_file(name)) is None:
        return Scenario.model_construct()
    laws = (data.get("guidance"), overrides.get("guidance"))
    named = "guidance.kind" in overrides or any(isinstance(law, Mapping) and "kind" in law for law in laws)
    inner = any(key.partition(".")[0] == "controller" for key in (*data, *overrides))
    return _on_machine(inner and not named, *found)


@lru_cache(maxsize=64)
def _on_machine(cascade: bool, path: FilePath, *_changed: int) -> Scenario:
    tables = machine_tables(path)
    if cascade:
        tables.pop("guidance", None)
    complete(tables, Scenario())
    return _validated(tables, path.name)
