"""Writing rules of CONTRIBUTING.md that can be checked: banned constructions, and names of functions and tests."""

import ast
import re
from pathlib import Path

import pytest
from test_architecture import parsed

ROOT = Path(__file__).parents[1]
BANNED = {
    "start with the noun or verb": r"\s*(Of\b|Likewise\b|The same\b|What (is|it|the|a|an)\b|\[)",
    "name the quantity": r"\b(so many|such a one|that which|what is what)\b",
    "use standard terms": r"\b(of late|on end|from which on|likewise|learnt|sought|heard|told|lest|thereof|anew)\b",
    "write 'in both directions' or 'on both sides'": r"\beither way\b",
    "write 'per'": r"\b(one|nodes|rows?|panels?|curves?|PNG|samples|cycles|calls?) an? [a-z]+\b",
}
"""Constructions that docstrings of the package and the scripts must not contain, each with advice."""
LONGEST_NAME = 70  # Maximum number of characters of a test name
PARTICIPLE = r"^def (_?(?!embed\b|need\b|speed\b)[a-z]+ed)\("
"""Pattern of the definition of a module-level function whose name is a single past participle."""
CONVENTIONAL = {"agrobot_mj/core/kernels.py", "agrobot_mj/extensions/bench/rig/figures.py"}
"""Modules excluded from this rule: decorators of compiled kernels, and functions whose names become file names."""


def statements(node):
    """Yield every statement below a node."""
    for name in ("body", "handlers", "orelse", "finalbody", "cases"):
        for inner in getattr(node, name, ()):
            yield inner
            yield from statements(inner)


def docstrings(module):
    """Yield line and text of every docstring: of modules, classes, functions, attributes and constants."""
    for node in statements(module):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


def found_in(text):
    """Return the advice on the first banned construction in a text, or "" if the text contains none."""
    for advice, pattern in BANNED.items():
        if (re.match if advice.startswith("start") else re.search)(pattern, re.sub("`[^`]*`", "", text)):
            return advice
    return ""


def test_docstrings_contain_no_banned_construction():
    assert [
        f"{file.relative_to(ROOT)}:{line}: {advice}"
        for folder in ("agrobot_mj", "scripts")
        for file in sorted((ROOT / folder).rglob("*.py"))
        for line, text in docstrings(parsed(file))
        if (advice := found_in(text))
    ] == []


def test_function_names_are_not_single_participles():
    assert [
        f"{file.relative_to(ROOT)}: {name}"
        for file in sorted((ROOT / "agrobot_mj").rglob("*.py"))
        if file.relative_to(ROOT).as_posix() not in CONVENTIONAL
        for name in re.findall(PARTICIPLE, file.read_text(encoding="utf-8"), re.M)
    ] == []


def test_names_of_tests_have_at_most_70_characters():
    assert [
        f"{file.relative_to(ROOT)}: {name}"
        for file in sorted((ROOT / "tests").rglob("test_*.py"))
        for name in re.findall(r"^ *def (test_\w+)", file.read_text(encoding="utf-8"), re.M)
        if len(name) > LONGEST_NAME
    ] == []


@pytest.mark.parametrize("text", ["Of R [m].", "Likewise across [m].", "What the host sends.", "[m].", "Rows so many."])
def test_banned_constructions_are_recognised(text):
    (_, read), *_ = docstrings(ast.parse(f'class Part:\n    width: float\n    """{text}"""\n'))
    assert found_in(read)


@pytest.mark.parametrize("text", ["Offset of R [m].", "Height of R [m].", "Whether the wheel is driven."])
def test_plain_docstrings_are_accepted(text):
    assert found_in(text) == ""
