"""Shares of a variance with their intervals, and the ranks that follow from them: `Share`, `Influence`."""

from collections.abc import Sequence
from typing import NamedTuple

CONFIDENCE = 0.95
"""Confidence of the intervals of all draws of a group at once [-]."""


class Share(NamedTuple):
    """Share of one draw in the variance of a metric, interactions included."""

    key: str
    share: float
    """Estimate [-]: its total index, or the square of its slope in a screening."""
    low: float
    """Lower end of the interval that holds for all draws at once [-]."""
    high: float
    """Upper end [-]; of a screening with all that the regression leaves unexplained."""
    effect: float
    """First-order index, or the standardised slope of the regression [-]."""
    half: float
    """Half of the interval of `effect` [-]."""
    correlation: float | None = None
    """Rank correlation with the metric, of a screening [-]."""
    best: int = 1
    """Smallest rank that the intervals allow."""
    worst: int = 1
    """Largest rank that they allow."""

    @property
    def rank(self) -> str:
        """Rank as text, a range where the intervals overlap."""
        return str(self.best) if self.best == self.worst else f"{self.best}-{self.worst}"


class Influence(NamedTuple):
    """The shares of all draws in one group: a variant and a value of each axis."""

    group: str
    mean: float
    """Mean of the metric."""
    deviation: float
    """Its standard deviation over the points of the design, each averaged over its seeds."""
    noise: float | None
    """Share of that variance that seeds still cause after averaging [-]; None with one seed."""
    unexplained: float | None
    """Share of the variance that the regression leaves, without noise, upper limit [-]; None of Sobol indices."""
    flaws: tuple[str, ...]
    """Why the intervals cannot be trusted, and there is no ranking; empty if they can."""
    shares: tuple[Share, ...]
    """Shares by rank; tied ones in the order of the file."""

    @property
    def ordered_pairs(self) -> int:
        """Number of pairs of draws whose order the samples determine."""
        return sum(share.best - 1 for share in self.shares)

    @property
    def pairs(self) -> int:
        """Number of pairs of draws."""
        return len(self.shares) * (len(self.shares) - 1) // 2


def ranked(shares: Sequence[Share], trusted: bool) -> tuple[Share, ...]:
    """The shares with their ranks, in the order of these; all tied where the intervals are not to be trusted.

    One draw ranks above another only if its interval lies above that of the other.
    """
    found = []
    for share in shares:
        above = sum(other.low > share.high for other in shares) if trusted else 0
        below = sum(share.low > other.high for other in shares) if trusted else 0
        found.append(share._replace(best=1 + above, worst=len(shares) - below))
    return tuple(sorted(found, key=lambda share: (share.best, share.worst)))
