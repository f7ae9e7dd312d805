"""Docstrings stand by themselves: in a tooltip or in the output of `grep` nothing above completes them."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import agrobot_mj

PACKAGE = Path(agrobot_mj.__file__).parent
SCRIPTS = PACKAGE.parent / "scripts"
FRAGMENT = re.compile(r"\s*(Of\b|Likewise\b|The same\b|What befalls\b|\[)")
"""Beginnings of docstrings that complete another one or the name above them; a bracket begins with the unit."""
DISTRIBUTIVE = re.compile(r"\b(one|nodes|rows?|panels?|curves?|PNG|samples|cycles|calls?) an? [a-z]+\b")
"""The article for "per", as in "one PNG a figure"."""
ARCHAIC = re.compile(r"\b(befalls?|ails?|ailing|heeds?|heeded|lest|whence|thereof|hither|anew)\b", re.IGNORECASE)


def statements(node):
    """Every statement below `node`; expressions, most of a tree, have none in them."""
    for inner in ast.iter_child_nodes(node):
        if isinstance(inner, ast.stmt | ast.ExceptHandler | ast.match_case):
            yield inner
            yield from statements(inner)


def docstrings(tree):
    """Line and text of every docstring: of modules, classes and functions, and below attributes and constants."""
    for node in statements(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


@cache
def written():
    """Place and text of every docstring of the package and the scripts."""
    return [
        (f"{file.relative_to(PACKAGE.parent)}:{line}", text)
        for folder in (PACKAGE, SCRIPTS)
        for file in sorted(folder.rglob("*.py"))
        for line, text in docstrings(ast.parse(file.read_text(encoding="utf-8")))
    ]


def found(pattern, matches):
    """Every docstring in which the pattern matches, as `file:line: match`."""
    return [f"{place}: {match.group().strip()}" for place, text in written() if (match := matches(pattern, text))]


def test_no_docstring_is_a_fragment():
    assert found(FRAGMENT, re.Pattern.match) == []


def test_no_docstring_uses_the_article_for_per():
    assert found(DISTRIBUTIVE, re.Pattern.search) == []


def test_no_docstring_uses_archaic_words():
    assert found(ARCHAIC, re.Pattern.search) == []


@pytest.mark.parametrize(
    "text",
    ["Of R [m].", "Likewise across [m].", "The same to the left.", "What befalls the tractor.", "[m].", "\n    [m]."],
)
def test_fragments_are_recognised(text):
    (_, read), *_ = docstrings(ast.parse(f'class Part:\n    width: float\n    """{text}"""\n'))
    assert FRAGMENT.match(read)


@pytest.mark.parametrize(
    "text", ["Offset of R [m].", "Height of R [m].", "Often zero.", "Whether the wheel is driven."]
)
def test_complete_sentences_are_accepted(text):
    assert not FRAGMENT.match(text)
