"""The condition at which a run counts as failed: comparisons of metrics and outcome, joined by and, or, not.

    lateral_rms > 0.3 or outcome != completed
    not (xte_abs_p95 < 0.1 and 0 <= steer_saturated_fraction < 0.5)

The text is read by Python's own parser and accepted only if it consists of these forms; nothing of it is executed.
"""

import ast
import operator
import warnings
from collections.abc import Callable, Collection, Mapping
from typing import Any, NoReturn, get_args

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.signals import Outcome
from agrobot_mj.metrics.success import is_error, succeeded, without_errors
from agrobot_mj.studies.sweep.tasks import ERROR

COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
OUTCOMES = (*get_args(Outcome), ERROR)
"""Words that `outcome` is compared with."""
EXAMPLE = '"lateral_rms > 0.3 or outcome != completed"'
LONGEST = 1000
"""Characters of a condition; a longer one is no question that a person asks."""


class Condition:
    """A condition on the numbers of a run. Raises `ScenarioError` if the text is not one."""

    def __init__(self, text: str, metrics: Collection[str]) -> None:
        """`metrics` are the names that it may use, beside `outcome`."""
        self.text, self.metrics = text, metrics
        if len(text) > LONGEST:
            self._refuse(f"has more than {LONGEST} characters")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # of Python's parser, on numbers that run into words
                self._tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            self._refuse("cannot be read")
        self._check(self._tree)

    @property
    def names_outcome(self) -> bool:
        """Whether it says itself which outcomes fail."""
        return "outcome" in self._names

    @property
    def names_error(self) -> bool:
        """Whether it compares a tracking error."""
        return any(is_error(name) for name in self._names)

    @property
    def compared(self) -> list[str]:
        """Names of the metrics that it compares."""
        return sorted(self._names & set(self.metrics))

    def fails(self, numbers: Mapping[str, Any]) -> bool:
        """Whether a run fails: it raised, meets the condition, or ends otherwise than expected if that says nothing.

        The errors of a run that failed or did not complete do not count, and a metric without a value meets it.
        """
        unexpected = not self.names_outcome and not succeeded(numbers)
        return numbers["outcome"] == ERROR or unexpected or self.met(without_errors(numbers))

    def met(self, numbers: Mapping[str, Any]) -> bool:
        """Whether the condition is met by a run; also if a metric that it compares has no value."""
        try:
            return self._holds(self._tree, numbers)
        except KeyError:
            return True

    @property
    def _names(self) -> set[str]:
        """Names that stand in it, of metrics, outcomes and `outcome`."""
        nodes = (node for node in ast.walk(self._tree) if isinstance(node, ast.Name | ast.Attribute))
        return {name for node in nodes if (name := _name(node))}

    def _check(self, node: ast.expr) -> None:
        if isinstance(node, ast.BoolOp):
            for value in node.values:
                self._check(value)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self._check(node.operand)
        elif isinstance(node, ast.Compare) and all(type(op) in COMPARISONS for op in node.ops):
            self._check_comparison([node.left, *node.comparators], node.ops)
        else:
            self._refuse(f"{ast.unparse(node)!r} is not a comparison")

    def _check_comparison(self, terms: list[ast.expr], operators: list[ast.cmpop]) -> None:
        kinds = [self._kind(term) for term in terms]
        if kinds[0] in ("outcome", "word"):
            equality = all(isinstance(op, ast.Eq | ast.NotEq) for op in operators)
            if sorted(kinds) != ["outcome", "word"] or not equality:
                self._refuse("compare outcome with one word, by == or !=")
        elif not set(kinds) <= {"metric", "number"}:
            self._refuse("compare metrics with numbers or with each other")
        elif "metric" not in kinds:
            self._refuse("compares no metric")

    def _kind(self, term: ast.expr) -> str:
        """What stands on a side of a comparison: "outcome", "word", "metric" or "number"."""
        if isinstance(term, ast.UnaryOp) and isinstance(term.op, ast.USub | ast.UAdd):
            return self._number(term.operand)
        if isinstance(term, ast.Constant):
            if isinstance(term.value, str):
                return self._known(term.value)
            return self._number(term)
        name = _name(term)
        if name is None:
            self._refuse(f"{ast.unparse(term)!r} is neither a metric nor a number")
        return self._known(name)

    def _number(self, term: ast.expr) -> str:
        if not isinstance(term, ast.Constant) or type(term.value) not in (int, float):
            self._refuse(f"{ast.unparse(term)!r} is not a number")
        return "number"

    def _known(self, name: str) -> str:
        if name == "outcome":
            return "outcome"
        if name in OUTCOMES:
            return "word"
        if name not in self.metrics:
            known = sorted(self.metrics)
            hint, outcomes = suggestion(name, [*known, *OUTCOMES]), ", ".join(OUTCOMES)
            self._refuse(
                f"there is no metric {name!r}{hint} (known: outcome, {', '.join(known)}; outcomes: {outcomes})"
            )
        return "metric"

    def _refuse(self, why: str) -> NoReturn:
        shown = self.text if len(self.text) <= LONGEST else f"{self.text[:60]}..."
        raise ScenarioError(f"--until {shown!r}: {why}; write comparisons of metrics and outcome, as in {EXAMPLE}")

    def _holds(self, node: ast.expr, numbers: Mapping[str, Any]) -> bool:
        if isinstance(node, ast.BoolOp):
            # All are looked at: a value that is missing anywhere counts, whatever the order.
            found = [self._holds(value, numbers) for value in node.values]
            return all(found) if isinstance(node.op, ast.And) else any(found)
        if isinstance(node, ast.UnaryOp):
            return not self._holds(node.operand, numbers)
        if not isinstance(node, ast.Compare):
            raise TypeError(ast.unparse(node))  # none is left: the condition was checked when it was read
        values = [self._value(term, numbers) for term in (node.left, *node.comparators)]
        pairs = zip(node.ops, values, values[1:], strict=False)
        return all(COMPARISONS[type(op)](left, right) for op, left, right in pairs)

    def _value(self, term: ast.expr, numbers: Mapping[str, Any]) -> Any:
        """The value of a side; raises KeyError where a metric has none."""
        if isinstance(term, ast.UnaryOp) and isinstance(term.operand, ast.Constant):
            value: Any = term.operand.value
            return -value if isinstance(term.op, ast.USub) else value
        name = term.value if isinstance(term, ast.Constant) else _name(term)
        if not isinstance(name, str) or name in OUTCOMES:
            return name
        if numbers.get(name) is None:
            raise KeyError(name)
        return numbers[name]


def _name(term: ast.expr) -> str | None:
    """A name, dotted for metrics inside others; None if it is something else."""
    if isinstance(term, ast.Name):
        return term.id
    if isinstance(term, ast.Attribute):
        inner = _name(term.value)
        return None if inner is None else f"{inner}.{term.attr}"
    return None
