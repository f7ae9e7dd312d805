"""Screening: linear regression of a metric on all draws at once, standardised, with intervals.

Draws enter by their rank, which is their quantile, so that a logarithmic range is as straight as a linear one. The
square of a slope is the share of the variance that a straight line in this draw explains: no more than the draw is
responsible for. What all lines together leave, noise of the seeds aside, may belong to any of them by a bend or an
interaction: so much, and no more, is added to the upper end of each. Standard errors are HC3 [MacKinnonWhite1985],
which hold for points that scatter unevenly.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, rankdata, spearmanr, t

from agrobot_mj.core.signals import Array
from agrobot_mj.studies.sweep.importance.shares import CONFIDENCE, Share


class Regression(NamedTuple):
    """A linear regression on standardised columns."""

    slopes: Array
    """Standardised slopes, shape (d,) [-]."""
    errors: Array
    """Their standard errors, shape (d,) [-]."""
    left: float
    """Share of the variance that is left, upper limit at `CONFIDENCE` [-]."""


def screened(keys: Sequence[str], draws: Array, values: Array, noise: float) -> tuple[list[Share], float]:
    """The shares, and the part that is neither linear nor noise (upper limit); draws (n, d), values (n,)."""
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
    """Least squares of y (n,) on x (n, d), both of mean 0 and variance 1."""
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
    """Columns with mean 0 and variance 1; one that does not vary becomes 0."""
    away: Array = values - values.mean(axis=0)
    deviation = away.std(axis=0)
    found: Array = np.divide(away, deviation, out=np.zeros_like(away), where=deviation > 0.0)
    return found
