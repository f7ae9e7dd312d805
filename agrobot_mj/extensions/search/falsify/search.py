"""Search for the smallest failing combination of changes, by differential evolution and bisection towards mild values.

Failing combinations rank first, ordered by their distance from the mild values. The other combinations are ordered by
their margin to failure. The distance of each key is in units of the width of its range or of its standard deviation.
"""

from collections.abc import Callable, Sequence
from math import ceil, hypot, isfinite
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.search.closeness import Closeness, Rises
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.question import as_value
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies import Row, RunTasks, Task

FARTHEST = 4.0
"""Maximum distance of a value from its mean [standard deviations]. One in 16,000 values has a larger distance."""
FEWEST = 20  # Minimum number of combinations in a search
NOT_FOUND = "not_found"  # Verdict of a search without a failing combination


class Varied(NamedTuple):
    """Key that the search varies. Its distance from the start value is measured in widths of its range, or in standard
    deviations."""

    key: str
    start: float  # Value at distance 0: the mild end of the range, or the mean
    unit: float  # Change of the value per unit of distance: the width of the range, or the standard deviation
    low: float = 0.0  # Minimum distance from `start` [-]
    high: float = 1.0  # Maximum distance from `start` [-]

    def at(self, distance: float) -> float:
        """Return the value of the key at a distance from `start`, given in multiples of `unit` [-]."""
        return self.start + self.unit * distance

    @property
    def hardest(self) -> float:
        """Distance from `start` to the hard end of the range, in multiples of `unit` [-]."""
        return max(self.low, self.high, key=abs)

    @classmethod
    def in_range(cls, key: str, mild: float, hard: float) -> "Varied":
        """Return a varied key with the range from `mild` to `hard`. Raises `ScenarioError` for invalid ends of the
        range."""
        if not (isfinite(mild) and isfinite(hard) and isfinite(hard - mild)) or mild == hard:
            raise ScenarioError(f"--vary {key}={mild:g}:{hard:g}: specify two different numbers, the mild one first")
        return cls(key, mild, hard - mild)

    @classmethod
    def spread(cls, key: str, mean: float, deviation: float) -> "Varied":
        """Return a varied key with a normal distribution. Raises `ScenarioError` for an invalid mean or standard
        deviation."""
        if not (isfinite(mean) and isfinite(deviation) and deviation > 0):
            raise ScenarioError(f"--vary {key}: specify normal = [mean, standard deviation], with a deviation above 0")
        return cls(key, mean, deviation, -FARTHEST, FARTHEST)


class FalsifyQuestion(NamedTuple):
    """Settings of a falsification, which searches for the smallest failing change of a scenario."""

    varied: tuple[Varied, ...]
    until: str
    budget: int = 150  # Number of combinations to evaluate
    seeds: int = 3  # Number of runs of each combination. A combination fails if more than half of its runs fail.
    score: str | None = None
    """Signal whose maximum magnitude is the margin of a run. Default: margin from the metrics in `until`."""

    def check(self, scenario: Scenario) -> None:
        """Raise `ScenarioError` for settings that are invalid for a scenario."""
        keys = [each.key for each in self.varied]
        if not keys or len(set(keys)) < len(keys):
            raise ScenarioError("--vary: specify one or more keys, and each key once: --vary KEY=MILD:HARD")
        if self.budget < FEWEST or self.seeds < 1:
            raise ScenarioError(f"--budget must be {FEWEST} or more, --seeds 1 or more")
        for each in self.varied:
            for end in (each.low, each.high):
                scenario.changed({each.key: as_value(scenario, each.key, each.at(end))})

    def overrides(self, scenario: Scenario, distances: tuple[float, ...]) -> dict[str, Any]:
        """Return the scenario overrides for the given distances of the varied keys from their mild values."""
        pairs = zip(self.varied, distances, strict=True)
        return {each.key: as_value(scenario, each.key, each.at(distance)) for each, distance in pairs}


class Combination(NamedTuple):
    """Evaluated combination of values of the varied keys."""

    distances: tuple[float, ...]  # Distance of each key from its mild value, in units of the key [-]
    values: dict[str, Any]
    runs: int
    failed: int
    close: float  # Median margin to the failure condition [-]: the maximum margin of each run, median over the runs

    @property
    def fails(self) -> bool:
        """Whether more than half of the runs failed."""
        return 2 * self.failed > self.runs

    @property
    def distance(self) -> float:
        """Distance from the combination of all mild values [-]."""
        return hypot(*self.distances)

    @property
    def shown(self) -> str:
        """Values of the varied keys as text, for example `path.speed_m_s=2.1`."""
        return ", ".join(f"{key}={value:g}" for key, value in self.values.items())

    @property
    def share(self) -> str:
        """Number of failed runs and number of all runs as text, for example `2 of 3`."""
        return f"{self.failed} of {self.runs}"


class Falsified(NamedTuple):
    """Result of a falsification."""

    verdict: str
    mildest: Combination
    """Smallest failing combination, confirmed with more seeds. If no combination fails, the combination with the
    maximum margin."""
    alone: dict[str, Combination]
    """Combinations with one key at its hard end and all other keys at their mild values, by key."""
    around: tuple[Combination, ...]
    """Neighbours of the mildest failure: on the line from the mild values, and with one key changed."""
    tried: tuple[Combination, ...]
    statement: str


HALVINGS = 6  # Number of bisection steps; the final resolution is 1/64 of the distance
CONFIRMED = 10  # Number of runs of the result, of combinations on the line to the result, and of its neighbours
MOST_CONFIRMED = 10  # Approximate number of failing combinations, from mild to hard, that are repeated with more seeds
NEAR = 0.1  # Step from the result to a neighbour, divided by the distance of the result or by the unit of a key [-]
Place = tuple[float, ...]


class FalsifySearch:
    """Search for the smallest failing combination of changes."""

    def __init__(
        self,
        scenario: Scenario,
        q: FalsifyQuestion,
        condition: Condition,
        do: RunTasks,
        done: Callable[[Combination], object],
    ) -> None:
        self.scenario, self.q, self.condition, self.do, self.done = scenario, q, condition, do, done
        self.tried: list[Combination] = []

    def run(self) -> Falsified:
        """Search for the mildest failing combination, evaluate its neighbours, and return the result."""
        mild = (0.0,) * len(self.q.varied)
        start, *alone = self.drive([mild, *self._alone()], self.q.seeds)
        by_key = {each.key: tried for each, tried in zip(self.q.varied, alone, strict=True)}
        if start.fails:
            return self._answer("fails_at_start", start, by_key, ())
        self._evolve()
        failing = [tried for tried in self.tried if tried.fails]
        if not failing:
            return self._answer(NOT_FOUND, max(self.tried, key=lambda tried: tried.close), by_key, ())
        sure = self._confirm(sorted(failing, key=lambda tried: tried.distance))
        if not sure.fails:
            return self._answer(NOT_FOUND, sure, by_key, ())
        best = self._bisect(sure)
        around = self.drive(self._around(best), CONFIRMED, noted=False)
        return self._answer("falsified", best, by_key, tuple(around))

    def drive(self, places: Sequence[Place], seeds: int, noted: bool = True) -> list[Combination]:
        """Simulate combinations with several seeds and return the results, which are added to `tried` if `noted`."""
        task = Task.of(self.scenario, measure=Rises(Closeness(self.q.until, self.q.score)))
        values = [self.q.overrides(self.scenario, place) for place in places]
        tasks = [
            task._replace(overrides={**each, "seed": self.scenario.seed + k}) for each in values for k in range(seeds)
        ]
        rows = iter(self.do(tasks))
        found = [self._try_all(each, [next(rows) for _ in range(seeds)]) for each in values]
        self.tried += found if noted else []
        for each in found:
            self.done(each)
        return found

    def _try_all(self, values: dict[str, float], rows: Sequence[Row]) -> Combination:
        close = [float(row["rises"][-1][1]) if row.get("rises") else 0.0 for row in rows]
        place = tuple((values[each.key] - each.start) / each.unit for each in self.q.varied)
        return Combination(place, values, len(rows), sum(map(self.condition.fails, rows)), median(close))

    def _alone(self) -> list[Place]:
        n = len(self.q.varied)
        return [tuple(each.hardest if j == k else 0.0 for j in range(n)) for k, each in enumerate(self.q.varied)]

    def _evolve(self) -> None:
        """Run differential evolution [Storn1997] from a Latin hypercube and the combination of all `hardest` values."""
        from scipy.optimize import differential_evolution
        from scipy.stats import qmc

        n, random = len(self.q.varied), stream(self.scenario.seed, "falsify")
        size = max(10, 3 * n)
        low, high = (np.array(ends) for ends in zip(*[(v.low, v.high) for v in self.q.varied], strict=True))
        first = low + (high - low) * qmc.LatinHypercube(n, rng=random).random(size)
        first[0] = [each.hardest for each in self.q.varied]
        worst = float(np.hypot.reduce(np.maximum(np.abs(low), np.abs(high))))

        def cost(points: Array) -> Array:
            tried = self.drive([tuple(map(float, point)) for point in points.T], self.q.seeds)
            return np.array([each.distance if each.fails else worst + 1.0 - min(each.close, 0.0) for each in tried])

        differential_evolution(
            cost,
            list(zip(low, high, strict=True)),
            init=first,
            maxiter=max(ceil(self.q.budget / size) - 1, 1),
            rng=random,
            polish=False,
            updating="deferred",
            vectorized=True,
            strategy="best1bin",
            tol=1e-3,
        )

    def _confirm(self, failing: Sequence[Combination]) -> Combination:
        """Return the smallest combination that also fails with more seeds, or the last tested combination if none
        fails."""
        for tried in [*failing[:: max(len(failing) // MOST_CONFIRMED, 1)], failing[-1]]:
            (sure,) = self.drive([tried.distances], CONFIRMED, noted=False)
            if sure.fails:
                break
        return sure

    def _bisect(self, best: Combination) -> Combination:
        """Return the smallest failing combination on the line from the mild values to `best`, found by bisection."""
        low, high, mildest = 0.0, 1.0, best
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            (tried,) = self.drive([tuple(middle * d for d in best.distances)], CONFIRMED, noted=False)
            low, high = (low, middle) if tried.fails else (middle, high)
            mildest = tried if tried.fails else mildest
        return mildest

    def _around(self, best: Combination) -> list[Place]:
        """Return neighbours of `best` within the ranges: on the line through `best`, and with one key changed."""
        at, ways = best.distances, [1 - 2 * NEAR, 1 - NEAR, 1 + NEAR, 1 + 2 * NEAR]
        places = [tuple(way * d for d in at) for way in ways]
        for k in range(len(at)):
            places += [(*at[:k], at[k] + step, *at[k + 1 :]) for step in (-NEAR, NEAR)]
        return [
            tuple(min(max(d, each.low), each.high) for d, each in zip(place, self.q.varied, strict=True))
            for place in places
        ]

    def _answer(
        self, verdict: str, mildest: Combination, alone: dict[str, Combination], around: tuple[Combination, ...]
    ) -> Falsified:
        found = Falsified(verdict, mildest, alone, around, tuple(self.tried), "")
        return found._replace(statement=statement(self.q, self.scenario.name, found))


def statement(q: FalsifyQuestion, name: str, found: Falsified) -> str:
    """Return sentences with the result of a falsification of the scenario `name`."""
    best = found.mildest
    if found.verdict == "fails_at_start":
        return f"{name} fails at the mild ends of all ranges ({best.shown}: {best.share} runs fail); use milder values"
    if found.verdict == NOT_FOUND:
        closest = f"the closest is {best.shown} ({best.share} runs fail, margin {best.close:.2g}; 0 is failure)"
        return f"{name}: none of the {len(found.tried)} evaluated combinations fails in most runs; {closest}"
    text = f"{name}: the mildest failing combination found is {best.shown}, at a distance of {best.distance:.2f}"
    text += f" ({best.share} runs fail)"
    holds = [f"{key} = {tried.values[key]:g}" for key, tried in found.alone.items() if not tried.fails]
    fails = [f"{key} = {tried.values[key]:g}" for key, tried in found.alone.items() if tried.fails]
    if holds and len(q.varied) > 1:
        text += f". It succeeds with only {', '.join(holds)}" + (f", and fails at {', '.join(fails)}" if fails else "")
    return text
