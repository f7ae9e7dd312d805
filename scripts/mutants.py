"""Small changes of the source that a test should notice: where they are possible, and the text with one of them.

Changes are made inside functions and lambdas, where the behaviour is: an operator, a sign, a condition, a number, a
function or a name exchanged for its opposite, two arguments exchanged, a statement dropped. Left out are annotations,
defaults of keys (docs/models.md is checked against them), texts, messages of errors, and comparisons that differ only
where both sides are equal. Libraries of mutants (cosmic-ray, mutmut) change operators and numbers alone; what went
unnoticed here by experience are exchanged columns, sides, axes and functions, and so the operators are of our own.
"""

import ast
from collections.abc import Iterator
from typing import NamedTuple

BINARY = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*", ast.FloorDiv: "*", ast.Mod: "*"}
COMPARED = {
    **{ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "=="},
    **{ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in"},
}
OPPOSITES = {
    **{"min": "max", "sin": "cos", "left": "right", "front": "rear", "x": "y", "roll": "pitch", "upper": "lower"},
    **{"speed": "lateral_speed", "vx": "vy", "l_f": "l_r", "C_f": "C_r", "A11": "A22", "A12": "A21", "B1": "B2"},
    **{"searchsorted_left": "searchsorted_right", "steer": "pedal", "steer_voltage": "pedal_voltage", "yaw": "roll"},
    **{
        "longitudinal": "lateral",
        "gain_left": "gain_right",
        "fl": "fr",
        "rl": "rr",
        "rear_x": "rear_y",
        "east": "north",
    },
    **{"degrees": "radians", "tan": "sin", "ahead": "left", "area": "length", "width": "radius"},
}
NAMES = {**{b: a for a, b in OPPOSITES.items()}, **OPPOSITES}
"""Names, and attributes, and what they are exchanged for."""
TRANSPARENT = {"abs", "sqrt", "hypot", "wrap", "radians", "degrees"}
"""Functions of which the call is dropped, so that the first argument is left."""
DEGREES = "57.29577951308232"


class Mutant(NamedTuple):
    """A change of one place of a file."""

    line: int
    """Line of the place, from 1."""
    span: tuple[int, int]
    """First byte of the place in the file, and the one behind its last."""
    text: str
    """Text that goes there."""
    before: str
    """Text that was there."""


def mutants(source: str) -> list[Mutant]:
    """All changes of a file, in the order of its lines."""
    found = {mutant for mutant in _Finder(source).walk() if mutant.text != mutant.before}
    return sorted(found)


def changed(source: str, mutant: Mutant) -> str:
    """The file with the change."""
    data, (start, end) = source.encode(), mutant.span
    return (data[:start] + mutant.text.encode() + data[end:]).decode()


class _Finder:
    """Walks over a file."""

    def __init__(self, source: str) -> None:
        self.data = source.encode()
        starts = [0]
        for line in self.data.splitlines(keepends=True):
            starts.append(starts[-1] + len(line))
        self.starts, self.tree = starts, ast.parse(source)
        self.lambdas: list[ast.Lambda] = []

    def walk(self) -> Iterator[Mutant]:
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef):
                for statement in node.body:
                    yield from self.inside(statement)
            elif isinstance(node, ast.Lambda):
                self.lambdas.append(node)
                yield from self.inside(node.body)
        for one, other in zip(self.lambdas, self.lambdas[1:] + self.lambdas[:1], strict=True):
            yield self.put(one.body, self.text(other.body))
            yield self.put(one.body, f"-({self.text(one.body)})")
            yield self.put(one.body, f"{DEGREES} * ({self.text(one.body)})")

    def inside(self, node: ast.AST) -> Iterator[Mutant]:
        """Changes in a statement or an expression, and in what it holds."""
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef | ast.ClassDef | ast.Assert):
            return
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                yield from self.inside(node.value)
            return
        yield from self.at(node)
        for child in ast.iter_child_nodes(node):
            yield from self.inside(child)

    def at(self, node: ast.AST) -> Iterator[Mutant]:
        """Changes of the node itself."""
        match node:
            case ast.BinOp(left, op, right) if type(op) in BINARY:
                yield self.between(left, right, BINARY[type(op)])
            case ast.AugAssign(target, op, value) if type(op) in BINARY:
                yield self.between(target, value, f"{BINARY[type(op)]}=")
                yield self.put(node, "pass")
            case ast.UnaryOp(ast.USub() | ast.Not(), operand):
                yield self.put(node, f"({self.text(operand)})")
            case ast.Compare(left, [op], [right]):
                yield self.between(left, right, COMPARED[type(op)])
            case ast.BoolOp(op, [first, second, *_]):
                yield self.between(first, second, "or" if isinstance(op, ast.And) else "and")
            case ast.If(test) | ast.IfExp(test) if not isinstance(test, ast.Compare | ast.UnaryOp):
                yield self.put(test, f"(not ({self.text(test)}))")
            case ast.Constant(bool() as value):
                yield self.put(node, str(not value))
            case ast.Constant(int() as value):
                yield self.put(node, str(value + 1))
            case ast.Constant(float() as value):
                yield self.put(node, str(2.0 * value if value else 1.0))
            case ast.Call():
                yield from self.call(node)
            case ast.Expr(ast.Call()):
                yield self.put(node, "pass")
            case ast.Assign([ast.Subscript() | ast.Attribute()], _):
                yield self.put(node, "pass")
            case ast.Name(name, ast.Load()) if name in NAMES and name not in ("x", "y"):
                yield self.put(node, NAMES[name])
            case ast.Attribute(_, name, ast.Load()) if name in NAMES:
                _, end = self.span(node)
                yield self.make(node, (end - len(name), end), NAMES[name])
            case ast.Tuple([first, second, *_], ast.Load()) if self.text(first) != self.text(second):
                yield self.exchange(first, second)

    def call(self, node: ast.Call) -> Iterator[Mutant]:
        """Exchange the first two arguments, or drop the call."""
        name = self.text(node.func).rpartition(".")[2]
        if not node.args or isinstance(node.args[0], ast.Starred):
            return
        if name in TRANSPARENT:
            yield self.put(node, f"({self.text(node.args[0])})")
        symmetric = {"min", "max", "hypot"}
        if len(node.args) >= 2 and name not in symmetric:
            yield self.exchange(*node.args[:2])

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Bytes of the file between which a node stands."""
        n: ast.expr = node  # type: ignore[assignment]
        assert n.end_lineno is not None
        assert n.end_col_offset is not None
        return self.starts[n.lineno - 1] + n.col_offset, self.starts[n.end_lineno - 1] + n.end_col_offset

    def text(self, node: ast.AST) -> str:
        return self.data[slice(*self.span(node))].decode()

    def make(self, node: ast.AST, span: tuple[int, int], text: str) -> Mutant:
        line = self.data[: span[0]].count(b"\n") + 1
        return Mutant(line, span, text, self.data[slice(*span)].decode())

    def put(self, node: ast.AST, text: str) -> Mutant:
        return self.make(node, self.span(node), text)

    def between(self, left: ast.AST, right: ast.AST, sign: str) -> Mutant:
        """Another operator between two operands; brackets about them stay."""
        span = self.span(left)[1], self.span(right)[0]
        gap = self.data[slice(*span)].decode()
        after, before = len(gap) - len(gap.lstrip(" )\n")), len(gap) - len(gap.rstrip(" (\n"))
        return self.make(left, (span[0] + after, span[1] - before), sign)

    def exchange(self, first: ast.AST, second: ast.AST) -> Mutant:
        """Two neighbours exchanged."""
        a, b = self.span(first), self.span(second)
        gap = self.data[a[1] : b[0]].decode()
        return self.make(first, (a[0], b[1]), f"{self.text(second)}{gap}{self.text(first)}")
