"""Each of the paper's equations stands once in the code, and docs/equations.md says where."""

import ast
import re
from pathlib import Path

import pytest

import agrobot_mj

PACKAGE = Path(agrobot_mj.__file__).parent
TABLE = PACKAGE.parent / "docs" / "equations.md"
TAG = re.compile(r"# \[agrobots: ([A-Za-z0-9_]+)\]")
ROW = re.compile(r"^\| `([A-Za-z0-9_]+)` \| ([^|]+) \| `([A-Za-z0-9_.]+)` \|$")


def functions(tree, prefix=""):
    """(first line, last line, qualified name) of every function, inner ones after the outer."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            name = f"{prefix}{node.name}"
            if isinstance(node, ast.FunctionDef):
                yield node.lineno, node.end_lineno, name
            yield from functions(node, f"{name}.")


def tags_of(file):
    """(tag, module.function) of every tag in a file."""
    text = file.read_text(encoding="utf-8")
    module = ".".join(file.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")
    places = list(functions(ast.parse(text)))
    for number, line in enumerate(text.splitlines(), start=1):
        for tag in TAG.findall(line):
            inside = [name for first, last, name in places if first <= number <= last]
            yield tag, f"{module}.{inside[-1]}" if inside else module


def in_code():
    return [found for file in sorted(PACKAGE.rglob("*.py")) for found in tags_of(file)]


def in_table():
    return [match.groups() for match in map(ROW.match, TABLE.read_text(encoding="utf-8").splitlines()) if match]


def test_every_tag_stands_exactly_once():
    tags = [tag for tag, _ in in_code()]
    assert sorted(tags) == sorted(set(tags))
    assert len(tags) >= 15


def test_every_tag_is_the_comment_of_a_line_of_code():
    for file in PACKAGE.rglob("*.py"):
        for line in file.read_text(encoding="utf-8").splitlines():
            if "agrobots:" in line:
                assert TAG.search(line), f"{file.name}: {line.strip()}"
                assert line.split("#")[0].strip(), f"{file.name}: {line.strip()}"


def test_the_table_lists_every_tag_where_it_stands():
    assert {tag: place for tag, _, place in in_table()} == dict(in_code())


def test_the_table_lists_no_tag_twice_and_describes_each():
    rows = in_table()
    assert len({tag for tag, _, _ in rows}) == len(rows)
    assert all(len(what.split()) >= 3 for _, what, _ in rows)


@pytest.mark.parametrize(
    "label", ["sondenklem", "kinematicmodeltractor2", "lateralforces", "inversekinematicmodeltractor2", "eq19", "q_q"]
)
def test_the_equations_that_the_design_names_are_there(label):
    assert label in dict(in_code())
