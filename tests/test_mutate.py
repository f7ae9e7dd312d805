"""The mutation test changes what it says, and its plan names modules and tests that exist; `make mutate` runs it."""

import importlib
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).parents[1]
PLAN = tomllib.loads((ROOT / "scripts" / "mutants.toml").read_text(encoding="utf-8"))
SOURCE = '''def law(x: float, gain: float = 2.0) -> float:
    """Doc: 1 + 1."""
    if x > 0 and gain > 1:
        raise ValueError("x - 1")
    return min(gain * x, -state.left, hypot(x, 3.0))
'''


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module("mutants")


@pytest.fixture
def fates(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module("fates")


def test_each_mutant_differs_in_one_place_and_can_be_read(tool):
    found = tool.mutants(SOURCE)
    for mutant in found:
        text = tool.changed(SOURCE, mutant)
        assert text != SOURCE
        compile(text, "law.py", "exec")
    texts = {(mutant.before, mutant.text) for mutant in found}
    assert texts >= {("*", "/"), (">", "<="), ("and", "or"), ("min", "max"), ("left", "right"), ("3.0", "6.0")}
    assert ("-state.left", "(state.left)") in texts
    assert ("hypot(x, 3.0)", "(x)") in texts


def test_starred_arguments_and_brackets_on_the_next_line_leave_mutants_that_can_be_read(tool):
    source = "def far(d, a, b):\n    return hypot(*d) + (\n  (\n  a\n  )\n  - (\n  b)\n  )\n"
    found = tool.mutants(source)
    assert {(mutant.before, mutant.text) for mutant in found} >= {("+", "-"), ("-", "+")}
    for mutant in found:
        compile(tool.changed(source, mutant), "far.py", "exec")


def test_defaults_texts_and_messages_are_left_alone(tool):
    lines = {mutant.line for mutant in tool.mutants(SOURCE)}
    assert lines == {3, 5}


def test_a_column_may_take_the_source_of_its_neighbour(tool):
    source = "ROWS = (('a', lambda k: k.truth.z), ('b', lambda k: k.truth.t))\n"
    texts = {mutant.text for mutant in tool.mutants(source)}
    assert {"k.truth.t", "k.truth.z", "-(k.truth.z)"} <= texts


def test_the_plan_names_what_there_is():
    places = [
        (module, tests) for group in PLAN["group"].values() for module, tests in group.items() if module != "count"
    ]
    places += [(entry["module"], entry["tests"]) for entry in PLAN["named"]]
    assert len(places) > 30
    for modules, tests in places:
        for module in modules.split():
            assert (ROOT / "agrobot_mj" / module).is_file(), module
        for test in tests.split():
            file, _, name = test.partition("::")
            assert (ROOT / "tests" / file).exists(), test
            assert not name or f"def {name}(" in (ROOT / "tests" / file).read_text(encoding="utf-8"), test


def fate(fates, program, **names):
    """What is written down of a test that ends in the exception of a program."""
    try:
        exec(program, names)
    except Exception as error:
        return fates.fate_of("test_it", error)
    raise AssertionError(program)


def test_a_name_that_does_not_exist_is_no_reason_to_count_a_mutant_as_killed(fates, tool):
    mutant = tool.Mutant(1, (0, 4), "right", "left")
    state = SimpleNamespace(left=1.0)
    wrapped = "try:\n    state.right\nexcept Exception as error:\n    raise ValueError('a run') from error"
    for program in ("right", "state.right", wrapped):
        assert fates.brings_in_an_absent_name(mutant, fate(fates, program, state=state))
    for program in ("assert state.left < 0", "1 / 0", "state.rear", "rear"):
        assert not fates.brings_in_an_absent_name(mutant, fate(fates, program, state=state))
    assert fate(fates, "assert state.left < 0", state=state).how == "AssertionError"
    assert fate(fates, "1 / 0").how == "ZeroDivisionError"


def test_those_that_do_not_count_are_in_no_number_of_the_table(fates):
    about = {"group": "tyres", "seed": 1, "module": "tyres/patch.py", "line": 1, "before": "+", "text": "-"}
    ends = (("a", "AssertionError"), ("b", "ValueError"), ("c", fates.TIME), ("", ""))
    rows = [{**about, "killed": killed, "how": how, "absent": False} for killed, how in ends]
    rows.append({**about, "killed": "d", "how": "NameError", "absent": True})
    assert "| tyres | 1 | 4 | 3 | 1 | 1 | 1 |" in fates.table(rows).splitlines()
    assert "| tyres/patch.py:1 | `+` becomes `-` |" in fates.table(rows).splitlines()
