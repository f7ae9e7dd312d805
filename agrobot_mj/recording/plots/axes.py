"""The axes of plots: ranges on which the viewer writes numbers, and in which a few values do not flatten the rest.

The viewer writes numbers at the multiples of a power of ten, at least 20 pixels apart. A range left to itself, such as
-8 to 8, may hold only one, and then nobody can tell its scale.
"""

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array

MOST_STEPS = 42.0
"""Between numbers one above the other, as many as have room on a tab 1080 pixels high; plots share them."""
MARGIN = 0.04
"""Room above and below, so that the outermost number is not cut [share of the range]."""
ROOM = 1.37
"""Time axis over the run, so that the legends hide no line."""
EDGE = 0.045
"""Share of the time axis at its end where a number would be cut."""
CUT_QUANTILE, CUT_ABOVE, CUT_AT = 0.9, 3.0, 1.5
"""A plot that may be cut ends at CUT_AT times this quantile if its largest value is over CUT_ABOVE times that end."""


class Range(NamedTuple):
    """What an axis shows."""

    low: float
    high: float
    beyond: float | None = None
    """The largest value of a plot that is cut, else None."""


def readable(low: float, high: float, most_steps: float) -> tuple[float, float]:
    """The range from `low` to `high`, made larger until two numbers stand on an axis with room for `most_steps`."""
    span = high - low
    step = 10.0 ** floor(log10(span))
    if span * (1 + 2 * MARGIN) > most_steps * step:
        step *= 10
    while floor(high / step + 1e-9) - ceil(low / step - 1e-9) < 1:
        above, below = step * (floor(high / step + 1e-9) + 1), step * (ceil(low / step - 1e-9) - 1)
        low, high = (low, above) if above - high <= low - below else (below, high)
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def value_range(values: Array, includes: Sequence[float] = (), may_be_cut: bool = False) -> Range | None:
    """The range of the finite `values` and of `includes`; None, if it has no extent, leaves it to the viewer."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = min(float(finite.min()), *includes, np.inf), max(float(finite.max()), *includes, -np.inf)
    end = CUT_AT * float(np.quantile(finite, CUT_QUANTILE)) if may_be_cut else np.inf
    found = Range(low, high) if high <= CUT_ABOVE * end else Range(low, end, high)
    span = found.high - low
    return found if np.isfinite(span) and span > 1e-9 * max(abs(low), abs(found.high)) else None


def time_end(run_s: float) -> float:
    """Where the time axis of a run of `run_s` [s] ends [s]."""
    end = ROOM * run_s
    step = 10.0 if end < 120.0 else 60.0 if end < 600.0 else 600.0
    return end - end % step - 1e-3 * step if end > step and end % step < EDGE * end else end
