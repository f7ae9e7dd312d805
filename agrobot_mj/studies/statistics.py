"""Confidence interval of a success rate, valid for small samples."""


def wilson_interval(successes: int, runs: int, confidence: float) -> tuple[float, float]:
    """Return the two-sided confidence interval of a success rate for a fixed number of runs [Wilson1927]."""
    from scipy.stats import binomtest

    low, high = binomtest(successes, runs).proportion_ci(confidence, method="wilson")
    return float(low), float(high)
