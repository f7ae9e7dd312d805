"""Axes of plots: ranges with readable numbers, robust to outliers, and space for a legend.

The viewer labels multiples of a power of ten, at least 20 pixels apart. An automatic range, such as -8 to 8, may
contain only one label, and its scale is then unreadable. Sizes are those of a window of 1400 x 850 pixels, typical for
browsers; larger windows show more labels.
"""

from collections.abc import Mapping, Sequence
from math import ceil, floor, log10
from typing import NamedTuple

import numpy as np
from rerun.blueprint import Corner2D

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.plots.catalogue import Plot

TAB_PIXELS, BARS_PIXELS, STEP_PIXELS = 750.0, 55.0, 20.0
"""Height of a tab's plots, of the title and the time axis of one, and from one number to the next."""
MARGIN = 0.04
"""Room above and below, so that the outermost number is not cut [fraction of the range]."""
THIRD = 1.6
"""Maximum length of an axis divided by the range of values for adding a third label [-]."""
USUAL_STEPS, FEW_STEPS = 6.0, 1.35
"""Steps between axis numbers of a plot whose values are not known yet, and up to which they are divided by ten [-]."""
ROOM = 1.02
"""Length of the time axis divided by that of the run [-]."""
EDGE = 0.045
"""Fraction of the time axis at its end where a number would be cut."""
CUT_QUANTILE, CUT_ABOVE, CUT_AT = 0.9, 3.0, 1.5
"""A plot that may be cut ends at CUT_AT times this quantile, if its maximum value is above CUT_ABOVE times that end."""
CORNERS: Mapping[Corner2D, tuple[bool, bool]] = {
    Corner2D.RightTop: (True, True),
    Corner2D.LeftTop: (False, True),
    Corner2D.RightBottom: (True, False),
    Corner2D.LeftBottom: (False, False),
}
"""Corners for a legend, in the order of preference: whether at the right, and at the top."""
LEGEND_PIXELS = 52.0, 7.5, 14.0, 24.0
"""Width of an empty legend and of a character, height of an empty legend and of a line. Measured in the viewer."""
MOST_HIDDEN, MOST_ROOM = 0.06, 0.25
"""Fraction of its points that a legend may hide, and of an axis that it may have for itself [-]. Assumed values."""
PLOT_PIXELS, BESIDE_PIXELS = (420.0, 180.0), (520.0, 180.0)
"""Width and height of a plot among nine on a tab, and of one of three next to the scene [pixels]."""


class Range(NamedTuple):
    """Values that an axis shows."""

    low: float
    high: float
    beyond: float | None = None
    """The maximum value of a plot that is cut, else None."""


class Frame(NamedTuple):
    """The frame of a plot."""

    values: Range | None = None
    """Range of the values; None leaves it to the viewer."""
    legend: Corner2D = Corner2D.RightTop
    """Corner of the legend."""
    room: float = 0.0
    """Space for the legend next to the curves, if it covers too much in every corner [fraction of the time axis]."""
    mean_s: float | None = None
    """Length of the moving mean drawn with the signals; None without [s]."""


def frame(t: Array, numbers: Array, plot: Plot, beside: bool) -> Frame:
    """Return the frame of a plot of `numbers` (n, series) at times `t` (n,) [s]; `beside`: next to the scene."""
    values = value_range(numbers, plot.includes, plot.may_be_cut)
    if values is None:
        return Frame()
    if not plot.legend or len(plot.series) < 2:
        return Frame(values)
    size, along = legend_size(plot.names, BESIDE_PIXELS if beside else PLOT_PIXELS), t / time_end(float(t[-1]))
    corner, hidden = free_corner(along, numbers, values, size)
    if hidden <= MOST_HIDDEN * np.isfinite(numbers).sum():
        return Frame(values, corner)
    if beside:  # with a time axis that all the plots beside the scene have
        return Frame(values, Corner2D.RightTop, min(size[0], MOST_ROOM))
    share = min(size[1], MOST_ROOM)
    high = values.high + (values.high - values.low) * share / (1 - share)
    return Frame(values._replace(high=high), Corner2D.RightTop)


def legend_size(names: Sequence[str], of: tuple[float, float] = PLOT_PIXELS) -> tuple[float, float]:
    """Return the width and height of the legend of `names`, as fractions of those `of` a plot [pixels]."""
    (width, character, height, line), most = LEGEND_PIXELS, max(map(len, names), default=0)
    return (width + character * most) / of[0], (height + line * len(names)) / of[1]


def free_corner(along: Array, numbers: Array, values: Range, size: tuple[float, float]) -> tuple[Corner2D, int]:
    """Return the corner in which a legend of this size hides the fewest of `numbers` (n, series), `along` (n,) the
    axis; and how many."""
    up = (numbers - values.low) / (values.high - values.low)

    def hidden(corner: Corner2D) -> int:
        right, top = CORNERS[corner]
        beside = along > 1 - size[0] if right else along < size[0]
        return int((beside[:, None] & (up > 1 - size[1] if top else up < size[1])).sum())

    counts = {corner: hidden(corner) for corner in CORNERS}
    best = min(counts, key=lambda corner: counts[corner])
    return best, counts[best]


def readable(low: float, high: float, most_steps: float) -> tuple[float, float]:
    """Return the range from `low` to `high`, extended until it contains two labels on an axis with `most_steps` steps,
    and three if a small extension suffices."""
    span = high - low
    step = 10.0 ** ceil(log10(span * (1 + 2 * MARGIN) / most_steps) - 1e-9)
    for steps, longest in ((1, np.inf), (2, THIRD * span)):
        while floor(high / step + 1e-9) - ceil(low / step - 1e-9) < steps:
            above, below = step * (floor(high / step + 1e-9) + 1), step * (ceil(low / step - 1e-9) - 1)
            longer = (low, above) if above - high <= low - below else (below, high)
            if longer[1] - longer[0] > longest:
                break
            low, high = longer
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def most_steps(share: float) -> float:
    """Return the maximum number of axis steps on a plot that has this fraction of the height of a tab."""
    return max(1.0, (TAB_PIXELS * share - BARS_PIXELS) / STEP_PIXELS)


def pixels(values: Range | None) -> float:
    """Return the height of a plot whose axis has room for as many numbers as its values ask for."""
    steps = USUAL_STEPS
    if values is not None:
        span = (values.high - values.low) * (1 + 2 * MARGIN)
        steps = span / 10.0 ** floor(log10(span))
        steps *= 10 if steps < FEW_STEPS else 1
    return BARS_PIXELS + STEP_PIXELS * (0.5 + max(steps, USUAL_STEPS / 2))


def value_range(values: Array, includes: Sequence[float] = (), may_be_cut: bool = False) -> Range | None:
    """Return the range of the finite `values` and of `includes`; None, without extent, leaves it to the viewer."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = min(float(finite.min()), *includes, np.inf), max(float(finite.max()), *includes, -np.inf)
    end = CUT_AT * float(np.quantile(finite, CUT_QUANTILE)) if may_be_cut else np.inf
    found = Range(low, high) if high <= CUT_ABOVE * end else Range(low, end, high)
    span = found.high - low
    return found if np.isfinite(span) and span > 1e-9 * max(abs(low), abs(found.high)) else None


def time_end(run_s: float, room: float = 0.0) -> float:
    """Return the end of the time axis of a run of `run_s` [s], with space for its last label and the fraction `room`
    for a legend [s]."""
    end = ROOM * run_s / (1 - room)
    step = 10.0 if end < 120.0 else 60.0 if end < 600.0 else 600.0
    last = end - end % step
    return max(end, last / (1 - EDGE) + 1e-6)
