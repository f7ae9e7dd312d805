"""The mutation test changes what it says, and its plan names modules and tests that exist; `make mutate` runs it."""

import importlib.util
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PLAN = tomllib.loads((ROOT / "scripts" / "mutants.toml").read_text(encoding="utf-8"))
SOURCE = '''def law(x: float, gain: float = 2.0) -> float:
    """Doc: 1 + 1."""
    if x > 0 and gain > 1:
        raise ValueError("x - 1")
    return min(gain * x, -state.left, hypot(x, 3.0))
'''


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("mutants_of_scripts", ROOT / "scripts" / "mutants.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
