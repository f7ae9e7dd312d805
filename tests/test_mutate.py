"""The plan of the mutation test names modules, tests and lines that exist; `make mutate` runs it."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLAN = tomllib.loads((ROOT / "tests" / "mutants.toml").read_text(encoding="utf-8"))


def test_the_plan_names_existing_code():
    groups = PLAN["group"].values()
    places = [(module, tests) for group in groups for module, tests in group.items() if module != "count"]
    places += [(entry["module"], entry["tests"]) for entry in PLAN["named"]]
    assert len(places) > 30
    for modules, tests in places:
        for module in modules.split():
            assert (ROOT / "agrobot_mj" / module).is_file(), module
        for test in tests.split():
            file, _, name = test.partition("::")
            assert (ROOT / "tests" / file).exists(), test
            assert not name or f"def {name}(" in (ROOT / "tests" / file).read_text(encoding="utf-8"), test


def test_the_code_that_named_changes_replace_occurs_once():
    for entry in PLAN["named"]:
        source = (ROOT / "agrobot_mj" / entry["module"]).read_text(encoding="utf-8")
        assert source.count(entry["before"]) == 1, entry["what"]
