"""The probability of a rare failure by adaptive multilevel splitting [Cerou2007]: question, algorithm, and estimate.

Each run has a level, the highest score that it reached; one that failed has an infinite one. In a round the lowest of n
runs die, and each is replaced by a copy of a survivor up to the first moment at which that was above the level of the
dead, from where it continues by noise of its own. A round in which k runs die leaves (n - k) / n of the weight.

In discrete time, and with scores that repeat, the estimate has no bias, whatever n, the score, or the rule to stop, if
two inequalities are strict [Brehier2016]: all runs at or below the level die, however many they are, and a copy goes
its own way from a score above it, not at it. Where none survives the estimate is 0.
"""

from collections.abc import Generator, Sequence
from math import exp, fsum, inf, isfinite, sqrt
from typing import NamedTuple, Protocol, TypeVar

from numpy.random import Generator as Random

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.studies.statistics import wilson_interval


class Leveled(Protocol):
    """A path of the process."""

    @property
    def level(self) -> float:
        """Highest score reached; infinite for a failed path."""
        ...


P = TypeVar("P", bound=Leveled)
Wanted = tuple[P | None, float]
"""Path to be simulated: a copy of this one up to its first score above this level, or a new one (None)."""


class Split(NamedTuple):
    """Result of a splitting."""

    probability: float
    """Estimate of the probability of failure, without bias [-]."""
    weight: float
    """Product of the fractions that survived the rounds; the fraction of `failed` among the paths is the rest [-]."""
    failed: int
    """Number of failed trajectories among those that reached the last level."""
    trace: tuple[tuple[float, float], ...]
    """Level of each round, and the weight behind it: the chance to come above that level [-]."""
    paths: int
    """Number of simulated paths, including those of the beginning."""


def split(n: int, worst: int, least: float, random: Random) -> Generator[list[Wanted[P]], list[P], Split]:
    """Split n paths, of which at least `worst` are dropped per round, until fewer than that have not failed.

    Yields the paths to simulate and receives them in the same order. Also ends if none survives, and if the weight is
    below `least`.
    """
    paths = yield [(None, -inf)] * n
    weight, trace, driven = 1.0, list[tuple[float, float]](), n
    while paths and weight >= least:
        level = sorted(path.level for path in paths)[worst - 1]
        if level == inf:
            break
        alive = [path for path in paths if path.level > level]
        weight *= len(alive) / n
        trace.append((level, weight))
        if alive:
            chosen = random.integers(len(alive), size=n - len(alive))
            alive += yield [(alive[k], level) for k in chosen]
            driven += len(chosen)
        paths = alive
    failed = sum(path.level == inf for path in paths)
    return Split(weight * failed / n, weight, failed, tuple(trace), driven)


CONFIDENCE = 0.95
"""Confidence of the interval [-]."""


class RiskQuestion(NamedTuple):
    """Question of a risk estimation."""

    until: str
    """Condition at which a run counts as failed."""
    particles: int = 50
    """Number of runs that are split together [-]."""
    repeats: int = 10
    """Number of independent splittings, whose spread gives the interval [-]."""
    score: str | None = None
    """Signal whose magnitude is the margin of a run; None for that of the condition's metrics."""
    least: float = 1e-6
    """Probability below which the search ends [-]."""

    @property
    def worst(self) -> int:
        """Minimum number of runs dropped per round: a tenth, so that several run in parallel."""
        return max(1, self.particles // 10)

    def check(self) -> None:
        """Raise `ScenarioError` for an invalid question."""
        if self.particles < 2 or self.repeats < 2:
            raise ScenarioError("--particles and --repeats must be 2 or more")
        if not (isfinite(self.least) and 0 < self.least < 1):
            raise ScenarioError(f"--least must be between 0 and 1, got {self.least:g}")


class RiskEstimate(NamedTuple):
    """Probability with its interval."""

    probability: float
    """Mean of the splittings, without bias [-]."""
    low: float
    """Lower end of the 95 % interval [-]."""
    high: float
    """Upper end [-]."""
    error: float
    """Standard error of the mean [-]."""


def estimate(splits: Sequence[Split], particles: int) -> RiskEstimate:
    """Return the mean of independent splittings with its interval.

    Without splitting the interval is Wilson's; without failures its upper end is Wilson's for the runs of the last
    rounds, times their weight.
    """
    n, found = len(splits), mean_of([split.probability for split in splits])
    if not any(split.trace for split in splits):
        runs = n * particles
        low, high = wilson_interval(sum(split.failed for split in splits), runs, CONFIDENCE)
        return found._replace(low=low, high=high, error=sqrt(found.probability * (1 - found.probability) / runs))
    if found.probability:
        return found
    weight = fsum(min((weight for _, weight in split.trace if weight), default=1.0) for split in splits) / n
    return found._replace(high=weight * wilson_interval(0, n * particles, CONFIDENCE)[1])


def mean_of(values: Sequence[float]) -> RiskEstimate:
    """Return the mean of independent estimates; its interval is Student's for the logarithm of the mean.

    The estimates are skewed, their logarithm is not, and none is below 0.
    """
    from scipy.stats import t

    n, mean = len(values), fsum(values) / len(values)
    error = sqrt(fsum((value - mean) ** 2 for value in values) / (n - 1) / n)
    spread = exp(float(t.ppf((1 + CONFIDENCE) / 2, n - 1)) * error / mean) if mean else 1.0
    return RiskEstimate(mean, mean / spread, min(mean * spread, 1.0), error)
