"""A tyre for the rig: by its kind, or from a TOML file.

The keys of the tyre stand at the top of the file, under `[tyre]`, or under `[plant.tyre]`, so that a scenario also
works. A `[tractor]` table sets sizes and loads.
"""

from pathlib import Path
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Mujoco
from agrobot_mj.scenario.loading import read_toml
from agrobot_mj.scenario.reference import families
from agrobot_mj.scenario.schema import resolve
from agrobot_mj.tyres import Tyre


class Specimen(NamedTuple):
    """A tyre to test, with its tractor."""

    tyre: Tyre
    """The tyre."""
    tractor: TractorParameters
    """Tractor on whose wheels it is mounted."""


def load_specimen(source: str) -> Specimen:
    """The tyre of a kind with its default numbers, or that of a TOML file.

    Raises `ScenarioError` with every fault of the input in one message.
    """
    kinds = list(families()["plant.tyre"])
    if source in kinds:
        return _resolved({"tyre": {"kind": source}}, "tyre.", source)
    path = Path(source)
    if path.suffix != ".toml" and not path.is_file():
        hint = f"{suggestion(source, kinds)} (known: {', '.join(kinds)}; or a TOML file)"
        raise ScenarioError(f"unknown tyre {source!r}{hint}")
    return _resolved(*_found(read_toml(path)), path.name)


def _found(data: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """The tables `tyre` and `tractor` of a file, and the prefix of the tyre's keys in it."""
    rest = {key: value for key, value in data.items() if key != "tractor"}
    tractor = {"tractor": data["tractor"]} if "tractor" in data else {}
    plant = data.get("plant")
    if isinstance(plant, dict) and "tyre" in plant:
        return {"tyre": plant["tyre"], **tractor}, "plant.tyre."
    return ({**rest, **tractor}, "tyre.") if "tyre" in data else ({"tyre": rest, **tractor}, "")


def _resolved(data: dict[str, Any], prefix: str, source: str) -> Specimen:
    """The tyre resolved like a scenario's plant, so that its keys mean the same in both."""
    tyre, known = data.pop("tyre"), ", ".join(families()["plant.tyre"])
    if not isinstance(tyre, dict):
        raise ScenarioError(f"{source}: {prefix.rstrip('.')}: must be a table, got {tyre!r}")
    if "kind" not in tyre:
        raise ScenarioError(f"{source}: {prefix}kind: is missing; name one of {known}")
    try:
        scenario = resolve({"plant": {"kind": "mujoco", "tyre": tyre}, **data}, source)
    except ScenarioError as error:
        raise ScenarioError(str(error).replace(f"{source}: plant.tyre.", f"{source}: {prefix}")) from None
    if not isinstance(scenario.plant, Mujoco):
        raise ScenarioError(f"{source}: plant.kind: must be 'mujoco', got {scenario.plant.kind!r}")
    return Specimen(scenario.plant.tyre, scenario.tractor)
