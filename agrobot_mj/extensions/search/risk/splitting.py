"""Probability of a rare failure by adaptive multilevel splitting [Cerou2007]: settings, algorithm, and estimate.

The level of a path (a simulated run) is the maximum score that it has reached, and infinite for a failed path. In each
round, the lowest of n paths are dropped. Each dropped path is replaced by a copy of a surviving path up to the time at
which the surviving path first exceeded the level of the dropped path. The copy then continues with different noise. If
k paths are dropped, the weight is multiplied by (n - k) / n.

With discrete time and equal scores, the estimate is unbiased for any n, score and stopping rule under two conditions
[Brehier2016]: all paths at or below the level are dropped, and a copy branches from a score strictly above the level.
The estimate is 0 if no path survives.
"""

from collections import Counter
from collections.abc import Generator, Sequence
from itertools import compress
from math import exp, fsum, inf, isfinite, sqrt
from typing import NamedTuple, Protocol, TypeVar

from numpy.random import Generator as Random

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.studies.statistics import wilson_interval


class Leveled(Protocol):
    """Interface of a path, which is one realisation of the random process, for example a simulated run."""

    @property
    def level(self) -> float:
        """Maximum score that the path has reached, or infinity for a failed path."""
        ...


P = TypeVar("P", bound=Leveled)
Wanted = tuple[P | None, float]
"""Path to simulate: parent path and level above which the copy branches. The parent of a new path is None."""


class Split(NamedTuple):
    """Result of one execution of the splitting algorithm, which is one estimate of the failure probability."""

    probability: float  # Unbiased estimate of the probability of failure [-]
    weight: float  # Product of the surviving fractions of all rounds [-]
    failed: int  # Number of failed paths among the paths that reached the last level
    trace: tuple[tuple[float, float], ...]
    """Level of each round and weight after the round, which estimates the probability of exceeding the level [-]."""
    paths: int  # Number of simulated paths, including the initial ones
    families: tuple[int, ...] = ()
    """Number of failed paths that descend from the same initial path, for each initial path with such descendants."""


def split_paths(n: int, worst: int, least: float, random: Random) -> Generator[list[Wanted[P]], list[P], Split]:
    """Estimate the probability of failure by splitting n paths. At least `worst` paths are dropped per round.

    Yields the paths to simulate and receives the simulated paths in the same order. The splitting ends when fewer than
    `worst` paths have not failed, when no path survives a round, or when the weight is below `least`.
    """
    paths = yield [(None, -inf)] * n
    weight, trace, driven, roots = 1.0, list[tuple[float, float]](), n, list(range(n))
    while paths and weight >= least:
        level = sorted(path.level for path in paths)[worst - 1]
        if level == inf:
            break
        above = [path.level > level for path in paths]
        alive, roots = list(compress(paths, above)), list(compress(roots, above))
        weight *= len(alive) / n
        trace.append((level, weight))
        if alive:
            chosen = random.integers(len(alive), size=n - len(alive))
            alive += yield [(alive[k], level) for k in chosen]
            roots += [roots[k] for k in chosen]
            driven += len(chosen)
        paths = alive
    families = Counter(root for root, path in zip(roots, paths, strict=True) if path.level == inf)
    failed = families.total()
    return Split(weight * failed / n, weight, failed, tuple(trace), driven, tuple(families.values()))


CONFIDENCE = 0.95  # Confidence of the interval [-]
TAIL = (1 - CONFIDENCE) / 2  # Probability on each side of the interval [-]


class RiskQuestion(NamedTuple):
    """Settings of a risk estimation."""

    until: str
    particles: int = 50  # Number of runs that are split together
    repeats: int = 10  # Number of independent splittings. The interval follows from their spread.
    score: str | None = None
    """Signal whose maximum magnitude is the margin of a run. Default: margin from the metrics in `until`."""
    least: float = 1e-6  # Weight below which a splitting ends [-]

    @property
    def worst(self) -> int:
        """Minimum number of runs dropped per round: a tenth, so that several runs can be simulated in parallel."""
        return max(1, self.particles // 10)

    def check(self) -> None:
        """Raise `ScenarioError` for invalid settings."""
        if self.particles < 2 or self.repeats < 2:
            raise ScenarioError("--particles and --repeats must be 2 or more")
        if not (isfinite(self.least) and 0 < self.least < 1):
            raise ScenarioError(f"--least must be between 0 and 1, got {self.least:g}")


class RiskEstimate(NamedTuple):
    """Failure probability with its interval."""

    probability: float  # Mean of the splittings [-], which is unbiased
    low: float  # Lower end of the 95 % interval [-]
    high: float  # Upper end of the 95 % interval [-]
    error: float  # Standard error of the mean [-]


def estimate(splits: Sequence[Split], particles: int) -> RiskEstimate:
    """Return the mean failure probability of independent executions of the splitting algorithm, with its interval.

    If no splitting was necessary, the interval is a Wilson interval. Without failures, the upper end is the upper end
    of a Wilson interval for the runs of the last rounds, multiplied by the weight of these runs.
    """
    n, found = len(splits), mean_of([split.probability for split in splits])
    if not any(split.trace for split in splits):
        runs = n * particles
        low, high = wilson_interval(sum(split.failed for split in splits), runs, CONFIDENCE)
        return found._replace(low=low, high=high, error=sqrt(found.probability * (1 - found.probability) / runs))
    if found.probability:
        return _widen_interval(found, [split.weight * failed for split in splits for failed in split.families])
    weight = fsum(min((weight for _, weight in split.trace if weight), default=1.0) for split in splits) / n
    return found._replace(high=weight * wilson_interval(0, n * particles, CONFIDENCE)[1])


def _widen_interval(found: RiskEstimate, families: Sequence[float]) -> RiskEstimate:
    """Return an estimate whose interval also contains a Poisson interval for the number of independent families.

    A family contains the failed paths with the same initial path, which share the values drawn once per run. If few
    families have most of the weight, the spread of the splittings is usually too small. `families` are the weights of
    all families. Their effective number is the sum of the weights divided by the maximum weight.
    """
    from scipy.stats import chi2

    if not families:
        return found
    count = fsum(families) / max(families)
    low, high = (float(chi2.ppf(p, 2 * n)) / 2 / count for p, n in ((TAIL, count), (1 - TAIL, count + 1)))
    p = found.probability
    return found._replace(low=min(found.low, low * p), high=max(found.high, min(high * p, 1.0)))


def mean_of(values: Sequence[float]) -> RiskEstimate:
    """Return the mean of independent probability estimates. Its interval is a Student t interval of the logarithm."""
    from scipy.stats import t

    n, mean = len(values), fsum(values) / len(values)
    error = sqrt(fsum((value - mean) ** 2 for value in values) / (n - 1) / n)
    spread = exp(float(t.ppf((1 + CONFIDENCE) / 2, n - 1)) * error / mean) if mean else 1.0
    return RiskEstimate(mean, mean / spread, min(mean * spread, 1.0), error)
