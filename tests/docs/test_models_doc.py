"""docs/reference/models.md lists every assumed value of the code with its value and its range or source."""

from functools import cache
from pathlib import Path
from typing import Any

from make_reference import numbers_in, with_numbers
from removed import needs_all

from agrobot_mj.core.spec import Spec, members
from agrobot_mj.scenario.schema import Scenario

TEXT = (Path(__file__).parents[2] / "docs" / "reference" / "models.md").read_text(encoding="utf-8")


@cache
def numbers():
    """Return the numbers in all tables of the page."""
    return [number for table in numbers_in(TEXT).values() for number in table]


def home(model: type[Any], key: str) -> str:
    """Return `class.key` for the base class that defines the field. One table row applies to all derived classes."""
    first = next(base for base in reversed(model.__mro__) if key in getattr(base, "model_fields", {}))
    return f"{first.__name__}.{key}"


def assumed(model: type[Spec]) -> set[str]:
    """Return all keys below `model` whose default is an assumed value."""
    found = set()
    for key, field in model.model_fields.items():
        for part in members(field.annotation).values():
            found |= assumed(part)
        number = isinstance(field.default, int | float) and not isinstance(field.default, bool)
        ours = model.__module__.startswith("agrobot_mj.")  # not a plugin that another test has registered
        if ours and number and "ssumed value" in model.describe(key):
            found.add(home(model, key))
    return found


@needs_all
def test_parameter_tables_contain_the_values_of_the_code():
    assert with_numbers(TEXT) == TEXT, "run `make reference`"


def test_every_assumed_value_has_a_row_in_a_parameter_table():
    missing = assumed(Scenario) - {number.owner for number in numbers()}
    assert not missing, "mark a table on the page, as `<!-- numbers of [table] kind -->`, and run `make reference`"


def test_every_parameter_table_row_gives_a_range_or_a_source():
    assert [number.row[0] for number in numbers() if not number.row[3].strip(" .")] == []
