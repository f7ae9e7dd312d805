"""What is asked of a risk, and what the repeated splittings say: `RiskQuestion`, `RiskEstimate`."""

from collections.abc import Sequence
from math import exp, fsum, isfinite, sqrt
from typing import NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.studies.risk.splitting import Split
from agrobot_mj.studies.statistics import wilson_interval

CONFIDENCE = 0.95
"""Confidence of the interval [-]."""


class RiskQuestion(NamedTuple):
    """What is to be found."""

    until: str
    """Condition at which a run counts as failed."""
    particles: int = 50
    """Runs that are split together [-]."""
    repeats: int = 10
    """Independent splittings, whose spread gives the interval [-]."""
    score: str | None = None
    """Signal whose magnitude says how close a run is; that of the condition's metrics if None."""
    least: float = 1e-6
    """Probability below which a failure is not sought [-]."""

    @property
    def worst(self) -> int:
        """Runs that die in a round, at least: a tenth, so that several can be driven at a time."""
        return max(1, self.particles // 10)

    def check(self) -> None:
        """Raise `ScenarioError` unless it can be asked."""
        if self.particles < 2 or self.repeats < 2:
            raise ScenarioError("--particles and --repeats must be 2 or more")
        if not (isfinite(self.least) and 0 < self.least < 1):
            raise ScenarioError(f"--least must be between 0 and 1, got {self.least:g}")


class RiskEstimate(NamedTuple):
    """A probability with its interval."""

    probability: float
    """Mean of the splittings, without bias [-]."""
    low: float
    """Lower end of the 95 % interval [-]."""
    high: float
    """Upper end [-]."""
    error: float
    """Standard error of the mean [-]."""


def estimate(splits: Sequence[Split], particles: int) -> RiskEstimate:
    """The mean of independent splittings with its interval.

    Where no run was split the interval is Wilson's; where none failed its upper end is that of Wilson for the runs of
    the last rounds, times their weight.
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
    """The mean of independent estimates; its interval is Student's for the logarithm of the mean.

    The estimates are skewed as their logarithm is not, and none is below 0.
    """
    from scipy.stats import t

    n, mean = len(values), fsum(values) / len(values)
    error = sqrt(fsum((value - mean) ** 2 for value in values) / (n - 1) / n)
    spread = exp(float(t.ppf((1 + CONFIDENCE) / 2, n - 1)) * error / mean) if mean else 1.0
    return RiskEstimate(mean, mean / spread, min(mean * spread, 1.0), error)
