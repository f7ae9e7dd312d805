"""docs/scenarios.md: its example loads, and its tables name what there is."""

import re
import tomllib
from functools import reduce
from pathlib import Path
from typing import Any

from agrobot_mj.scenario import Scenario, resolve, scenario_files
from agrobot_mj.spec import members

TEXT = (Path(__file__).parent.parent / "docs" / "scenarios.md").read_text(encoding="utf-8")


def test_the_example_is_a_scenario():
    (example,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)
    assert resolve(tomllib.loads(example), "example").terrain.kind == "slope"


def test_the_library_is_complete():
    assert sorted(re.findall(r"^\| `(\w+)` \|", TEXT, re.M)) == sorted(scenario_files())


def test_the_kinds_are_complete():
    rows = re.findall(r"^\| `\[\[?([a-z.]+)\]\]?` \| (.+) \|$", TEXT, re.M)
    assert {"plant", "terrain", "fault"} <= {table for table, _ in rows}

    def kinds(model: dict[str, Any], table: str) -> dict[str, Any]:
        fields = [part.model_fields[table] for part in model.values() if table in part.model_fields]
        return {kind: part for field in fields for kind, part in members(field.annotation).items()}

    for table, cell in rows:
        known = reduce(kinds, table.split("."), {"": Scenario})
        assert set(re.findall(r"`(\w+)`", cell)) == set(known), table


def test_every_table_exists():
    for table in re.findall(r"`\[\[?([a-z_.]+)\]\]?`", TEXT):
        reduce(getattr, table.split("."), Scenario())
