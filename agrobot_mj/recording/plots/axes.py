"""Axes of plots: ranges with readable labels, robust against outliers, and space for a legend.

The viewer labels multiples of a power of ten that are at least 20 pixels apart. An automatic range such as -8 to 8 may
contain a single label, which does not define a scale. Sizes are given for a window of 1400 x 850 pixels, which is
typical of browsers. Larger windows show more labels.
"""

from collections.abc import Mapping, Sequence
from math import ceil, floor, log10
from typing import NamedTuple

import numpy as np
from rerun.blueprint import Corner2D

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.plots.catalogue import Plot

TAB_PIXELS, BARS_PIXELS, STEP_PIXELS = 750.0, 55.0, 20.0
"""Height of all plots of a tab, height of the title and time axis of a plot, and minimum label distance [pixels]."""
MARGIN = 0.04  # Margin above and below the values [fraction of the range], so that the outermost label is complete
THIRD = 1.6  # Maximum factor by which an axis is extended to obtain a third label [-]
USUAL_STEPS, FEW_STEPS = 6.0, 1.35
"""Number of labelled steps of an axis without a known range, and number of steps below which the axis has ten times as
many labels [-]."""
ROOM = 1.02  # Length of the time axis divided by the duration of the run [-]
EDGE = 0.045  # Width at the end of the time axis within which a label would be cut off [fraction of the axis]
CUT_QUANTILE, CUT_ABOVE, CUT_AT = 0.9, 3.0, 1.5
"""Parameters for clipping rare large values [-]. The clipped axis ends at e = `CUT_AT` times the quantile
`CUT_QUANTILE` of the values. An axis is clipped if the maximum exceeds `CUT_ABOVE` times e."""
CORNERS: Mapping[Corner2D, tuple[bool, bool]] = {
    Corner2D.RightTop: (True, True),
    Corner2D.LeftTop: (False, True),
    Corner2D.RightBottom: (True, False),
    Corner2D.LeftBottom: (False, False),
}
"""Corners for a legend in order of preference, each with two flags: corner on the right, corner at the top."""
LEGEND_PIXELS = 52.0, 7.5, 14.0, 24.0
"""Legend width without text, width per character, height without entries, and height per entry [pixels]."""
MOST_HIDDEN, MOST_ROOM = 0.06, 0.25
"""Maximum fraction of points hidden by a legend, and maximum fraction of an axis reserved for the legend [-]. Assumed
values."""
PLOT_PIXELS, BESIDE_PIXELS = (420.0, 180.0), (520.0, 180.0)
"""Width and height of a plot [pixels]: on a tab with nine plots, and next to the scene in a column of three plots."""


class Range(NamedTuple):
    """Value range of a plot axis."""

    low: float
    high: float
    beyond: float | None = None  # Maximum of the values if the axis is clipped below this maximum, otherwise None


class Frame(NamedTuple):
    """Value axis, legend position and moving mean of a plot."""

    values: Range | None = None  # Range of the values, or None for the automatic range of the viewer
    legend: Corner2D = Corner2D.RightTop
    room: float = 0.0  # Fraction of the time axis reserved for the legend [-], or 0 if the legend fits in a corner
    mean_s: float | None = None  # Window length of the moving mean drawn with the signals [s], or None without a mean


def frame(t: Array, numbers: Array, plot: Plot, beside: bool) -> Frame:
    """Return the value axis and the legend position for a plot of `numbers` (n, series) at times `t` (n,) [s].

    `beside` selects the size of a plot next to the scene.
    """
    values = value_range(numbers, plot.includes, plot.may_be_cut)
    if values is None:
        return Frame()
    if not plot.legend or len(plot.series) < 2:
        return Frame(values)
    size, along = legend_size(plot.names, BESIDE_PIXELS if beside else PLOT_PIXELS), t / time_end(float(t[-1]))
    corner, hidden = free_corner(along, numbers, values, size)
    if hidden <= MOST_HIDDEN * np.isfinite(numbers).sum():
        return Frame(values, corner)
    if beside:  # plots next to the scene share their time axis
        return Frame(values, Corner2D.RightTop, min(size[0], MOST_ROOM))
    share = min(size[1], MOST_ROOM)
    high = values.high + (values.high - values.low) * share / (1 - share)
    return Frame(values._replace(high=high), Corner2D.RightTop)


def legend_size(names: Sequence[str], of: tuple[float, float] = PLOT_PIXELS) -> tuple[float, float]:
    """Return the width and height of a legend with the entries `names`, as fractions of the plot size `of` [pixels]."""
    (width, character, height, line), most = LEGEND_PIXELS, max(map(len, names), default=0)
    return (width + character * most) / of[0], (height + line * len(names)) / of[1]


def free_corner(along: Array, numbers: Array, values: Range, size: tuple[float, float]) -> tuple[Corner2D, int]:
    """Return the corner in which a legend hides the fewest points, and the number of hidden points.

    `numbers` (n, series) are plotted values, and `along` (n,) are their positions divided by the time axis length [-].
    `size` is the width and height of the legend as fractions of the plot [-].
    """
    up = (numbers - values.low) / (values.high - values.low)

    def hidden(corner: Corner2D) -> int:
        right, top = CORNERS[corner]
        beside = along > 1 - size[0] if right else along < size[0]
        return int((beside[:, None] & (up > 1 - size[1] if top else up < size[1])).sum())

    counts = {corner: hidden(corner) for corner in CORNERS}
    best = min(counts, key=lambda corner: counts[corner])
    return best, counts[best]


def readable(low: float, high: float, most_steps: float) -> tuple[float, float]:
    """Return the range from `low` to `high`, extended so that an axis with at most `most_steps` steps has at least two
    labels."""
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
    """Return the maximum number of axis steps of a plot whose height is the fraction `share` of the tab."""
    return max(1.0, (TAB_PIXELS * share - BARS_PIXELS) / STEP_PIXELS)


def pixels(values: Range | None) -> float:
    """Return the height of a plot with space for all labels of its value axis [pixels]."""
    steps = USUAL_STEPS
    if values is not None:
        span = (values.high - values.low) * (1 + 2 * MARGIN)
        steps = span / 10.0 ** floor(log10(span))
        steps *= 10 if steps < FEW_STEPS else 1
    return BARS_PIXELS + STEP_PIXELS * (0.5 + max(steps, USUAL_STEPS / 2))


def value_range(values: Array, includes: Sequence[float] = (), may_be_cut: bool = False) -> Range | None:
    """Return the range of the finite `values` and of `includes`, or None (automatic range) if all values are equal.

    If `may_be_cut` is True, the range excludes rare large values.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = min(float(finite.min()), *includes, np.inf), max(float(finite.max()), *includes, -np.inf)
    end = CUT_AT * float(np.quantile(finite, CUT_QUANTILE)) if may_be_cut else np.inf
    found = Range(low, high) if high <= CUT_ABOVE * end else Range(low, end, high)
    span = found.high - low
    return found if np.isfinite(span) and span > 1e-9 * max(abs(low), abs(found.high)) else None


def time_end(run_s: float, room: float = 0.0) -> float:
    """Return the end of the time axis of a run of `run_s` [s], with space for the last label and a legend [s]."""
    end = ROOM * run_s / (1 - room)
    step = 10.0 if end < 120.0 else 60.0 if end < 600.0 else 600.0
    last = end - end % step
    return max(end, last / (1 - EDGE) + 1e-6)
