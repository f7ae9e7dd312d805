"""Roots of functions of one variable, by Brent's method of SciPy."""

from collections.abc import Callable

XTOL, RTOL = 2e-12, 8.881784197001252e-16
"""Absolute and relative tolerance: SciPy's defaults."""


def root(function: Callable[[float], float], low: float, high: float, xtol: float = XTOL, rtol: float = RTOL) -> float:
    """Return the zero of `function` between `low` and `high`. Raises ValueError unless its sign changes between them.

    scipy.optimize is imported on the first call, which takes an eighth of a second; most runs do not need it.
    """
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=xtol, rtol=rtol))
