"""What is asked of a falsification, and what is found: `Varied`, `FalsifyQuestion`, `Combination`, `Falsified`."""

from math import hypot, isfinite
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies.limit.question import as_value

FARTHEST = 4.0
"""Standard deviations from the mean within which a key with a spread is varied [-]: one in 16,000 lies outside."""
FEWEST = 20
"""Least number of combinations of a search [-]."""
NOT_FOUND = "not_found"
"""Verdict where no combination fails."""


class Varied(NamedTuple):
    """A key that is varied, and its unit of distance: a range from mild to hard, or a standard deviation."""

    key: str
    start: float
    """Value at the distance 0: the mild end, or the mean."""
    unit: float
    """What the value changes by over a distance of 1: the width of the range, or the standard deviation."""
    low: float = 0.0
    """Least distance [-]."""
    high: float = 1.0
    """Largest distance [-]."""

    def at(self, distance: float) -> float:
        """The value at a distance [-]."""
        return self.start + self.unit * distance

    @property
    def hardest(self) -> float:
        """Distance of the value that is farthest from the start [-]."""
        return max(self.low, self.high, key=abs)

    @classmethod
    def ranged(cls, key: str, mild: float, hard: float) -> "Varied":
        """A key over a range. Raises `ScenarioError`."""
        if not (isfinite(mild) and isfinite(hard) and isfinite(hard - mild)) or mild == hard:
            raise ScenarioError(f"--vary {key}={mild:g}:{hard:g}: name two different numbers, first the mild one")
        return cls(key, mild, hard - mild)

    @classmethod
    def spread(cls, key: str, mean: float, deviation: float) -> "Varied":
        """A key with a mean and a standard deviation. Raises `ScenarioError`."""
        if not (isfinite(mean) and isfinite(deviation) and deviation > 0):
            raise ScenarioError(f"--vary {key}: normal = [mean, standard deviation], the second above 0")
        return cls(key, mean, deviation, -FARTHEST, FARTHEST)


class FalsifyQuestion(NamedTuple):
    """What is to be found."""

    varied: tuple[Varied, ...]
    until: str
    """Condition at which a run counts as failed."""
    budget: int = 150
    """Combinations of the search [-]."""
    seeds: int = 3
    """Runs of a combination, which fails if more than half of them do [-]."""
    score: str | None = None
    """Signal whose magnitude says how close a run is; that of the condition's metrics if None."""

    def check(self, scenario: Scenario) -> None:
        """Raise `ScenarioError` unless it can be asked of a scenario."""
        keys = [each.key for each in self.varied]
        if not keys or len(set(keys)) < len(keys):
            raise ScenarioError("--vary: name each key once, as --vary KEY=MILD:HARD")
        if self.budget < FEWEST or self.seeds < 1:
            raise ScenarioError(f"--budget must be {FEWEST} or more, --seeds 1 or more")
        for each in self.varied:
            for end in (each.low, each.high):
                scenario.changed({each.key: as_value(scenario, each.key, each.at(end))})

    def overrides(self, scenario: Scenario, distances: tuple[float, ...]) -> dict[str, Any]:
        """The values at these distances, one for each key."""
        pairs = zip(self.varied, distances, strict=True)
        return {each.key: as_value(scenario, each.key, each.at(distance)) for each, distance in pairs}


class Combination(NamedTuple):
    """The runs of one combination."""

    distances: tuple[float, ...]
    """Distance of each key from where it is mild, in its unit [-]."""
    values: dict[str, Any]
    """Values of the keys."""
    runs: int
    failed: int
    close: float
    """Median of how close the runs came to the condition [-]."""

    @property
    def fails(self) -> bool:
        """Whether more than half of the runs failed."""
        return 2 * self.failed > self.runs

    @property
    def distance(self) -> float:
        """Distance from where all keys are mild [-]."""
        return hypot(*self.distances)

    @property
    def shown(self) -> str:
        """The values as overrides."""
        return ", ".join(f"{key}={value:g}" for key, value in self.values.items())

    @property
    def share(self) -> str:
        """How many of how many runs fail."""
        return f"{self.failed} of {self.runs}"


class Falsified(NamedTuple):
    """The answer."""

    verdict: str
    """`falsified`, `fails_at_start`, or `NOT_FOUND`."""
    mildest: Combination
    """The mildest combination that fails, driven with more seeds; the closest one where none fails."""
    alone: dict[str, Combination]
    """Each key at the hard end of its range, the others where they are mild."""
    around: tuple[Combination, ...]
    """Combinations about the mildest: on the way to it and beyond, and with each key a little less and more."""
    tried: tuple[Combination, ...]
    """All combinations of the search, in their order."""
    statement: str
    """The answer as a sentence."""
