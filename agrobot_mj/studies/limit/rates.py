"""Success rates from few runs: the interval of a rate, and how many runs show a reliability."""

from math import ceil, sqrt
from statistics import NormalDist


def runs_needed(reliability: float, confidence: float) -> int:
    """Number of runs without a failure that shows a reliability: from n / (n + z^2) >= R."""
    return ceil(_z(confidence) ** 2 * reliability / (1.0 - reliability) - 1e-9)


def wilson(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Two-sided interval of a success rate from its number of successes [Wilson1927]."""
    z, n, p = _z(confidence), runs, successes / runs
    middle, half = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, (middle - half) / (1 + z * z / n)), min(1.0, (middle + half) / (1 + z * z / n))


def _z(confidence: float) -> float:
    return NormalDist().inv_cdf((1.0 + confidence) / 2.0)
