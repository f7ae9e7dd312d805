"""Settings and result of a limit search: evaluated values, verdict, and sentences about limitations."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from math import inf, isfinite
from types import MappingProxyType
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import Spec, nearest_value
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.interval import runs_needed
from agrobot_mj.metrics.success import COMPLETED
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.engine.tasks import WALL

MOST_CONFIDENT = 0.999999  # Maximum confidence [-]. Above it, rounding errors dominate the interval of a rate.
TRIAL_S = 1.0  # Duration of a short run that shows which metrics exist [s]


class Question(NamedTuple):
    """Settings of a limit search."""

    key: str
    start: float  # Value at which the search starts. Laws are expected to succeed there.
    stop: float  # Value at the other end of the range, above or below `start`
    until: str
    seeds: int = 12
    """Maximum number of runs per value during the search. Both values next to the limit get at least twelve runs."""
    reliability: float = 0.8  # Fraction of successful runs above which a law is reliable at a value [-]
    confidence: float = 0.8  # Confidence of the intervals of success rates [-]
    tolerance: float | None = None  # Bracket width at which the bisection ends. Default: one fiftieth of the range.

    @property
    def resolution(self) -> float:
        """Width of the bracket around the limit at which the bisection ends [unit of the key]."""
        return abs(self.stop - self.start) / 50 if self.tolerance is None else self.tolerance


class Tried(NamedTuple):
    """Results of all runs at one value of the varied key."""

    value: float
    runs: int  # Number of independent runs, or 1 if seeds have no effect
    failed: int  # Number of failed runs, see `Condition.fails`
    low: float  # Lower end of the interval of the success rate [-]; the rate itself if seeds have no effect
    high: float  # Upper end of the interval of the success rate [-]
    holds: bool  # Whether the success rate reaches the required reliability
    certain: bool  # Whether the entire interval is above or below the required reliability
    outcomes: dict[str, int]
    unexpected: int  # Number of runs whose outcome differs from the expected outcome of the scenario
    independent: bool = True
    """Whether the seeds affect the runs. Otherwise only one run counts, and the interval has zero width."""
    medians: Mapping[str, float] = MappingProxyType({})
    """Median of each metric in the condition, over the runs that have a value."""

    @property
    def share(self) -> str:
        """Number of successful runs and number of all runs as text, for example `8 of 10 runs`."""
        return f"{self.runs - self.failed} of {self.runs} runs"

    @property
    def written(self) -> dict[str, Any]:
        """Fields of the results as a dictionary for JSON files."""
        return {**self._asdict(), "medians": dict(self.medians)}

    @property
    def ends(self) -> str:
        """Number of runs with each outcome as text, for example `3 completed, 1 stuck`."""
        return ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())


class Counterpart(NamedTuple):
    """Result of a limit search for the baseline, a scenario without the fault or disturbance."""

    overrides: dict[str, Any]
    verdict: str  # Verdict as in `Found`. If the baseline lacks the key or sets it, the verdict is `fixed`.
    limit: float | None
    statement: str  # Sentence with the result of the baseline and the shift of the limit
    tried: tuple[Tried, ...]
    """All evaluated values of the key. A `fixed` baseline has one entry, for the start of the range."""


class Found(NamedTuple):
    """Result of a limit search for one guidance law."""

    law: str
    verdict: str  # Verdict: `limit`, `never_fails`, `always_fails`, `fails_at_start`, or `not_monotone`
    limit: float | None
    interval: tuple[float, float] | None
    """Interval of the limit: nearest key values on both sides with certain success and with certain failure. Missing
    values are replaced by the ends of the range."""
    statement: str
    tried: tuple[Tried, ...]  # All evaluated values, ordered from the start of the range
    beside: Counterpart | None = None  # Result of the baseline without the fault or disturbance, if requested


def metric_names(scenario: Scenario) -> list[str]:
    """Return the names of the numeric metrics of a scenario, which are determined by a short run."""
    numbers = flat(run(scenario.changed({"duration_s": TRIAL_S})).metrics)
    return [name for name, value in numbers if name not in WALL and (value is None or isinstance(value, int | float))]


def laws(scenario: Scenario, kinds: Sequence[str]) -> dict[str, Scenario]:
    """Return the scenario with each law in `kinds`, by default its own. Raises `ScenarioError` for invalid laws."""
    return {kind: scenario.changed({"guidance.kind": kind}) for kind in kinds or [scenario.guidance.kind]}


def check(question: Question, scenarios: dict[str, Scenario]) -> Condition:
    """Check search settings and return the failure condition. Raises `ScenarioError` for invalid settings."""
    q = question
    if q.key == "seed":
        raise ScenarioError(
            "--key seed: the seed is not a parameter to search; every value is run with up to --max-seeds seeds"
        )
    if not (isfinite(q.start) and isfinite(q.stop)) or q.start == q.stop:
        raise ScenarioError(
            f"--range {q.start:g}:{q.stop:g}: specify two different numbers A:B, where the laws succeed at A"
        )
    if not isfinite(q.stop - q.start):
        raise ScenarioError(f"--range {q.start:g}:{q.stop:g}: the range is wider than 1.8e308; specify a narrower one")
    if not (0 < q.resolution < inf and 0 < q.reliability < 1 and 0 < q.confidence <= MOST_CONFIDENT):
        raise ScenarioError(
            f"--tolerance must be above 0, --reliability between 0 and 1, --confidence between 0 and {MOST_CONFIDENT}"
        )
    for scenario in scenarios.values():
        for value in (q.start, q.stop):
            at_value(scenario, q, value)
    return condition_of(q.until, next(iter(scenarios.values())))


def condition_of(until: str, scenario: Scenario) -> Condition:
    """Return the failure condition for runs of a scenario. Raises `ScenarioError` for an invalid text `until`."""
    Condition(until)  # invalid syntax is reported before the run for the names of the metrics
    condition = Condition(until, metric_names(scenario))
    if condition.names_error and not condition.names_outcome and scenario.expected_outcome != COMPLETED:
        raise ScenarioError(
            f"--until {until!r}: only completed runs have tracking errors, but {scenario.name} expects "
            f"{scenario.expected_outcome}; add --set expected_outcome={COMPLETED}, or "
            f'"or outcome == ..." to the condition'
        )
    return condition


def at_value(scenario: Scenario, q: Question, value: float) -> Scenario:
    """Return the scenario with the varied key set to `value`. Raises `ScenarioError` for an invalid key or value."""
    return scenario.changed({q.key: as_value(scenario, q.key, value)})


def as_value(scenario: Scenario, key: str, value: float) -> float:
    """Return the number nearest to `value` that the key accepts, for example an integer or a whole number of ticks."""
    owner: Any = scenario
    *tables, name = key.split(".")
    for table in tables:
        items = isinstance(owner, tuple) and table.isdecimal() and int(table) < len(owner)
        owner = owner[int(table)] if items else getattr(owner, table, None)
    return nearest_value(type(owner) if isinstance(owner, Spec) else Scenario, name, value)


def answer(name: str, q: Question, tried: tuple[Tried, ...]) -> Found:
    """Return the result of a limit search, and the restrictions under which the result is valid. `tried` contains the
    evaluated values, ordered from the start of the range."""
    found = _verdict(name, q, tried)
    parts = [found.statement, *_coverage(tried), *_caveats(q, tried)]
    if unexpected := [f"{t.ends} at {t.value:g}" for t in tried if t.unexpected]:
        parts.append(f"Some runs did not end as expected: {'; '.join(unexpected)}")
    return found._replace(statement=". ".join(parts))


def _verdict(name: str, q: Question, tried: tuple[Tried, ...]) -> Found:
    found = partial(Found, name, tried=tried)
    terms = f"{100 * q.reliability:g} % of runs at {100 * q.confidence:g} % confidence"
    works, fails = [t for t in tried if t.holds], [t for t in tried if not t.holds]
    if not fails:
        text = (
            f"{name} does not fail at evaluated values of {q.key} ({tried[-1].share} at {tried[-1].value:g}; {terms})"
        )
        return found(verdict="never_fails", limit=None, interval=None, statement=text)
    if not works:
        text = (
            f"{name} fails at all evaluated values, starting at {q.key} = {tried[0].value:g} ({tried[0].share} succeed)"
        )
        return found(verdict="always_fails", limit=None, interval=None, statement=text)
    if not tried[0].holds:
        first, there = tried[0], ", ".join(f"{t.value:g}" for t in works)
        advice = "check the direction of the range" if first.certain else ("use more seeds or another start")
        begin = f"{q.key} = {first.value:g} ({first.share} succeed)"
        text = f"{name} does not succeed at the start, {begin}, but at {there}; {advice}"
        return found(verdict="fails_at_start", limit=None, interval=None, statement=text)
    first_bad = next(k for k, t in enumerate(tried) if not t.holds)
    good, bad = tried[first_bad - 1], tried[first_bad]
    interval = _interval(tried, first_bad)
    # With few runs, the success rate varies by chance.
    few = q.seeds < runs_needed(q.reliability, q.confidence)
    again = [t.value for t in tried[first_bad:] if t.holds and (t.certain or few)]
    text = f"{name} succeeds up to {q.key} = {good.value:g} ({good.share} succeed)"
    text += f" and fails from {bad.value:g} ({bad.share} succeed; {terms})"
    if (good.value, bad.value) != interval:
        text += f"; at this confidence it succeeds at {interval[0]:g} and fails at {interval[1]:g}"
    if again:
        text += f", but succeeds again at {', '.join(f'{value:g}' for value in again)}, so there is no single limit"
    verdict = "not_monotone" if again else "limit"
    return found(verdict=verdict, limit=(good.value + bad.value) / 2, interval=interval, statement=text)


def _interval(tried: tuple[Tried, ...], first_bad: int) -> tuple[float, float]:
    """Return the last value with certain success before the limit, and the first value with certain failure after the
    limit. Missing values are replaced by the ends of the range."""
    before = [t.value for t in tried[:first_bad] if t.certain]
    after = [t.value for t in tried[first_bad:] if t.certain and not t.holds]
    return before[-1] if before else tried[0].value, after[0] if after else tried[-1].value


def _coverage(tried: Sequence[Tried]) -> list[str]:
    """Return a sentence with the evaluated key values, and the maximum distance between successive values with equal
    results, between which another result would not be detected."""
    held, failed = (", ".join(f"{t.value:g}" for t in tried if t.holds is holds) for holds in (True, False))
    seen = [*([f"Succeeded at {held}"] if held else []), *([f"failed at {failed}"] if failed else [])]
    gaps = [abs(b.value - a.value) for a, b in pairwise(tried) if a.holds == b.holds]
    text = "; ".join(seen)
    text = f"{text[0].upper()}{text[1:]}; no value in between was evaluated"
    return [f"{text}; an interval of up to {max(gaps):g} with another result would not be detected" if gaps else text]


def _caveats(q: Question, tried: Sequence[Tried]) -> list[str]:
    """Return sentences about limitations of the intervals: seeds without effect, or few runs at intermediate values."""
    if not all(t.independent for t in tried):
        which = ", ".join(f"{t.value:g}" for t in tried if not t.independent)
        where = "" if not any(t.independent for t in tried) else f" at {which}"
        return [f"Seeds have no effect{where}: one run gives the result, without an interval"]
    if q.seeds < (needed := runs_needed(q.reliability, q.confidence)):
        return [f"Intermediate values are classified by {q.seeds} runs each; the confidence needs {needed}"]
    return []


def answer_beside(found: Found, q: Question, sound: Found, overrides: Mapping[str, Any]) -> Counterpart:
    """Return the result of a baseline search, with the shift of the limit caused by the fault or disturbance."""
    text = f"with {_overrides_text(overrides)}: {sound.statement.removeprefix(sound.law + ' ').split('. ')[0]}"
    return Counterpart(
        dict(overrides), sound.verdict, sound.limit, f"{text}; {_shift_text(found, q, sound)}", sound.tried
    )


def _shift_text(found: Found, q: Question, sound: Found) -> str:
    """Return a sentence about the shift of the limit caused by the fault or disturbance."""
    if found.limit is None or sound.limit is None:
        same = found.verdict == sound.verdict
        return "the same result without the disturbance" if same else "not comparable: one limit is out of range"
    taken = abs(sound.limit - q.start) - abs(found.limit - q.start)
    if abs(taken) <= q.resolution:
        return f"the disturbance reduces the limit by less than the resolution of {q.resolution:g}"
    return f"the disturbance {'reduces' if taken > 0 else 'increases'} the limit by {abs(taken):.3g}"


def answer_fixed(found: Found, runs: Tried, overrides: Mapping[str, Any]) -> Counterpart:
    """Return the result for a baseline without a search: success rate, and medians of the metrics in the condition."""
    medians = "".join(f", median {name} {value:.3g}" for name, value in runs.medians.items())
    text = f"with {_overrides_text(overrides)}: {runs.share} succeed{medians}"
    if found.verdict == "always_fails" and not runs.holds:
        text += "; it also fails without the disturbance"
    return Counterpart(dict(overrides), "fixed", None, text, (runs,))


def _overrides_text(overrides: Mapping[str, Any]) -> str:
    return ", ".join(f"{key}={value}" for key, value in overrides.items())
