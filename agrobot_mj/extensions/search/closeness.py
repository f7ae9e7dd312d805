"""Margin of a run to a failure condition at each tick, for searches that maximise the margin.

Each metric in the condition gets a value at each tick: its value at the end of the run if all later errors were 0. The
value of a maximum is the current magnitude. A root mean square or a percentile covers the complete planned duration.
The margin of a comparison with a number c is (value - c) / |c|, which is negative until the condition is met. `and`
takes the minimum of the margins, `or` the maximum, `not` the negative [Fainekos2009]. At a margin of about 0 the
condition is first met, but `Condition.fails` decides whether a run fails. The margin of a tick does not depend on later
ticks, because such a dependence would bias splitting.
"""

import ast
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappush, heappushpop
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.extensions.search.limit.condition import name_of
from agrobot_mj.extensions.search.limit.question import TRIAL_S
from agrobot_mj.metrics.base import RunView
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.outcomes import LOST_M
from agrobot_mj.simulation.run import run

SLOPE_TICKS = 5
"""Number of ticks over which the rate of change of the margin is computed [-]. Assumed value: a quarter of a second."""
SIGNALS: dict[str, Callable[[RunView], Array]] = {
    "xte_": lambda view: view.cg_on_path.offset,
    "safety.offset_": lambda view: view.cg_on_path.offset,
    "iso_12188_2_style.": lambda view: view.cg_on_path.offset,
    "implement_xte_": lambda view: view.beside_path("implement_x", "implement_y").offset,
    "lateral_": lambda view: view.column("e_lateral"),
    "longitudinal_": lambda view: view.column("e_longitudinal"),
    "yaw_rate_error_": lambda view: view.column("e_yaw_rate"),
    "hitch_angle_": lambda view: view.column("hitch_angle"),
}
"""Functions that return the signal from which a metric is computed, by the first part of the metric name."""


@dataclass(frozen=True)
class Closeness:
    """Function that returns the margin of a run to a failure condition at each tick."""

    until: str  # Failure condition as text, see `Condition`
    signal: str | None = None
    """Signal whose magnitude is the margin at each tick. Default: margin computed from the metrics in the condition."""

    def __call__(self, log: Log) -> Array:
        """Return the finite margin at each tick, shape (ticks,). Raises `ScenarioError` for an unknown signal."""
        view = log.view or RunView(log)
        if self.signal is None:
            return _Ticks(view, log).close(ast.parse(self.until.strip(), mode="eval").body)
        if self.signal not in log.rows.columns:
            known = ", ".join(log.rows.columns)
            raise ScenarioError(f"--score {self.signal}: these runs do not have this signal (known: {known})")
        return _magnitude(view.column(self.signal))


@dataclass(frozen=True)
class Rises:
    """Function that returns the ticks of a run at which its margin to failure reaches a new maximum. The estimation of
    a rare failure splits runs at these ticks."""

    closeness: Closeness
    ahead_s: float = 0.0  # Time over which an increase of the margin is extrapolated [s]

    def __call__(self, log: Log) -> dict[str, Any]:
        """Return `rises`, a list of (tick number, margin) for each new maximum, and `ticks`, the number of ticks."""
        close = self.closeness(log)
        before = np.concatenate([np.repeat(close[:1], SLOPE_TICKS), close])[: len(close)]
        close = close + np.maximum(close - before, 0.0) * self.ahead_s / (SLOPE_TICKS * TICK_S)
        highest = np.maximum.accumulate(close)
        new = np.flatnonzero(np.diff(highest, prepend=-np.inf) > 0)
        return {"rises": [[int(k) + 1, float(close[k])] for k in new], "ticks": len(close)}


def check_closeness(closeness: Closeness, scenario: Scenario) -> None:
    """Raise `ScenarioError` if the margin cannot be computed for a short run of the scenario."""
    closeness(run(scenario.changed({"duration_s": TRIAL_S})))


class _Ticks:
    """Evaluator of the margin of one run to failure, at all ticks."""

    def __init__(self, view: RunView, log: Log) -> None:
        self.view, self.planned, self.known = view, log.scenario.ticks, log.rows.columns
        self.completed = log.outcome == "completed"

    def close(self, node: ast.expr) -> Array:
        """Return the margin of a node in the syntax tree of the condition at each tick [-], positive if the node is
        true."""
        if isinstance(node, ast.BoolOp):
            parts = np.array([self.close(part) for part in node.values])
            return np.asarray(parts.min(axis=0) if isinstance(node.op, ast.And) else parts.max(axis=0))
        if isinstance(node, ast.UnaryOp):
            return -self.close(node.operand)
        if not isinstance(node, ast.Compare):
            raise TypeError(f"unsupported expression in a condition: {ast.unparse(node)}")
        sides = pairwise([node.left, *node.comparators])
        found = [self._compare(op, *pair) for op, pair in zip(node.ops, sides, strict=True)]
        return np.asarray(np.min(found, axis=0))

    def _compare(self, op: ast.cmpop, left: ast.expr, right: ast.expr) -> Array:
        names = [side.value if isinstance(side, ast.Constant) else name_of(side) for side in (left, right)]
        if "outcome" in names:
            near = self._end(str(next(name for name in names if name != "outcome")))
            return near if isinstance(op, ast.Eq) else -near
        (a, of_a), (b, of_b) = self._side(left), self._side(right)
        apart = (a - b) / (max(of_a, of_b) or 1.0)
        if isinstance(op, ast.Gt | ast.GtE):
            return apart
        if isinstance(op, ast.Lt | ast.LtE):
            return -apart
        return np.abs(apart) if isinstance(op, ast.NotEq) else -np.abs(apart)

    def _side(self, term: ast.expr) -> tuple[Array, float]:
        """Return the value of one side of a comparison at each tick, shape (ticks,), and a scale for margins: the
        magnitude of this side if it is a number, or 0 if it is a metric."""
        name = name_of(term)
        if name is not None:
            return self._metric(name), 0.0
        number = float(ast.literal_eval(term))
        return np.full(len(self.view.column("t")), number), abs(number)

    def _metric(self, name: str) -> Array:
        source = next((SIGNALS[first] for first in SIGNALS if name.startswith(first)), None)
        if source is None:
            firsts = ", ".join(f"{first}..." for first in SIGNALS)
            raise ScenarioError(
                f"--until: the signal of the metric {name} is unknown (known for {firsts}); specify it with --score"
            )
        size = _magnitude(source(self.view))
        values = _over(size, name, self.planned)
        if self.completed:  # the run may have ended early, and its end is final
            values[-1] = _over(size, name, len(size))[-1]
        return values

    def _end(self, outcome: str) -> Array:
        """Return the margin to an outcome such as `rolled_over` at each tick [-], from load transfer, roll, hitch angle
        or path offset."""
        if outcome == "rolled_over":
            return self._tipping() - 1.0
        if outcome == "jackknifed" and "hitch_angle" in self.known:
            return _magnitude(self.view.column("hitch_angle")) / (pi / 2) - 1.0
        lost = _magnitude(self.view.cg_on_path.offset) / LOST_M
        return 1.0 - np.maximum(self._tipping(), lost) if outcome == "completed" else lost - 1.0

    def _tipping(self) -> Array:
        """Return the mean of load transfer ratio and absolute roll [rad], about 1 for an overturned tractor."""
        lean = _magnitude(self.view.column("roll"))
        if "load_fl" not in self.known:
            return lean
        left, right = (sum(self.view.column(f"load_{axle}{side}") for axle in "fr") for side in "lr")
        share = np.abs(left - right) / np.maximum(left + right, 1.0)
        return np.asarray(0.5 * np.minimum(np.nan_to_num(share), 1.0) + 0.5 * lean)


def _magnitude(values: Array) -> Array:
    return np.abs(np.nan_to_num(values, nan=0.0, posinf=1e9, neginf=1e9))


def _over(size: Array, name: str, planned: int) -> Array:
    """Return the value that the metric `name` would have if all errors after a tick were zero, for each tick. `size`
    contains the error magnitudes, and `planned` is the planned number of ticks."""
    if "p95" in name:
        return _percentile(size, planned)
    if name.endswith(("_mse", "_rms")):
        mean = np.cumsum(size**2) / planned
        return mean if name.endswith("_mse") else np.sqrt(mean)
    return size


def _percentile(size: Array, planned: int) -> Array:
    """Return the 95th percentile that the errors `size` would have if all errors after a tick were zero, for each tick.
    `planned` is the planned number of ticks."""
    largest, most, found = list[float](), planned - int(0.95 * (planned - 1)), np.zeros(len(size))
    for k, value in enumerate(size.tolist()):
        if len(largest) < most:
            heappush(largest, value)
        else:
            heappushpop(largest, value)
        if len(largest) == most:
            found[k] = largest[0]
    return found
