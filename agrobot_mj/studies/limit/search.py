"""Where does a guidance law stop working? A search along one key, over seeds, with what the runs can support.

At a value a law *holds* if the lower end of the Wilson interval [Wilson1927] of its success rate is at least the wanted
reliability, and *fails* if the upper end is below it; runs are added, seed by seed, until either is so or all seeds are
used, after which the rate itself decides and the value is called uncertain. First the range is scanned at equal
distances, from the end where the law should hold; then the first change from holding to failing is bisected. What the
scan shows beside that (works again further on, never fails, fails from the start) is said, not smoothed over.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain, pairwise, repeat
from math import ceil, inf, isfinite, sqrt
from statistics import NormalDist
from typing import NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.metrics.success import COMPLETED, succeeded
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.limit.condition import Condition
from agrobot_mj.studies.sweep.plan import base_text
from agrobot_mj.studies.sweep.work import WALL, Done, Task

SCANNED = 5
"""Values at equal distances over the range that are tried before any is bisected."""
MOST_CONFIDENT = 0.999999
"""Largest confidence: beyond it the interval of a rate is that of rounding [-]."""
TRIAL_S = 1.0
"""Simulated time of the run that shows which metrics there are [s]."""
RunTasks = Callable[[Sequence[Task]], list[Done]]
"""Does runs, some at a time; results in the order of the tasks."""


class Question(NamedTuple):
    """What is to be found."""

    key: str
    """Dotted key that is varied."""
    start: float
    """End of the range where laws should hold."""
    stop: float
    """Other end, above or below."""
    until: str
    """Condition at which a run counts as failed."""
    seeds: int = 10
    """Most runs at a value [-]."""
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
    """How many there are."""
    failed: int
    """How many of them met the condition, raised, or ended otherwise than expected (`Condition.fails`)."""
    low: float
    """Lower end of the interval of the success rate [-]."""
    high: float
    """Upper end [-]."""
    holds: bool
    """Whether the law holds here."""
    certain: bool
    """Whether the interval says so, not only the rate."""
    outcomes: dict[str, int]
    """Number of runs by outcome."""
    unexpected: int
    """How many ended otherwise than their scenario expects."""

    @property
    def ends(self) -> str:
        """How many runs ended how."""
        return ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())


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
        raise ScenarioError(f"--range {q.start:g}:{q.stop:g}: name two different numbers, first where laws should hold")
    if not isfinite(q.stop - q.start):
        raise ScenarioError(f"--range {q.start:g}:{q.stop:g}: is too wide")
    if not (0 < q.resolution < inf and 0 < q.reliability < 1 and 0 < q.confidence <= MOST_CONFIDENT):
        raise ScenarioError(
            f"--tolerance must be above 0, --reliability between 0 and 1, --confidence between 0 and {MOST_CONFIDENT}"
        )
    for scenario in scenarios.values():
        for value in (q.start, q.stop):
            at_value(scenario, q, value)
    first = next(iter(scenarios.values()))
    condition = Condition(q.until, metric_names(first))
    if condition.names_error and not condition.names_outcome and first.expected_outcome != COMPLETED:
        raise ScenarioError(
            f"--until {q.until!r}: only a run that completes has an error, and {first.name} expects "
            f'{first.expected_outcome}; add --set expected_outcome={COMPLETED}, or "or outcome == ..." to the condition'
        )
    return condition


def at_value(scenario: Scenario, q: Question, value: float) -> Scenario:
    """The scenario with the key at a value. Raises `ScenarioError`."""
    return scenario.changed({q.key: _value(scenario, q, value)})


def runs_needed(reliability: float, confidence: float) -> int:
    """Number of runs without a failure that shows a reliability: from n / (n + z^2) >= R."""
    return ceil(_z(confidence) ** 2 * reliability / (1.0 - reliability) - 1e-9)


def wilson(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Two-sided interval of a success rate from its number of successes [Wilson1927]."""
    z, n, p = _z(confidence), runs, successes / runs
    middle, half = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, (middle - half) / (1 + z * z / n)), min(1.0, (middle + half) / (1 + z * z / n))


def _z(confidence: float) -> float:
    return NormalDist().inv_cdf((1.0 + confidence) / 2.0)


def find_limit(
    name: str,
    scenario: Scenario,
    question: Question,
    condition: Condition,
    do: RunTasks,
    done: Callable[[Tried], object],
) -> Found:
    """Search the limit of one law; `done` hears of each value tried."""
    tried: dict[float, Tried] = {}

    def holds(value: float) -> bool:
        value = _value(scenario, question, value)
        if value not in tried:
            tried[value] = _try(scenario, question, condition, value, do)
            done(tried[value])
        return tried[value].holds

    q = question
    scan = [_value(scenario, q, q.start + (q.stop - q.start) * k / (SCANNED - 1)) for k in range(SCANNED)]
    for value in scan:
        holds(value)
    change = next(((a, b) for a, b in pairwise(scan) if holds(a) and not holds(b)), None)
    if change and holds(scan[0]):
        good, bad = change
        while abs(bad - good) > q.resolution:
            middle = _value(scenario, q, (good + bad) / 2)
            if middle in (good, bad):
                break
            good, bad = (middle, bad) if holds(middle) else (good, middle)
    in_order = tuple(sorted(tried.values(), key=lambda t: abs(t.value - q.start)))
    return _answer(name, q, in_order)


def _try(scenario: Scenario, q: Question, condition: Condition, value: float, do: RunTasks) -> Tried:
    """Runs at one value, until the interval of the success rate is clear of the reliability or no seed is left."""
    base, failed, runs, unexpected, outcomes = base_text(scenario), 0, 0, 0, dict[str, int]()
    low, high = 0.0, 1.0
    for batch in _batches(q):
        seeds = range(scenario.seed + runs, scenario.seed + runs + batch)
        for result in do([Task(s, base, scenario.name, {q.key: value, "seed": s}, "table") for s in seeds]):
            outcome = str(result.numbers["outcome"])
            outcomes[outcome] = outcomes.get(outcome, 0) + 1
            failed += condition.fails(result.numbers)
            unexpected += not succeeded(result.numbers)
        runs += batch
        low, high = wilson(runs - failed, runs, q.confidence)
        if low >= q.reliability or high < q.reliability:
            break
    certain = low >= q.reliability or high < q.reliability
    return Tried(value, runs, failed, low, high, 1 - failed / runs >= q.reliability, certain, outcomes, unexpected)


def _batches(q: Question) -> Iterator[int]:
    """Numbers of runs to add: two, which may show a failure; enough to show success; then two by two."""
    left, needed = q.seeds, runs_needed(q.reliability, q.confidence)
    for wanted in chain((2, needed - 2), repeat(2)):
        batch = min(wanted, left)
        if batch > 0:
            yield batch
        left -= batch
        if left <= 0:
            return


def _answer(name: str, q: Question, tried: tuple[Tried, ...]) -> Found:
    """The verdict on what was tried, from the start of the range on, with what ended otherwise than expected."""
    found = _verdict(name, q, tried)
    if unexpected := [f"{t.ends} at {t.value:g}" for t in tried if t.unexpected]:
        return found._replace(statement=f"{found.statement}. Not every run ended as expected: {'; '.join(unexpected)}")
    return found


def _verdict(name: str, q: Question, tried: tuple[Tried, ...]) -> Found:
    """The verdict on what was tried."""
    answer = partial(Found, name, tried=tried)
    terms = f"{100 * q.reliability:g} % of runs at {100 * q.confidence:g} % confidence"
    if q.seeds < (needed := runs_needed(q.reliability, q.confidence)):
        terms = f"by the rates of {q.seeds} runs at a value; {terms} needs {needed}"
    works, fails = [t for t in tried if t.holds], [t for t in tried if not t.holds]
    if not fails:
        values = ", ".join(f"{t.value:g}" for t in tried)
        text = f"{name} does not fail at the values tried, {q.key} = {values} ({terms})"
        return answer(verdict="never_fails", limit=None, interval=None, statement=text)
    if not works:
        text = f"{name} fails at all values tried, from {q.key} = {tried[0].value:g} on"
        return answer(verdict="always_fails", limit=None, interval=None, statement=text)
    if not tried[0].holds:
        first, there = tried[0], ", ".join(f"{t.value:g}" for t in works)
        advice = "turn the range round?" if first.certain else "more seeds, or begin where it holds"
        count = f"{first.runs - first.failed} of {first.runs} runs succeed"
        text = f"{name} does not hold at the start, {q.key} = {first.value:g} ({count}), but at {there}; {advice}"
        return answer(verdict="fails_at_start", limit=None, interval=None, statement=text)
    first_bad = next(k for k, t in enumerate(tried) if not t.holds)
    estimate = (tried[first_bad - 1].value + tried[first_bad].value) / 2
    interval = _interval(tried, first_bad)
    # Where the runs leave it open, the rate goes up and down by chance.
    again = [t.value for t in tried[first_bad:] if t.holds and (t.certain or q.seeds < needed)]
    good, bad = interval if q.seeds >= needed else (tried[first_bad - 1].value, tried[first_bad].value)
    text = f"{name} holds up to {q.key} = {good:g}, fails from {bad:g} on ({terms})"
    if again:
        text += f", but works again at {', '.join(f'{value:g}' for value in again)}: one number does not describe it"
    verdict = "not_monotone" if again else "limit"
    return answer(verdict=verdict, limit=estimate, interval=interval, statement=text)


def _interval(tried: tuple[Tried, ...], first_bad: int) -> tuple[float, float]:
    """The last value before the change that certainly holds, and the first one after it that certainly fails."""
    before = [t.value for t in tried[:first_bad] if t.certain]
    after = [t.value for t in tried[first_bad:] if t.certain and not t.holds]
    return before[-1] if before else tried[0].value, after[0] if after else tried[-1].value


def _value(scenario: Scenario, q: Question, value: float) -> float:
    """The value as the key takes it: a whole number where it must be one, without digits that rounding leaves."""
    tidy = float(f"{value:.10g}")
    try:
        scenario.changed({q.key: tidy}, files=False)
    except ScenarioError as error:
        if "whole number" in str(error):
            return round(value)
        raise
    return tidy
