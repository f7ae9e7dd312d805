"""Docstrings of attributes, read from the source when somebody asks.

pydantic can collect them while each class is made, which costs every run a quarter of a second; only `explain`,
`schema`, `init` and the docs look at them.
"""

import ast
import inspect
import sys
from collections.abc import Iterator
from functools import cache
from itertools import pairwise


@cache
def attribute_docstrings(owner: type) -> dict[str, str]:
    """Docstrings below the attributes of a class and of its bases, by attribute; empty if there is no source."""
    found: dict[str, str] = {}
    for base in reversed(owner.__mro__):
        found.update(_own(base))
    return found


def _own(owner: type) -> dict[str, str]:
    body: list[ast.stmt] = list(_statements(owner.__module__))
    for name in owner.__qualname__.replace("<locals>.", "").split("."):
        inside = next((node for node in _definitions(body) if node.name == name), None)
        body = inside.body if inside else []
    return {
        before.target.id: inspect.cleandoc(after.value.value)
        for before, after in pairwise(body)
        if isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name)
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
    }


def _definitions(body: list[ast.stmt]) -> Iterator[ast.ClassDef | ast.FunctionDef]:
    """Classes and functions of a block, those inside its branches included."""
    for statement in body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            yield statement
        else:
            yield from _definitions([node for node in ast.iter_child_nodes(statement) if isinstance(node, ast.stmt)])


@cache
def _statements(module: str) -> tuple[ast.stmt, ...]:
    try:
        return tuple(ast.parse(inspect.getsource(sys.modules[module])).body)
    except (KeyError, OSError, TypeError, SyntaxError):
        return ()
