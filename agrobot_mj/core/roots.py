"""Root of a function of one variable, by Brent's method in SciPy."""

from collections.abc import Callable

XTOL, RTOL = 2e-12, 8.881784197001252e-16  # Absolute and relative tolerance: the defaults of SciPy


def root(function: Callable[[float], float], low: float, high: float, xtol: float = XTOL, rtol: float = RTOL) -> float:
    """Return the root of `function` between `low` and `high`. Raises ValueError if both ends have the same sign.

    scipy.optimize is imported on the first call, because the import takes 0.1 s and most runs need no roots.
    """
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=xtol, rtol=rtol))
