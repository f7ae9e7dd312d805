"""A tyre for the rig: by its kind, or from a TOML file.

The keys of the tyre stand at the top of the file, under `[tyre]`, or under `[plant.tyre]`, so that a scenario serves too. A
`[tractor]` table sets sizes and loads.
"""

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from agrobot_mj.problems import ScenarioError, explain, suggestion
from agrobot_mj.spec import Spec, members
from agrobot_mj.tractor import TractorParameters
from agrobot_mj.tyres import Tyre


class Specimen(Spec):
    """What the rig tests."""

    tyre: Tyre = Field()
    """The tyre."""
    tractor: TractorParameters = TractorParameters()
    """The tractor whose wheels wear it."""


def load_specimen(source: str) -> Specimen:
    """The tyre of a kind with its default numbers, or that of a TOML file.

    Raises `ScenarioError` with every fault of the input in one message.
    """
    kinds = members(Tyre)
    if source in kinds:
        return Specimen.model_validate({"tyre": {"kind": source}})
    path = Path(source)
    if path.suffix != ".toml" and not path.is_file():
        known = ", ".join(kinds)
        raise ScenarioError(f"unknown tyre {source!r}{suggestion(source, list(kinds))} (known: {known}; or a TOML file)")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path.name}: not valid TOML: {error}") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    return _validated(*_found(data), path.name)


def _found(data: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """The specimen's tables in a file's, and under what the file has the tyre's keys."""
    tractor = {"tractor": data["tractor"]} if "tractor" in data else {}
    plant = data.get("plant")
    if isinstance(plant, dict) and "tyre" in plant:
        return {"tyre": plant["tyre"], **tractor}, "plant.tyre."
    if "tyre" in data:
        return {**data}, "tyre."
    return {"tyre": {key: value for key, value in data.items() if key != "tractor"}, **tractor}, ""


def _validated(data: dict[str, Any], prefix: str, source: str) -> Specimen:
    tyre = data["tyre"]
    if not isinstance(tyre, dict):
        raise ScenarioError(f"{source}: {prefix.rstrip('.')}: must be a table, got {tyre!r}")
    if "kind" not in tyre:
        raise ScenarioError(f'{source}: {prefix}kind: is missing; name one of {", ".join(members(Tyre))}')
    try:
        return Specimen.model_validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        text = explain(error, source, data, Specimen)
        raise ScenarioError(text.replace(f"{source}: tyre.", f"{source}: {prefix}")) from None
