"""Conditions for failed runs: comparisons of metrics and outcome, joined by and, or, not.

    lateral_rms > 0.3 or outcome != completed
    not (xte_abs_p95 < 0.1 and 0 <= steer_saturated_fraction < 0.5)

Python's parser parses the text. Only these forms are accepted, and the text is never executed.
"""

import ast
import operator
import warnings
from collections.abc import Callable, Collection, Mapping
from itertools import pairwise
from typing import Any, NoReturn, get_args

from agrobot_mj.core.errors import PLUGIN, ScenarioError, suggestion
from agrobot_mj.core.signals import Outcome
from agrobot_mj.metrics.success import is_error, is_success, without_errors
from agrobot_mj.studies.engine.tasks import ERROR

COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
OUTCOMES = (*get_args(Outcome), ERROR)  # Values of `outcome` that a condition may contain
EXAMPLE = '"lateral_rms > 0.3 or outcome != completed"'
LONGEST = 1000  # Maximum length of a condition [characters]
LARGEST = 1e100  # Maximum magnitude of a number in a condition
Numbers = Mapping[str, Any]


class Condition:
    """Failure condition on the metrics of a run. Raises `ScenarioError` for an invalid text."""

    def __init__(self, text: str, metrics: Collection[str] | None = None) -> None:
        """Parse the condition `text`. Only the metric names `metrics` are accepted, or by default all names."""
        self.text, self.metrics, self._names = text, metrics, set[str]()
        if len(text) > LONGEST:
            self._refuse(f"the text has more than {LONGEST} characters")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # warnings of the parser, such as for numbers followed by letters
                tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            self._refuse("the condition cannot be parsed")
        self._holds = self._read(tree)

    @property
    def names_outcome(self) -> bool:
        """Whether the condition contains the outcome of a run."""
        return "outcome" in self._names

    @property
    def names_error(self) -> bool:
        """Whether the condition contains a metric of the tracking error."""
        return any(is_error(name) for name in self._names)

    @property
    def compared(self) -> list[str]:
        """Names of the metrics in the condition."""
        return sorted(self._names - {"outcome"})

    def fails(self, numbers: Numbers) -> bool:
        """Return whether a run fails: it raised an error, meets the condition, or ended unexpectedly.

        Unexpected outcomes are ignored if the condition contains the outcome. A missing metric meets the condition.
        Tracking errors of failed or incomplete runs are missing.
        """
        unexpected = not self.names_outcome and not is_success(numbers)
        return numbers["outcome"] == ERROR or unexpected or self.is_met(without_errors(numbers))

    def is_met(self, numbers: Numbers) -> bool:
        """Return whether a run meets the condition, or lacks a metric of the condition."""
        try:
            return self._holds(numbers)
        except KeyError:
            return True

    def _read(self, node: ast.expr) -> Callable[[Numbers], bool]:
        """Return a function that evaluates a syntax-tree node for the metrics of a run. The function raises KeyError
        for a missing metric."""
        if isinstance(node, ast.BoolOp):
            joined, parts = all if isinstance(node.op, ast.And) else any, [self._read(value) for value in node.values]
            # All parts are evaluated, so that a missing metric is found in any order.
            return lambda numbers: joined([part(numbers) for part in parts])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            inner = self._read(node.operand)
            return lambda numbers: not inner(numbers)
        if not (isinstance(node, ast.Compare) and all(type(op) in COMPARISONS for op in node.ops)):
            self._refuse(f"{ast.unparse(node)!r} is not a comparison")
        return self._comparison([node.left, *node.comparators], [type(op) for op in node.ops])

    def _comparison(self, terms: list[ast.expr], operators: list[type[ast.cmpop]]) -> Callable[[Numbers], bool]:
        sides = [self._side(term) for term in terms]
        kinds = [kind for kind, _ in sides]
        if kinds[0] in ("outcome", "word"):
            if sorted(kinds) != ["outcome", "word"] or not set(operators) <= {ast.Eq, ast.NotEq}:
                self._refuse("compare outcome with one word, using == or !=")
        elif not set(kinds) <= {"metric", "number"}:
            self._refuse("compare metrics with numbers or with each other")
        elif "metric" not in kinds:
            self._refuse("the condition does not compare a metric")

        def holds(numbers: Numbers) -> bool:
            pairs = pairwise([value(numbers) for _, value in sides])
            return all(COMPARISONS[op](*pair) for op, pair in zip(operators, pairs, strict=True))

        return holds

    def _side(self, term: ast.expr) -> tuple[str, Callable[[Numbers], Any]]:
        """Return the type of one side of a comparison ("outcome", "word", "metric" or "number"), and a function that
        returns its value for the metrics of a run."""
        signed = isinstance(term, ast.UnaryOp) and isinstance(term.op, ast.USub | ast.UAdd)
        inner = term.operand if isinstance(term, ast.UnaryOp) and signed else term
        if isinstance(inner, ast.Constant) and type(inner.value) in (int, float):
            number = ast.literal_eval(term)
            if not abs(number) <= LARGEST:
                self._refuse(f"{ast.unparse(term)[:20]!r} is too large a number")
            return "number", lambda numbers: number
        word = inner.value if isinstance(inner, ast.Constant) and isinstance(inner.value, str) else name_of(inner)
        if signed or (word is None and isinstance(inner, ast.Constant)):
            self._refuse(f"{ast.unparse(inner)!r} is not a number")
        if word is None:
            self._refuse(f"{ast.unparse(inner)!r} is neither a metric nor a number")
        if word in OUTCOMES:
            return "word", lambda numbers: word
        if word != "outcome" and self.metrics is not None and word not in self.metrics:
            known = sorted(self.metrics)
            hint, outcomes = suggestion(word, [*known, *OUTCOMES]), ", ".join(OUTCOMES)
            names = f"known: outcome, {', '.join(known)}; outcomes: {outcomes}"
            self._refuse(f"there is no metric {word!r}{hint} ({names}); {PLUGIN.replace('kind', 'metric')}")
        self._names.add(word)
        return "outcome" if word == "outcome" else "metric", lambda numbers: _present(numbers, word)

    def _refuse(self, why: str) -> NoReturn:
        shown = self.text if len(self.text) <= LONGEST else f"{self.text[:60]}..."
        raise ScenarioError(f"--until {shown!r}: {why}; specify comparisons of metrics and outcome, e.g. {EXAMPLE}")


def _present(numbers: Numbers, name: str) -> Any:
    if numbers.get(name) is None:
        raise KeyError(name)
    return numbers[name]


def name_of(term: ast.expr) -> str | None:
    """Return the metric name in a term of a condition, with dots for nested metrics, or None for a term that is not a
    name."""
    if isinstance(term, ast.Name):
        return term.id
    if isinstance(term, ast.Attribute):
        inner = name_of(term.value)
        return None if inner is None else f"{inner}.{term.attr}"
    return None
