"""Plan of the mutation test: all its modules, tests and lines exist. `make mutate` runs the test."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLAN = tomllib.loads((ROOT / "tests" / "mutants.toml").read_text(encoding="utf-8"))


def removed(path):
    """Return whether a module or test belongs to a removed extension."""
    parts = Path(path).parts
    return parts[0] == "extensions" and not (ROOT / "agrobot_mj" / "extensions" / parts[1]).is_dir()


NAMED = [entry for entry in PLAN["named"] if not removed(entry["module"])]


def test_mutation_plan_names_existing_modules_and_tests():
    groups = PLAN["group"].values()
    places = [(module, tests) for group in groups for module, tests in group.items() if module != "count"]
    places += [(entry["module"], entry["tests"]) for entry in NAMED]
    assert len(places) > 30
    for modules, tests in places:
        for module in modules.split():
            assert removed(module) or (ROOT / "agrobot_mj" / module).is_file(), module
        for test in tests.split():
            file, _, name = test.partition("::")
            assert removed(file) or (ROOT / "tests" / file).exists(), test
            assert not name or removed(file) or f"def {name}(" in (ROOT / "tests" / file).read_text("utf-8"), test


def test_code_replaced_by_a_named_mutation_occurs_exactly_once():
    for entry in NAMED:
        source = (ROOT / "agrobot_mj" / entry["module"]).read_text(encoding="utf-8")
        assert source.count(entry["before"]) == 1, entry["what"]
