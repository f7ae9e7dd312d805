"""Without matplotlib, the extra `figures`, studies leave their figures out and say so; nothing else is missing."""

import ast
import sys
from functools import cache
from pathlib import Path

import pytest

import agrobot_mj
from agrobot_mj import load_scenario
from agrobot_mj.studies import drawing
from agrobot_mj.studies.compare import compare
from agrobot_mj.studies.compare_plan import plan
from agrobot_mj.studies.rig import rig_command

PACKAGE = Path(agrobot_mj.__file__).parent


@pytest.fixture
def bare(monkeypatch):
    """An environment without matplotlib."""
    drawing.can_draw.cache_clear()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    yield
    drawing.can_draw.cache_clear()


def test_a_comparison_is_complete_but_for_its_figures(bare, tmp_path, capsys):
    scenario = load_scenario("circle", {"duration_s": 0.5})
    todo, _ = plan(scenario, ["pd"], plants=["bicycle"], seeds=2)
    rows = compare(todo, tmp_path, rrd=False, jobs=1)
    assert [row["outcome"] for row in rows] == ["completed"] * len(todo)
    assert (tmp_path / "comparison.json").is_file()
    assert list(tmp_path.glob("*.png")) == []
    assert capsys.readouterr().err == drawing.ADVICE + "\n"
    assert "pip install 'agrobot-mj[figures]'" in drawing.ADVICE


def test_the_word_is_said_once(bare, tmp_path, capsys):
    assert not drawing.can_draw()
    assert rig_command("linear", tmp_path) == [tmp_path / "curves.parquet"]
    assert capsys.readouterr().err == drawing.ADVICE + "\n"


def test_with_matplotlib_nothing_is_said(tmp_path, capsys):
    drawing.can_draw.cache_clear()
    assert drawing.can_draw()
    assert capsys.readouterr().err == ""


@cache
def at_the_top(module):
    """Names of the modules that a module imports when it is imported itself."""
    path = PACKAGE.parent.joinpath(*module.split("."))
    file = path.with_suffix(".py") if path.with_suffix(".py").is_file() else path / "__init__.py"
    if not file.is_file():
        return frozenset({module})
    found = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def everything_under(module):
    seen, todo = set(), {module}
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            todo |= at_the_top(name) if name.startswith("agrobot_mj") else set()
    return seen


def test_no_command_imports_matplotlib_before_it_draws():
    asking = [file for file in PACKAGE.rglob("*.py") if "import can_draw" in file.read_text(encoding="utf-8")]
    assert len(asking) >= 7
    for file in asking:
        module = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)
        assert not {name for name in everything_under(module) if name.split(".")[0] == "matplotlib"}, module
