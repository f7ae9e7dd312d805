"""Fractions of a metric's variance with their intervals and ranks, by regression or as Sobol indices.

Screening is a linear regression of the metric on all draws at once, standardised. Draws enter by their rank, which is
their quantile, so that a logarithmic range is as straight as a linear one. The square of a slope is the fraction of the
variance that a straight line in this draw explains: no more than the draw is responsible for. What all lines together
leave, noise of the seeds aside, may belong to any of them by a bend or an interaction: so much, and no more, is added
to the upper end of each. Standard errors are HC3 [MacKinnonWhite1985], which hold for points that scatter unevenly.

Of the Sobol indices [Saltelli2010] of a sweep of `method = "saltelli"`, by SALib, the first-order one of a draw is the
fraction of the variance that goes away once its value is known; the total one is the share that stays while only it is
unknown, interactions included. The sum of first-order indices is at most 1, and a total index near 0 means that the
number may stay an estimate. Intervals are by bootstrap.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm, rankdata, spearmanr, t

from agrobot_mj.core.errors import required
from agrobot_mj.core.signals import Array

CONFIDENCE = 0.95
"""Confidence of the intervals of all draws of a group at once [-]."""


class Share(NamedTuple):
    """Fraction of one draw in the variance of a metric, interactions included."""

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
    """Maximum rank that they allow."""

    @property
    def rank(self) -> str:
        """Rank as text, a range where the intervals overlap."""
        return str(self.best) if self.best == self.worst else f"{self.best}-{self.worst}"


class Influence(NamedTuple):
    """The fractions of all draws in one group: a variant and a value of each axis."""

    group: str
    mean: float
    deviation: float
    """Standard deviation over the points of the design, each averaged over its seeds."""
    noise: float | None
    """Fraction of that variance that seeds still cause after averaging [-]; None with one seed."""
    unexplained: float | None
    """Fraction of the variance that the regression leaves, without noise, upper limit [-]; None of Sobol indices."""
    flaws: tuple[str, ...]
    """Reason why the intervals are unreliable and there is no ranking; empty if reliable."""
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
    """Return the fractions with their ranks, in the given order; all tied if the intervals are unreliable.

    A draw ranks above another only if its interval is above that of the other.
    """
    found = []
    for share in shares:
        above = sum(other.low > share.high for other in shares) if trusted else 0
        below = sum(share.low > other.high for other in shares) if trusted else 0
        found.append(share._replace(best=1 + above, worst=len(shares) - below))
    return tuple(sorted(found, key=lambda share: (share.best, share.worst)))


class Regression(NamedTuple):
    """A linear regression on standardised columns."""

    slopes: Array
    """Standardised slopes, shape (d,) [-]."""
    errors: Array
    """Their standard errors, shape (d,) [-]."""
    left: float
    """Fraction of the variance that is left, upper limit at `CONFIDENCE` [-]."""


def screened(keys: Sequence[str], draws: Array, values: Array, noise: float) -> tuple[list[Share], float]:
    """Return the shares, and the part that is neither linear nor noise (upper limit); draws (n, d), values (n,)."""
    n, d = draws.shape
    ranks = rankdata(draws, axis=0)
    found = regression(_standard(ranks), _standard(values))
    halves = t.ppf(1.0 - (1.0 - CONFIDENCE) / (2 * d), n - d - 1) * found.errors
    left = min(1.0, max(0.0, found.left - noise))
    shares = [
        Share(
            key,
            share=float(slope**2),
            low=float(max(abs(slope) - half, 0.0) ** 2),
            high=float(min(1.0, (abs(slope) + half) ** 2 + left)),
            effect=float(slope),
            half=float(half),
            correlation=float(spearmanr(column, values).statistic),
        )
        for key, slope, half, column in zip(keys, found.slopes, halves, ranks.T, strict=True)
    ]
    return shares, left


def regression(x: Array, y: Array) -> Regression:
    """Return the least squares solution of y (n,) on x (n, d), both of mean 0 and variance 1."""
    n, d = x.shape
    inverse = np.linalg.pinv(x.T @ x)
    slopes = inverse @ x.T @ y
    rest = y - x @ slopes
    leverage = np.sum(x @ inverse * x, axis=1) + 1.0 / n
    scaled = rest / np.maximum(1.0 - leverage, 1e-6)
    covariance = inverse @ (x.T * scaled**2) @ x @ inverse
    left = float(rest @ rest / (y @ y)) * (n - 1) / float(chi2.ppf(1.0 - CONFIDENCE, n - d - 1))
    return Regression(slopes, np.sqrt(np.diag(covariance)), left)


def _standard(values: Array) -> Array:
    """Return the columns with mean 0 and variance 1; one that does not vary becomes 0."""
    away: Array = values - values.mean(axis=0)
    deviation = away.std(axis=0)
    found: Array = np.divide(away, deviation, out=np.zeros_like(away), where=deviation > 0.0)
    return found


RESAMPLES = 1000
"""Resamples of the bootstrap [-]."""
FEWEST = 64
"""Minimum number of samples with reliable intervals; with 16 samples every third interval misses a known index."""


def sobol_shares(keys: Sequence[str], values: Array, noise: float) -> list[Share]:
    """Return the indices of values in the order of the design, shape (n (d + 2),). Raises `ScenarioError` without
    SALib.

    `noise` is its fraction of the variance of `values`. It is in each total index, and taken from estimate and lower
    end; the upper end keeps it, since noise that depends on a draw is not in the others.
    """
    sobol, d = required("SALib.analyze.sobol", "studies", "importance"), len(keys)
    problem = {"num_vars": d, "names": list(keys), "bounds": [[0.0, 1.0]] * d}
    found = sobol.analyze(problem, values, calc_second_order=False, num_resamples=RESAMPLES, seed=1)
    # SALib's half widths are those of a normal distribution for one index alone; these hold for all at once.
    widen = t.ppf(1.0 - (1.0 - CONFIDENCE) / (2 * d), max(len(values) // (d + 2) - 1, 1)) / norm.ppf(0.975)
    columns = np.column_stack([found["ST"], widen * found["ST_conf"], found["S1"], widen * found["S1_conf"]])
    real = max(1.0 - noise, 1e-6)
    return [
        Share(
            key,
            share=float((total - noise) / real),
            low=float(min(total - half - noise, (total - half - noise) / real)),
            high=float((total + half) / real),
            effect=float(first / real),
            half=float(first_half / real),
        )
        for key, (total, half, first, first_half) in zip(keys, columns, strict=True)
    ]


def sobol_flaws(shares: Sequence[Share], samples: int) -> tuple[str, ...]:
    """Return why the intervals are unreliable: too few samples, or values impossible for an index."""
    few = [f"{samples} samples are too few for intervals; {FEWEST} or more tell"] if samples < FEWEST else []
    return (*few, *(f"{text}: no index can be there" for share in shares for text in _impossible(share)))


def _impossible(share: Share) -> list[str]:
    """Return the intervals that exclude everything from 0 to 1."""
    ends = {"first-order": (share.effect - share.half, share.effect + share.half), "total": (share.low, share.high)}
    return [
        f"{share.key}: the {name} index is from {low:.2f} to {high:.2f}"
        for name, (low, high) in ends.items()
        if high < 0.0 or low > 1.0
    ]
