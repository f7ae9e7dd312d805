"""Runs for multilevel splitting. A run is identified by its seed and its branches, which are changes of the noise at
given ticks."""

from collections.abc import Callable, Generator, Sequence
from math import inf
from typing import NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.randomness import stream
from agrobot_mj.extensions.search.closeness import Closeness, Rises
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.risk.splitting import RiskQuestion, Split, Wanted, split_paths
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.branching import EVERY, Branch
from agrobot_mj.studies import Row, RunTasks, Task
from agrobot_mj.studies.engine.tasks import ERROR

AHEAD_S = 1.0
"""Time over which an increase of the margin is extrapolated [s]. Assumed value (range 0.5-2): time in which a heading
error causes a lateral offset."""


class Run(NamedTuple):
    """Simulated run that serves as a path of the splitting algorithm."""

    seed: int
    branches: tuple[Branch, ...]
    rises: tuple[tuple[int, float], ...]  # Tick number and margin of each new maximum of the margin
    ticks: int
    failed: bool
    flaw: str = ""  # Reason for a failure that does not appear in the margin: the outcome, or a metric without a value

    @property
    def level(self) -> float:
        """Maximum failure margin of the run [-], or infinity for a failed run."""
        return inf if self.failed else self.rises[-1][1]

    def above(self, level: float) -> int:
        """Return the first tick at which the margin exceeds `level`, or else the last tick."""
        return next((tick for tick, close in self.rises if close > level), self.ticks)

    @property
    def begun(self) -> int:
        """Number of ticks taken over from another run by restoring its stored state instead of simulating."""
        return self.branches[-1].tick // EVERY * EVERY if self.branches else 0


class Population:
    """One execution of the splitting algorithm with its simulated runs. The random numbers depend on the scenario seed
    and on the `number` of the execution."""

    def __init__(self, scenario: Scenario, q: RiskQuestion, number: int) -> None:
        self.number, self.runs = number, list[Run]()
        self.split: Split | None = None
        self._seeds = iter(range(scenario.seed + number * q.particles, scenario.seed + (number + 1) * q.particles))
        random = stream(scenario.seed, f"risk.{number}")
        self._work: Generator[list[Wanted[Run]], list[Run], Split] = split_paths(q.particles, q.worst, q.least, random)
        self._given: list[Run | None] = []
        self._branched = 0
        self._want(next(self._work))

    def _want(self, wanted: list[Wanted[Run]]) -> None:
        """Determine which of the requested runs must be simulated. A parent that exceeds the level only at its last
        tick is reused unchanged."""
        self._given = [parent if parent and parent.above(level) >= parent.ticks else None for parent, level in wanted]
        self.due = [self._begin_copy(*each) for each, known in zip(wanted, self._given, strict=True) if not known]

    def _begin_copy(self, parent: Run | None, level: float) -> tuple[int, tuple[Branch, ...]]:
        """Return the seed and the branches of a copy of `parent` up to `level`, or of a new run if `parent` is None."""
        if parent is None:
            return next(self._seeds), ()
        tick, self._branched = parent.above(level), self._branched + 1
        before = (branch for branch in parent.branches if branch.tick < tick)
        return parent.seed, (*before, Branch(tick, self.number << 32 | self._branched))

    def take(self, driven: Sequence[Run]) -> None:
        """Continue splitting with simulated runs, in the requested order. Update `due`, or set `split` at the end."""
        self.runs += driven
        fresh = iter(driven)
        try:
            self._want(self._work.send([known or next(fresh) for known in self._given]))
        except StopIteration as end:
            self.split, self.due = end.value, []


def populations(
    scenario: Scenario, q: RiskQuestion, condition: Condition, do: RunTasks, done: Callable[[Population], object]
) -> list[Population]:
    """Execute the splitting algorithm `q.repeats` times and return all executions. The executions advance together, so
    that many runs can be simulated in parallel.

    Raises `ScenarioError` if every initial run raises an error, which is not a failure of the tractor.
    """
    rises = Rises(Closeness(q.until, q.score), 0.0 if q.score else AHEAD_S)
    found = [Population(scenario, q, number) for number in range(q.repeats)]
    while going := [each for each in found if each.split is None]:
        due = [one for each in going for one in each.due]
        tasks = [Task.of(scenario, {"seed": seed}, measure=rises, branches=branches) for seed, branches in due]
        rows = do(tasks)
        errors = [row["error"] for row in rows if row["outcome"] == ERROR]
        if len(errors) == len(rows) and not found[0].runs:
            raise ScenarioError(
                f"{scenario.name}: every run raised an error, so the risk is unknown; fix this error: {errors[0]}"
            )
        driven = iter([_run_of_row(*one, row, condition) for one, row in zip(due, rows, strict=True)])
        for each in going:
            each.take([next(driven) for _ in each.due])
            if each.split:
                done(each)
    return found


def _run_of_row(seed: int, branches: tuple[Branch, ...], numbers: Row, condition: Condition) -> Run:
    rises = tuple((int(tick), float(close)) for tick, close in numbers.get("rises", [[0, -inf]]))
    missing = [name for name in condition.compared if numbers.get(name) is None]
    told = numbers["expected"] or (condition.names_outcome and numbers["outcome"] != ERROR)
    ended = "" if told else numbers["outcome"]
    flaw = ended or ", ".join(f"without {name}" for name in missing)
    return Run(seed, branches, rises, int(numbers.get("ticks", 0)), condition.fails(numbers), flaw)
