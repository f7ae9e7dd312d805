"""Roots of functions of one variable, by Brent's method of scipy."""

from collections.abc import Callable

XTOL, RTOL = 2e-12, 8.881784197001252e-16
"""Tolerances of scipy's own defaults, absolute and relative."""


def root(function: Callable[[float], float], low: float, high: float, xtol: float = XTOL, rtol: float = RTOL) -> float:
    """Zero of `function` between `low` and `high`. Raises ValueError unless it changes its sign between them.

    scipy.optimize is imported by the first call: most runs never ask, and it takes an eighth of a second.
    """
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=xtol, rtol=rtol))
