"""The scenario: one experiment as data, and how it is made of plain data.

`resolve` has the steps: the machine, the overrides, the kinds, the schema (`tables`) and the files (`checks`).
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
"""Keys that change nothing in a run, or nothing that others would not say."""


class Scenario(Tables):
    """One experiment."""

    @property
    def hash8(self) -> str:
        """Eight hex digits that stand for what the scenario says and the files that it names."""
        return joined(self.identity[:2])

    @property
    def identity(self) -> Identity:
        """Identity of its run, with the code as this process has it; what was expected of the run is no part."""
        content = self.model_dump(mode="json", exclude=SAID)
        read = files(content)
        relocate_files(content)  # the same files in another place are the same experiment
        said = digest(json.dumps(content, sort_keys=True).encode())
        return Identity(said, joined(file_digest(file) for file in read), *code())

    def to_toml(self) -> str:
        """The resolved scenario as TOML; running it gives the same signals."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True) | {"version": __version__})

    def portable(self) -> tuple[str, dict[str, FilePath]]:
        """As `to_toml`, but with data files by names that lie beside it, and the present path of each of them."""
        data = self.model_dump(mode="json", exclude_none=True) | {"version": __version__}
        moved = relocate_files(data)
        return tomli_w.dumps(data), moved

    def changed(self, overrides: Mapping[str, Any], files: bool = True) -> "Scenario":
        """A copy with overrides by dotted key, checked again. Raises `ScenarioError`.

        Without `files` neither path nor ground is built; `check_files` must follow before it is run.
        """
        check_overrides(overrides)
        return resolve(explicit_values(self), self.name or "scenario", overrides, files)


def resolve(
    data: dict[str, Any], source: str, overrides: Mapping[str, Any] | None = None, files: bool = True
) -> Scenario:
    """A scenario from plain data with overrides by dotted key; `source` names it in messages.

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
    """The default scenario on the machine that plain data names: what data and overrides say only a part of.

    Without the machine's guidance law where these have a yaw controller and name no law. Raises `ScenarioError` where
    there is no such machine.
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
