"""docs/models.md gives every estimate of the code with its value, a range and a source."""

import re
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from agrobot_mj.core.spec import Spec, members
from agrobot_mj.scenario.schema import Scenario, resolve

TEXT = (Path(__file__).parents[2] / "docs" / "models.md").read_text(encoding="utf-8")
SECTION = re.compile(
    r"^## .*?`(\[\[?)([a-z_.0-9]+)\]\]?`(?: `kind = \"(\w+)\"`)?\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL
)
"""A heading with a `[table]`, or with `[[table]]` for a list of them, and maybe a kind."""
ROW = re.compile(r"^\| `([a-z_.0-9]+)` \| ([^|]+) \| ([^|]+) \|$", re.M)


class Entry(NamedTuple):
    """One row of a table."""

    table: str
    key: str
    value: float
    source: str
    owner: Spec
    """The part of a default scenario that has the key."""


def entries() -> list[Entry]:
    found = []
    for brackets, table, kind, body in SECTION.findall(TEXT):
        tables, several = table.split("."), brackets == "[["
        item: Any = {"kind": kind} if kind else {}
        data = reduce(lambda inner, name: {name: inner}, reversed(tables), [item] if several else item)
        if tables[0] == "estimator":
            data["sensors"] = {name: {"enabled": True} for name in ("gyro", "imu", "wheel_speed")}
        part: Any = reduce(getattr, tables, resolve(data, "docs"))
        part = part[0] if several else part
        for key, value, source in ROW.findall(body):
            *inner, last = key.split(".")
            found.append(Entry(table, last, float(value), source.strip(), reduce(getattr, inner, part)))
    return found


def home(model: type[Any], key: str) -> str:
    """The class that first has the field: one entry there speaks for all that inherit it."""
    first = next(base for base in reversed(model.__mro__) if key in getattr(base, "model_fields", {}))
    return f"{first.__name__}.{key}"


def estimates(model: type[Spec]) -> set[str]:
    """Every number below `model` that calls itself an estimate."""
    found = set()
    for key, field in model.model_fields.items():
        for part in members(field.annotation).values():
            found |= estimates(part)
        number = isinstance(field.default, int | float) and not isinstance(field.default, bool)
        ours = model.__module__.startswith("agrobot_mj.")  # not a plugin that another test has registered
        if ours and number and "stimate" in model.describe(key):
            found.add(home(model, key))
    return found


@pytest.mark.parametrize("entry", entries(), ids=lambda entry: f"{entry.table}.{entry.key}")
def test_the_value_is_the_default(entry: Entry):
    assert getattr(entry.owner, entry.key) == pytest.approx(entry.value)
    assert entry.source


def test_every_estimate_has_a_row():
    written = {home(type(entry.owner), entry.key) for entry in entries()}
    assert not estimates(Scenario) - written
