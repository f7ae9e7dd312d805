"""Fractions of a metric's variance with intervals and ranks, by regression or as Sobol indices.

Screening is a standardised linear regression of the metric on the ranks of all random parameters (draws) of a sweep.
Ranks make logarithmic ranges linear. The squared slope of a parameter is the fraction of the variance that it explains
linearly, which underestimates its importance. Variance that is neither linear nor noise of the seeds may belong to any
parameter through curvature or interactions. This variance is added to the upper end of every interval. Standard errors
are HC3 [MacKinnonWhite1985], valid for residuals of unequal variance.

Sobol indices [Saltelli2010] of a sweep with `method = "saltelli"` are computed by SALib, with bootstrap intervals. The
first-order index of a parameter is the fraction of the variance removed when its value is known. The total index, with
interactions, is the fraction that remains while only this parameter is unknown. First-order indices sum to at most 1.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm, rankdata, spearmanr, t

from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.signals import Array

CONFIDENCE = 0.95  # Probability with which the intervals of all draws in a group are correct simultaneously [-]


class Share(NamedTuple):
    """Fraction of a metric's variance that one random parameter causes, including interactions."""

    key: str
    share: float  # Estimated fraction [-]: the total index, or the squared slope in a screening
    low: float  # Lower end of the interval of the fraction, valid for all draws simultaneously [-]
    high: float  # Upper end of the interval [-]. In a screening it includes all unexplained variance.
    effect: float  # First-order index, or standardised slope of the regression [-]
    half: float  # Half width of the interval of `effect` [-]
    correlation: float | None = None  # Rank correlation between draw and metric [-], or None for Sobol indices
    best: int = 1  # Smallest rank that the intervals allow
    worst: int = 1  # Largest rank that the intervals allow

    @property
    def rank(self) -> str:
        """Rank of the parameter as text, or a range such as 2-4 if intervals overlap."""
        return str(self.best) if self.best == self.worst else f"{self.best}-{self.worst}"


class Influence(NamedTuple):
    """Variance fractions of all random parameters in one group of runs with the same variant and axis values."""

    group: str
    mean: float
    deviation: float
    """Standard deviation of the seed-averaged metric between the points of the design [unit of the metric]."""
    noise: float | None
    """Fraction of the seed-averaged metric's variance that is due to seeds [-], or None with one seed."""
    unexplained: float | None  # Maximum variance fraction not due to regression or noise [-], or None for Sobol
    flaws: tuple[str, ...]  # Reasons why the intervals are unreliable. In this case there is no ranking.
    shares: tuple[Share, ...]

    @property
    def ordered_pairs(self) -> int:
        """Number of parameter pairs whose order is certain."""
        return sum(share.best - 1 for share in self.shares)

    @property
    def pairs(self) -> int:
        """Number of all parameter pairs."""
        return len(self.shares) * (len(self.shares) - 1) // 2


def rank_shares(shares: Sequence[Share], trusted: bool) -> tuple[Share, ...]:
    """Return the fractions with their ranks, sorted by rank.

    A parameter ranks above another parameter only if its interval is entirely above the other interval. If `trusted`
    is False, all parameters have the same rank.
    """
    found = []
    for share in shares:
        above = sum(other.low > share.high for other in shares) if trusted else 0
        below = sum(share.low > other.high for other in shares) if trusted else 0
        found.append(share._replace(best=1 + above, worst=len(shares) - below))
    return tuple(sorted(found, key=lambda share: (share.best, share.worst)))


class Regression(NamedTuple):
    """Result of a linear regression on standardised variables."""

    slopes: Array  # Standardised slopes [-], shape (d,)
    errors: Array  # Standard errors of the slopes [-], shape (d,)
    left: float  # Upper confidence limit of the unexplained fraction of the variance [-]


def regression_shares(keys: Sequence[str], draws: Array, values: Array, noise: float) -> tuple[list[Share], float]:
    """Return the variance fractions of the parameters `keys` by regression, and the maximum fraction that is due
    neither to the regression nor to seeds."""
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
    """Return the least-squares regression of y (n,) on x (n, d). Both must have mean 0 and variance 1."""
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
    """Return the columns scaled to mean 0 and variance 1. Constant columns become 0."""
    away: Array = values - values.mean(axis=0)
    deviation = away.std(axis=0)
    found: Array = np.divide(away, deviation, out=np.zeros_like(away), where=deviation > 0.0)
    return found


RESAMPLES = 1000  # Number of bootstrap resamples [-]
FEWEST = 64  # Minimum number of samples for reliable intervals. With 16 samples, every third interval misses the index.


def sobol_shares(keys: Sequence[str], values: Array, noise: float) -> list[Share]:
    """Return the Sobol indices of the parameters `keys` from metric values (n (d + 2),) in design order. Raises
    `ScenarioError` if SALib is not installed.

    `noise` is the fraction of the variance of `values` that is due to seeds. Each total index includes this fraction.
    The fraction is subtracted from the estimate and from the lower bound. The upper bound includes the fraction,
    because the noise may depend on the keys.
    """
    sobol, d = import_extra("SALib.analyze.sobol", "studies", "importance"), len(keys)
    problem = {"num_vars": d, "names": list(keys), "bounds": [[0.0, 1.0]] * d}
    found = sobol.analyze(problem, values, calc_second_order=False, num_resamples=RESAMPLES, seed=1)
    # SALib gives half widths for a single index with a normal distribution; these are valid for all indices.
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
    """Return reasons for unreliable intervals: too few samples, or impossible values of an index."""
    few = [f"{samples} samples are too few for intervals; use at least {FEWEST}"] if samples < FEWEST else []
    return (*few, *(f"{text}, outside the possible range" for share in shares for text in _impossible(share)))


def _impossible(share: Share) -> list[str]:
    ends = {"first-order": (share.effect - share.half, share.effect + share.half), "total": (share.low, share.high)}
    return [
        f"{share.key}: the {name} index is from {low:.2f} to {high:.2f}"
        for name, (low, high) in ends.items()
        if high < 0.0 or low > 1.0
    ]
