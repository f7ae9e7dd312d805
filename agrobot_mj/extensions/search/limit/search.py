"""Search for the value of one key at which a guidance law begins to fail, with several seeds.

A law *holds* at a value if the lower end of the sequential interval [Robbins1970] of its success rate is at least the
required reliability. The law *fails* if the upper end is below this reliability. Runs are added until the law holds or
fails. If all seeds are used before, the success rate decides, and the value is uncertain. If seeds have no effect, one
run decides.

First, the search evaluates equidistant values, starting at the end of the range where the law should hold, and then
bisects the first change from holding to failing. Both values next to the change get more runs, which may shift the
change. The result also states whether the law holds again at farther values, never fails, or fails at the start.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, pairwise, repeat
from pathlib import Path
from statistics import median
from typing import Any

from matplotlib.figure import Figure

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.interval import runs_needed, sequential_interval
from agrobot_mj.extensions.search.limit.question import (
    Counterpart,
    Found,
    Question,
    Tried,
    answer,
    answer_beside,
    answer_fixed,
    as_value,
    at_value,
    check,
    laws,
)
from agrobot_mj.metrics.success import error_of, is_error, is_success
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies import RunTasks, Task, about, check_tractors, study, write_json
from agrobot_mj.studies.engine.tasks import WALL
from agrobot_mj.studies.style import PANEL_WIDTH_IN, SPARE_COLOURS, write_figure

SCANNED = 5  # Number of equidistant values evaluated before the bisection
SHOWN_RUNS = 12
"""Minimum number of runs at both values next to the limit, sufficient for certainty with default settings."""
Numbers = Mapping[str, Any]


def find_limit(
    name: str,
    scenario: Scenario,
    question: Question,
    condition: Condition,
    do: RunTasks,
    done: Callable[[Tried], object],
    beside: Mapping[str, Any] | None = None,
) -> Found:
    """Search for the value of the key at which one law begins to fail. `done` receives the results at each value.

    `beside` contains the overrides of a baseline without the fault or disturbance, which is searched in the same way.
    Raises `ScenarioError` for invalid overrides.
    """
    found = answer(name, question, _Search(scenario, question, condition, do, done).run())
    if not beside:
        return found
    sound = scenario.changed(dict(beside))
    return found._replace(beside=_beside(found, sound, question, condition, do, dict(beside)))


def _beside(
    found: Found, sound: Scenario, q: Question, condition: Condition, do: RunTasks, overrides: dict[str, Any]
) -> Counterpart:
    """Return the baseline result. If the varied key is missing or fixed, the baseline is simulated without a search."""
    if searchable(sound, q, overrides):
        tried = _Search(sound, q, condition, do, lambda tried: None).run()
        return answer_beside(found, q, answer(found.law, q, tried), overrides)
    runs = _run_seeds(sound, {}, 0, max(q.seeds, SHOWN_RUNS), do)
    return answer_fixed(found, judge(q.start, runs, q, condition), overrides)


def searchable(sound: Scenario, q: Question, overrides: Mapping[str, Any]) -> bool:
    """Return whether a baseline has the varied key and does not override it."""
    if q.key in overrides:
        return False
    try:
        at_value(sound, q, q.start)
        at_value(sound, q, q.stop)
    except ScenarioError:
        return False
    return True


class _Search:
    """Limit search that evaluates values of the varied key and stores the results."""

    def __init__(
        self, scenario: Scenario, q: Question, condition: Condition, do: RunTasks, done: Callable[[Tried], object]
    ) -> None:
        self.scenario, self.q, self.condition, self.do, self.done = scenario, q, condition, do, done
        self.runs, self.tried = dict[float, list[Numbers]](), dict[float, Tried]()

    def run(self) -> tuple[Tried, ...]:
        """Search for the limit. Return the results at all evaluated values, ordered from the start of the range."""
        for k in range(SCANNED):
            self._try(self._value(self.q.start + (self.q.stop - self.q.start) * k / (SCANNED - 1)))
        while self._goes_on():
            pass
        return self.in_order

    @property
    def in_order(self) -> tuple[Tried, ...]:
        """Evaluated values, ordered from the start of the range."""
        return tuple(sorted(self.tried.values(), key=lambda tried: abs(tried.value - self.q.start)))

    def _goes_on(self) -> bool:
        """Continue the search and return whether runs were added. The search evaluates a value between the last success
        and the first failure, or adds runs at both values."""
        tried = self.in_order
        change = next(((a, b) for a, b in pairwise(tried) if a.holds and not b.holds), None)
        if change and tried[0].holds:
            good, bad = (each.value for each in change)
            middle = self._value((good + bad) / 2)
            if abs(bad - good) > self.q.resolution and middle not in (good, bad):
                self._try(middle)
                return True
            shown = list(change)
        else:
            shown = [tried[-1] if tried[0].holds else tried[0]]
        short = [each for each in shown if each.independent and each.runs < SHOWN_RUNS]
        for each in short:
            self._drive(each.value, SHOWN_RUNS - each.runs)
            self.done(self.tried[each.value])
        return bool(short)

    def _try(self, value: float) -> None:
        """Simulate runs at a value until the success rate is certain or all seeds are used."""
        for batch in _batches(self.q) if value not in self.tried else ():
            self._drive(value, batch)
            if self.tried[value].certain:
                break
        self.done(self.tried[value])

    def _drive(self, value: float, count: int) -> None:
        runs = self.runs.setdefault(value, [])
        runs += _run_seeds(self.scenario, {self.q.key: value}, len(runs), count, self.do)
        self.tried[value] = judge(value, runs, self.q, self.condition)

    def _value(self, value: float) -> float:
        return as_value(self.scenario, self.q.key, value)


def _run_seeds(scenario: Scenario, overrides: dict[str, Any], first: int, count: int, do: RunTasks) -> list[Numbers]:
    seeds = range(scenario.seed + first, scenario.seed + first + count)
    task = Task.of(scenario)
    return [*do([task._replace(overrides={**overrides, "seed": seed}) for seed in seeds])]


def judge(value: float, runs: Sequence[Numbers], q: Question, condition: Condition) -> Tried:
    """Return the results of the runs at one value of the key. Identical results of all seeds count as one run."""
    independent = not _copies(runs)
    counted = runs if independent else runs[:1]
    failed, n = sum(condition.fails(run) for run in counted), len(counted)
    rate = 1 - failed / n
    low, high = sequential_interval(n - failed, n, q.confidence) if independent else (rate, rate)
    return Tried(
        value,
        n,
        failed,
        low,
        high,
        holds=rate >= q.reliability,
        certain=low >= q.reliability or high < q.reliability,
        outcomes=dict(Counter(str(run["outcome"]) for run in counted)),
        unexpected=sum(not is_success(run) for run in counted),
        independent=independent,
        medians={name: median(values) for name in condition.compared if (values := _values(name, counted))},
    )


def _copies(runs: Sequence[Numbers]) -> bool:
    """Return whether runs with different seeds have identical results, so that noise has no effect."""
    first, *others = ({name: run[name] for name in run if name not in WALL} for run in runs)
    measured = any(isinstance(value, float) for value in first.values())
    return measured and bool(others) and all(other == first for other in others)


def _values(name: str, runs: Sequence[Numbers]) -> list[float]:
    """Return the available values of a metric. For a tracking error, runs without valid errors are omitted."""
    if is_error(name):
        return [value for run in runs if (value := error_of(run, name)) is not None]
    return [float(run[name]) for run in runs if run.get(name) is not None]


def _batches(q: Question) -> Iterator[int]:
    """Yield the sizes of batches of runs: two to detect a failure, then enough to prove success, then two at a time."""
    left, needed = q.seeds, runs_needed(q.reliability, q.confidence)
    for wanted in chain((2, needed - 2), repeat(2)):
        batch = min(wanted, left)
        if batch > 0:
            yield batch
        left -= batch
        if left <= 0:
            return


FILES = ("limit.json", "limit.png")


def limit(
    scenario: Scenario,
    question: Question,
    kinds: Sequence[str],
    folder: Path,
    jobs: int | None = None,
    done: Callable[[str, Tried], object] = lambda law, tried: None,
    begin: Callable[[list[Scenario]], object] = lambda ends: None,
    beside: Mapping[str, Any] | None = None,
) -> list[Found]:
    """Search for the key value at which each law begins to fail. Write the results and all rows to `folder`."""
    scenarios = laws(scenario, kinds)
    condition = check(question, scenarios)
    for each in scenarios.values():
        each.changed(dict(beside or {}))
    starts, stops = (
        [at_value(each, question, end) for each in scenarios.values()] for end in (question.start, question.stop)
    )
    check_tractors(starts)  # impossible tractors elsewhere in the range count as failures
    begin([*starts, *stops])
    with study(folder, FILES, jobs) as do:
        found = [
            find_limit(name, under, question, condition, do, partial(done, name), beside)
            for name, under in scenarios.items()
        ]
        write_json(folder / "limit.json", content(scenario, question, found))
        write_figure(folder / "limit.png", figure, question, found)
    return found


def content(scenario: Scenario, question: Question, found: Sequence[Found]) -> dict[str, Any]:
    """Return the content of `limit.json`: settings, verdicts and evaluated values of all laws."""
    return {
        **about(scenario),
        **question._asdict(),
        "tolerance": question.resolution,
        "first_seed": scenario.seed,
        "laws": [{**_plain(each), "beside": each.beside and _plain(each.beside)} for each in found],
    }


def _plain(found: Found | Counterpart) -> dict[str, Any]:
    return {**found._asdict(), "tried": [tried.written for tried in found.tried]}


def figure(question: Question, found: Sequence[Found]) -> Figure:
    """Return a figure of success rate and interval versus the key, one panel per law. The limit interval is shaded."""
    drawn = Figure((PANEL_WIDTH_IN, 1.5 * len(found) + 0.6), layout="constrained")
    grid = drawn.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each, k in zip(grid, found, range(len(found)), strict=True):
        colour = SPARE_COLOURS[k % len(SPARE_COLOURS)]
        values = [t.value for t in each.tried]
        rates = [100 * (1 - t.failed / t.runs) for t in each.tried]
        lower = [rate - 100 * t.low for rate, t in zip(rates, each.tried, strict=True)]
        upper = [100 * t.high - rate for rate, t in zip(rates, each.tried, strict=True)]
        if each.interval:
            axes.axvspan(*each.interval, color="#DDDDDD", linewidth=0)
        axes.axhline(100 * question.reliability, color="black", linewidth=0.6, linestyle="--")
        # Rounding may make a bar slightly negative, which matplotlib rejects.
        bars = [[max(0.0, b) for b in lower], [max(0.0, b) for b in upper]]
        axes.errorbar(values, rates, bars, color=colour, marker="o", markersize=3, linewidth=0.9, capsize=2)
        axes.set(ylim=(-5, 105), title=each.law)
    drawn.supylabel(f"successful runs, {100 * question.confidence:.0f} % interval [%]", fontsize=8)
    grid[-1].set_xlabel(question.key)
    return drawn
