"""What is asked of a limit, what is tried for it, and what is found: `Question`, `Tried`, `Found`, `Counterpart`."""

from collections.abc import Mapping, Sequence
from math import inf, isfinite
from types import MappingProxyType
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics.success import COMPLETED
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.engine.tasks import WALL
from agrobot_mj.studies.limit.condition import Condition

MOST_CONFIDENT = 0.999999
"""Largest confidence [-]: beyond it the interval of a rate is dominated by rounding."""
TRIAL_S = 1.0
"""Duration of the trial run that shows which metrics exist [s]."""


class Question(NamedTuple):
    """The search that is asked for."""

    key: str
    """Dotted key that is varied."""
    start: float
    """End of the range where laws should hold."""
    stop: float
    """Other end, above or below."""
    until: str
    """Condition at which a run counts as failed."""
    seeds: int = 10
    """Largest number of runs per value during the search; the two values around the limit have at least ten [-]."""
    reliability: float = 0.8
    """Share of runs that must succeed for a law to hold [-]."""
    confidence: float = 0.8
    """Confidence of the intervals [-]."""
    tolerance: float | None = None
    """Distance at which the bisection ends; None for a fiftieth of the range."""

    @property
    def resolution(self) -> float:
        """Distance at which the bisection ends."""
        return abs(self.stop - self.start) / 50 if self.tolerance is None else self.tolerance


class Tried(NamedTuple):
    """The runs at one value."""

    value: float
    """Value of the key."""
    runs: int
    """Number of independent runs: one where seeds change nothing."""
    failed: int
    """Number of runs that met the condition, raised, or ended otherwise than expected (`Condition.fails`)."""
    low: float
    """Lower end of the interval of the success rate [-]; the rate itself where seeds change nothing."""
    high: float
    """Upper end [-]."""
    holds: bool
    """Whether the law holds here."""
    certain: bool
    """Whether the interval, and not only the rate, is on one side of the reliability."""
    outcomes: dict[str, int]
    """Number of runs by outcome."""
    unexpected: int
    """Number of runs that ended otherwise than their scenario expects."""
    independent: bool = True
    """Whether seeds change a run; if not, one run is all that there is, and no interval."""
    medians: Mapping[str, float] = MappingProxyType({})
    """Median of each metric that the condition names, over the runs that have it."""

    @property
    def share(self) -> str:
        """Successes and runs as text, as in `8 of 10 runs`."""
        return f"{self.runs - self.failed} of {self.runs} runs"

    @property
    def written(self) -> dict[str, Any]:
        """The runs as plain data."""
        return {**self._asdict(), "medians": dict(self.medians)}

    @property
    def ends(self) -> str:
        """Number of runs by outcome as text."""
        return ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())


class Counterpart(NamedTuple):
    """Answer to the same question without the hardship."""

    overrides: dict[str, Any]
    """Overrides of the counterpart, by dotted key."""
    verdict: str
    """Verdict as in `Found`; `fixed` where the counterpart lacks the key or sets it, so that it is runs and no
    search."""
    limit: float | None
    """Value at which it stops holding without the hardship, if there is one."""
    statement: str
    """The answer as a sentence, with what the hardship took."""
    tried: tuple[Tried, ...]
    """All values, or the runs of a `fixed` counterpart, whose value is the start of the range."""


class Found(NamedTuple):
    """The answer for one law."""

    law: str
    """Name of the law."""
    verdict: str
    """`limit`, `never_fails`, `always_fails`, `fails_at_start`, or `not_monotone`."""
    limit: float | None
    """Estimate of the value at which it stops holding, if there is one."""
    interval: tuple[float, float] | None
    """Values around it at which it certainly holds and certainly fails (an end of the range where none was)."""
    statement: str
    """The answer as a sentence."""
    tried: tuple[Tried, ...]
    """All values, from the start of the range on."""
    beside: Counterpart | None = None
    """Answer without the hardship, if that was asked."""


def metric_names(scenario: Scenario) -> list[str]:
    """Names of the metrics of a scenario that are numbers, from a short run of it."""
    numbers = flat(run(scenario.changed({"duration_s": TRIAL_S})).metrics)
    return [name for name, value in numbers if name not in WALL and (value is None or isinstance(value, int | float))]


def laws(scenario: Scenario, kinds: Sequence[str]) -> dict[str, Scenario]:
    """The scenario under each kind of guidance, its own if none is named. Raises `ScenarioError`."""
    return {kind: scenario.changed({"guidance.kind": kind}) for kind in kinds or [scenario.guidance.kind]}


def check(question: Question, scenarios: dict[str, Scenario]) -> Condition:
    """Check that the question can be asked; returns its condition. Raises `ScenarioError`."""
    q = question
    if not (isfinite(q.start) and isfinite(q.stop)) or q.start == q.stop:
        raise ScenarioError(f"--range {q.start:g}:{q.stop:g}: name two numbers, the first where laws should hold")
    if not isfinite(q.stop - q.start):
        raise ScenarioError(f"--range {q.start:g}:{q.stop:g}: is too wide")
    if not (0 < q.resolution < inf and 0 < q.reliability < 1 and 0 < q.confidence <= MOST_CONFIDENT):
        raise ScenarioError(
            f"--tolerance must be above 0, --reliability between 0 and 1, --confidence between 0 and {MOST_CONFIDENT}"
        )
    for scenario in scenarios.values():
        for value in (q.start, q.stop):
            at_value(scenario, q, value)
    return condition_of(q.until, next(iter(scenarios.values())))


def condition_of(until: str, scenario: Scenario) -> Condition:
    """The condition on runs of a scenario. Raises `ScenarioError`."""
    condition = Condition(until, metric_names(scenario))
    if condition.names_error and not condition.names_outcome and scenario.expected_outcome != COMPLETED:
        raise ScenarioError(
            f"--until {until!r}: only a run that completes has an error, and {scenario.name} expects "
            f"{scenario.expected_outcome}; add --set expected_outcome={COMPLETED}, or "
            f'"or outcome == ..." to the condition'
        )
    return condition


def at_value(scenario: Scenario, q: Question, value: float) -> Scenario:
    """The scenario with the key at a value. Raises `ScenarioError`."""
    return scenario.changed({q.key: as_value(scenario, q.key, value)})


def as_value(scenario: Scenario, key: str, value: float) -> float:
    """The value as the key takes it, whole or of whole ticks where it must be, without digits that rounding leaves."""
    tidy = float(f"{value:.10g}")
    try:
        scenario.changed({key: tidy}, files=False)
    except ScenarioError as error:
        if f"whole number of {TICK_S} s ticks" in str(error):
            return float(f"{round(value / TICK_S) * TICK_S:.10g}")
        if "whole number" in str(error):
            return round(value)
        raise
    return tidy
