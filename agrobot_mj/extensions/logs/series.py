"""Time series: removal of repeated values and jumps, interpolation, and differentiation."""

from collections.abc import Callable, Sequence
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.signal import savgol_filter

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import SAME_TIME, Mask

Values = np.ndarray[tuple[int, ...], np.dtype[Any]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int_]]
LARGEST = 1e100  # Absolute value from which a number counts as missing, in any unit. Its square is finite.
FEWEST = 4  # Minimum number of values that interpolation needs [-]
SMOOTHING_S = 1.0  # Duration of the local cubic fits that differentiate headings [s]
COURSE_S = 2.0
"""Duration of the local cubic fits for the course rate [s], which is long because second derivatives are noisy."""
LOST_S = 2.0
"""Minimum time without fixes that counts as a loss of position [s], or three fix intervals if these are longer."""
JUMP_M, FASTER, NOISY = 0.5, 2.0, 3.0
"""Terms of the maximum plausible distance between two fixes: a constant [m], and factors on the recorded speed and on
the typical speed error between fixes [-]. Assumed values above the drift of RTK floats and wheel slip."""
JUMP_RAD, LARGEST_YAW_RATE = 0.3, 3.0
"""Maximum plausible heading change: constant [rad], plus yaw rate [rad/s] times the interval. Assumed values."""
AWAY_S = 5.0
"""Maximum duration of a temporary position jump [s]. Longer jumps count as permanent. Assumed value."""
STANDS_OUT, USUAL_OFF = 5.0, 0.9
"""Minimum deviation of an outlier from the line between its neighbours, divided by other deviations [-]. These are the
deviations of the second values before and after, and the quantile `USUAL_OFF` of all deviations. Assumed values."""
LATE_S = 0.1
"""Maximum decrease of time between values in one segment [s]. Assumed value: values of two buses are not exactly in
order."""
RESTART_S = 60.0
"""Pause inserted between two segments of a log where the recorded time decreases [s]. Assumed value: longer than
all gaps that are interpolated."""
MOST_DECREASES = 0.02  # Maximum number of decreases of time divided by the number of rows [-]. Assumed value.
LEAST_SPEED = 0.3  # Speed below which the course is undefined and the dynamics are not excited [m/s]


class TimeSeries(NamedTuple):
    """Values of a signal at increasing times."""

    t: Array  # Increasing times [s], shape (n,)
    value: Array  # Values in SI units, shape (n,) or (n, 2)

    def at(self, t: Array) -> Array:
        """Return the values at times `t` (m,) by Akima interpolation. Values beyond both ends are constant."""
        # linear interpolation between samples 50 ms apart would reduce an oscillation of 1 Hz by 0.8 %
        found: Array = Akima1DInterpolator(self.t, self.value)(np.clip(t, self.t[0], self.t[-1]))
        return found

    def between(self, start: float, end: float) -> "TimeSeries":
        """Return the part of the series from `start` to `end` [s]."""
        inside = (self.t >= start) & (self.t <= end)
        return TimeSeries(self.t[inside], self.value[inside])


def note_on_decreases(steps: Sequence[float]) -> str:
    """Return a note about decreases of time by `steps` [s], at which new segments begin."""
    number = f"{len(steps)} times, first " if len(steps) > 1 else ""
    return f"the time decreases {number}by {steps[0]:.3g} s; the following rows are a new segment"


def in_order(t: Array) -> tuple[Index, Array, list[str]]:
    """Return the indices of the rows in order of time, the times of these rows without decreases [s], and notes.

    Rows in reverse order are reversed. After a decrease of time, for example due to a restart or a change of the clock,
    time continues `RESTART_S` later. Rows with the time of an earlier row are omitted. Times with many decreases or
    repeated values remain, and `check_time` rejects them.
    """
    rows, notes = np.arange(len(t)), list[str]()
    if len(t) < 2 or not np.isfinite(t).all() or not np.ptp(t):
        return rows, t, notes
    if (np.diff(t) <= 0).all():
        rows, t = rows[::-1], t[::-1]
        notes.append("the rows are in reverse order of time")
    steps = np.diff(t)
    back = steps < -LATE_S
    if 0 < back.sum() <= MOST_DECREASES * len(t):
        notes.append(note_on_decreases((-steps[back]).tolist()))
        t = t + np.concatenate(([0.0], np.cumsum(np.where(back, RESTART_S - steps, 0.0))))
        back[:] = False
    if not back.any():
        order = np.argsort(t, kind="stable")
        rows, t = rows[order], t[order]
        new = np.concatenate(([True], np.diff(t) > 0))
        if 1 < len(t) / new.sum() <= SAME_TIME:
            notes.append(f"{len(t) - new.sum()} rows with the time of another row are omitted")
            rows, t = rows[new], t[new]
    return rows, t, notes


def fresh(series: TimeSeries) -> TimeSeries:
    """Return the series without repeated values, which frozen or slow receivers produce. If fewer than `FEWEST` values
    would remain, the series is unchanged."""
    new = np.diff(series.value.reshape(len(series.t), -1), axis=0).any(axis=1)
    kept = np.concatenate(([True], new))
    return TimeSeries(series.t[kept], series.value[kept]) if kept.sum() >= FEWEST else series


def lone(t: Array, values: Values) -> Mask:
    """Return a mask of the outliers in `values` (n,), real or complex, at times `t` (n,) [s]. Missing values are NaN.

    An outlier is far from the line between its neighbours, while the neighbours are not outliers. A sequence of
    repeated values counts as one value.
    """
    known = np.flatnonzero(np.isfinite(values))
    starts = known[np.flatnonzero(np.diff(values[known], prepend=np.nan) != 0)]
    found = np.zeros(len(values), dtype=bool)
    if len(starts) < 2 * FEWEST:
        return found
    x, at = values[starts], t[starts]
    share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    off = np.pad(np.abs(x[1:-1] - (1 - share) * x[:-2] - share * x[2:]), 3)
    here, beside, beyond = off[3:-3], np.stack([off[2:-4], off[4:-2]]), np.maximum(off[1:-5], off[5:-1])
    most = STANDS_OUT * np.maximum(beyond, np.quantile(here, USUAL_OFF))
    half = (np.abs(beside - here / 2) < here / 4).all(axis=0)  # the line to an outlier is half as far away
    for k in np.flatnonzero((here > most) & half) + 1:
        found[starts[k] : starts[k + 1]] = True
    return found & np.isfinite(values)


def driven_places(position: TimeSeries, speed: TimeSeries) -> TimeSeries:
    """Return the positions without jumps that exceed the distance possible at the recorded speed."""
    t, places = position
    u = np.abs(np.interp(t, *speed))
    speeds = np.hypot(*np.diff(places, axis=0).T) / np.diff(t)
    noise = float(np.median(np.abs(speeds - u[1:])))  # includes the error of a speed in a wrong unit
    return without_jumps(
        position, lambda a, b: JUMP_M + (FASTER * np.maximum(u[a], u[b]) + NOISY * noise) * (t[b] - t[a])
    )


def turned_headings(heading: TimeSeries) -> TimeSeries:
    """Return the headings [rad] without jumps that exceed the maximum yaw rate of a machine."""
    t, yaw = heading
    points = TimeSeries(t, np.column_stack([np.cos(yaw), np.sin(yaw)]))
    kept = np.isin(t, without_jumps(points, lambda a, b: JUMP_RAD + LARGEST_YAW_RATE * (t[b] - t[a])).t)
    return TimeSeries(t[kept], yaw[kept])


def without_jumps(series: TimeSeries, reach: Callable[[Index, Index], Array]) -> TimeSeries:
    """Return the points (n, 2) of a series without temporary jumps and without points near permanent jumps. `reach(a,
    b)` returns the maximum plausible distance between the points with indices a and b."""
    t, places = series
    rows = np.arange(len(t))

    def jumps(a: Index, b: Index) -> Mask:
        found: Mask = np.hypot(*(places[b] - places[a]).T) > reach(a, b)
        return found

    borders = np.flatnonzero(jumps(rows[:-1], rows[1:])) + 1
    ways = list[list[Index]]()
    for run in np.split(rows, borders):
        back = len(ways)
        while back and t[run[0]] - t[ways[back - 1][-1][-1]] < AWAY_S:
            back -= 1
            if not jumps(ways[back][-1][-1], run[0]):
                ways[back].append(run)
                del ways[back + 1 :]
                break
        else:
            ways.append([run])
    kept = np.concatenate([run for way in ways for run in way])
    begun = np.array([-inf, *(t[way[0][0]] for way in ways[1:])])
    ended = np.array([*(t[way[-1][-1]] for way in ways[:-1]), inf])
    since = t[kept] - begun[np.searchsorted(begun, t[kept], side="right") - 1]
    until = ended[np.searchsorted(ended, t[kept])] - t[kept]
    kept = kept[np.minimum(since, until) >= longest_pause(t) / 2]
    return TimeSeries(t[kept], places[kept])


def scatter(*series: Array) -> float:
    """Return the standard deviation of white noise in values (n,) or (n, 2), or 0 for too few values.

    The result is robust to motion and outliers, because it is a median of third differences.
    """
    off = [np.abs(np.diff(values, 3, axis=0)).ravel() for values in series if len(values) > 3]
    # standard deviation of a normal distribution; a third difference has 1 + 9 + 9 + 1 variances
    return 1.4826 * float(np.median(np.concatenate(off))) / sqrt(20.0) if off else 0.0


def longest_pause(t: Array) -> float:
    """Return the time between fixes above which the position counts as lost [s], for fixes at times `t` (n,) [s]."""
    return max(LOST_S, 3 * float(np.median(np.diff(t))))


def axle_speed(v: Array, yaw_rate: Array, ahead: float, left: float) -> Array:
    """Return the rear-axle speed (n,) [m/s] from the speed `v` (n,) [m/s] of another point. The distances `ahead` and
    `left` give the position of this point relative to the axle centre [m]."""
    found: Array = np.sign(v) * np.sqrt(np.maximum(v**2 - (ahead * yaw_rate) ** 2, 0.0)) + left * yaw_rate
    return found


def chords(position: TimeSeries, spacing: float) -> tuple[Array, Array]:
    """Return times in steps of `spacing` [s], shape (n,), and the distances between the positions at these times, shape
    (n - 1,) [m]."""
    t = np.arange(position.t[0], position.t[-1], spacing)
    return t, np.hypot(*np.diff([np.interp(t, position.t, each) for each in position.value.T]))


def undo_averaging(series: TimeSeries, length: float) -> Array:
    """Return the values of a sensor, corrected to second order for averaging over `length` [s] in the sensor."""
    x, spacing = series.value, float(np.median(np.diff(series.t)))
    if not length or len(x) < 3:
        return x
    bend = np.zeros_like(x)
    bend[1:-1] = x[2:] - 2 * x[1:-1] + x[:-2]
    # the mean of a parabola exceeds its central value by length^2 / 24 times the second derivative
    sharp: Array = x - (length / spacing) ** 2 / 24 * bend
    return sharp


def course_rate(position: TimeSeries, speed: TimeSeries) -> TimeSeries | None:
    """Return the rate of the course [rad/s] at speeds above `LEAST_SPEED`, from cubic fits over `COURSE_S`. Return None
    for too few positions."""
    if (grid := _even(position.t, COURSE_S, 7)) is None:
        return None
    t, known, cubic = grid
    places = np.stack([np.interp(t, position.t, each) for each in position.value.T])
    (vx, vy), (ax, ay) = (savgol_filter(places, **cubic, deriv=order) for order in (1, 2))
    kept = known & (np.abs(np.interp(t, *speed)) > LEAST_SPEED)
    if kept.sum() < 8:
        return None
    return TimeSeries(t[kept], ((vx * ay - vy * ax) / np.maximum(vx * vx + vy * vy, LEAST_SPEED**2))[kept])


def slope_of(series: TimeSeries) -> TimeSeries | None:
    """Return the derivative from cubic fits over `SMOOTHING_S`, except near gaps, or None for a short series."""
    if (grid := _even(series.t, SMOOTHING_S, 5)) is None:
        return None
    t, known, cubic = grid
    slope = savgol_filter(np.interp(t, *series), **cubic, deriv=1)
    return TimeSeries(t[known], slope[known])


def _even(t: Array, length_s: float, least: int) -> tuple[Array, Mask, dict[str, Any]] | None:
    """Return evenly spaced times, a mask of the times away from gaps, and parameters of `savgol_filter`.

    The filter fits cubic polynomials to windows of `length_s` [s]. A gap is at least `SMOOTHING_S` long. The result is
    None if there are too few samples.
    """
    spacing = float(np.median(np.diff(t)))
    length = max(least, 2 * round(length_s / spacing / 2) + 1)
    even = np.arange(t[0], t[-1], spacing, dtype=np.float64)
    if len(even) < length:
        return None
    following = np.minimum(np.searchsorted(t, even), len(t) - 1)
    gap = t[following] - t[np.maximum(following - 1, 0)] >= SMOOTHING_S
    known: Mask = np.convolve(gap, np.ones(length), "same") < 0.5
    return even, known, {"window_length": length, "polyorder": 3, "delta": spacing}
