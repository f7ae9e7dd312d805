"""docs/scenarios.md: its example is valid, and its tables, the table of faults and the gallery are complete."""

import re
import tomllib
from functools import reduce
from pathlib import Path
from typing import Any, get_args

from removed import needs_all

from agrobot_mj.core.signals import Outcome
from agrobot_mj.core.spec import members
from agrobot_mj.faults import Fault, Scripted
from agrobot_mj.scenario.loading import scenario_files
from agrobot_mj.scenario.schema import Scenario, resolve

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "scenarios.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    """Return the text below a heading, up to the next heading."""
    return TEXT.partition(f"## {heading}\n")[2].partition("\n## ")[0]


def test_example_of_the_page_is_a_valid_scenario():
    whole, faults = re.findall(r"```toml\n(.*?)```", TEXT, re.S)
    assert resolve(tomllib.loads(whole), "example").terrain.kind == "slope"
    assert [fault.kind for fault in resolve(tomllib.loads(faults), "example").fault] == ["gnss_loss", "valve_wear"]


def test_scenario_gallery_contains_every_shipped_scenario():
    text = (DOCS / "reference" / "library.md").read_text(encoding="utf-8")
    named = (r"^\| \[`(\w+)`\]\(#\1\) \|", r"^## `(\w+)`$", r"^!\[.*\]\(\.\./images/scenarios/(\w+)\.png\)$")
    for pattern in named:
        assert re.findall(pattern, text, re.M) == sorted(scenario_files()), pattern


def test_every_fault_kind_is_listed_on_the_page_with_its_keys():
    page = (DOCS / "reference" / "faults.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .+ \| (.*)\|$", page, re.M)
    written = {kind: set(re.findall(r"`(\w+)`", keys)) for kind, keys in rows}
    common = set(Scripted.model_fields)
    assert written == {kind: set(fault.model_fields) - common for kind, fault in members(Fault).items()}


def test_every_run_outcome_is_listed_on_the_page():
    assert set(re.findall(r"^\| `(\w+)` \|", section("How a run ends"), re.M)) == set(get_args(Outcome))


@needs_all
def test_every_kind_of_the_package_is_listed_on_the_page():
    """Kinds that other tests register in the same process are excluded."""
    rows = re.findall(r"^\| `\[\[?([a-z.]+)\]\]?` \| (.+) \|$", TEXT, re.M)
    assert {"plant", "terrain", "estimator"} <= {table for table, _ in rows}

    def kinds(model: dict[str, Any], table: str) -> dict[str, Any]:
        fields = [part.model_fields[table] for part in model.values() if table in part.model_fields]
        parts = {kind: part for field in fields for kind, part in members(field.annotation).items()}
        return {kind: part for kind, part in parts.items() if part.__module__.startswith("agrobot_mj.")}

    for table, cell in rows:
        known = reduce(kinds, table.split("."), {"": Scenario})
        assert set(re.findall(r"`(\w+)`", cell)) == set(known), table


def test_every_scenario_table_named_on_the_page_exists():
    for table in re.findall(r"`\[\[?([a-z_.]+)\]\]?`", TEXT):
        reduce(getattr, table.split("."), Scenario())
