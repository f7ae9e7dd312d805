"""Root of a function of one variable, by SciPy's implementation of Brent's method."""

from collections.abc import Callable

XTOL, RTOL = 2e-12, 8.881784197001252e-16  # Absolute and relative tolerance: the defaults of SciPy


def root(function: Callable[[float], float], low: float, high: float, xtol: float = XTOL, rtol: float = RTOL) -> float:
    """Return the root of `function` between `low` and `high`. Raises ValueError unless the signs at both ends differ.

    scipy.optimize is imported on the first call: the import takes an eighth of a second, and most runs do not need it.
    """
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=xtol, rtol=rtol))
