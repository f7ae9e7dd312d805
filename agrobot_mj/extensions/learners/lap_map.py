"""Map of a quantity over arc length, learned from lap to lap, with guards against divergence.

Iterative learning control: the map applies the corrections of one lap in advance in the next lap,

    m_k+1 = r_k^2 (m_k + gain Z(c_k)),    |m| <= bound,      r_k = max(u_k . u_k-1 / (|u_k| |u_k-1|), 0),

with the correction c at each location, and a zero-phase Gaussian filter Z over the distance with the full width
`smoothing_m` at half maximum. r^2 is the fraction of u = m + Z(c) explained by the previous lap: small in ruts, which
change in every lap, and nearly 1 on a slope. Locations are GRID_M apart; the map is periodic with the lap.

Guards: a map is worse if the RMS error of its lap exceeds `WORSE` times the error of the best lap plus `MARGIN_M`. This
comparison is made at the end of the lap. During a lap, the error over about WINDOW_M is compared with the error of the
best lap, at the same location and on average. A worse map is replaced by the map of the best lap, blended over FADE_M.
The gain is halved, and learning is suspended until a complete lap has measured the error of the restored map. If the
best map itself has become worse, because ground or machine have changed, learning restarts from an empty map. Learning
ends when the best map has been restored GIVE_UP times.
"""

from math import exp, inf, log, sqrt
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.learned import Learned
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Spec

GRID_M = 0.25  # Distance between locations of the map [m]. Assumed value: a fifth of the smallest useful filter width.
WINDOW_M, FADE_M = 2.0, 2.0
"""Averaging distance of the error, and distance over which a new map replaces the old map [m]. Assumed values."""
WORSE, MARGIN_M = 1.1, 0.005
"""Factor [-] and margin [m] on the RMS error of the best lap, above which the map of a lap counts as worse. Assumed
values, above the noise. A wider margin would allow learning in ruts, whose effects do not repeat."""
WORSE_HERE, MARGIN_HERE_M = 1.5, 0.06
"""Factor [-] and margin [m] on the error of the best lap, above which a map counts as worse during a lap. Assumed
values."""
GIVE_UP = 4
"""Number of returns to the best map after which learning ends. Assumed value: each return halves the learning gain."""
COMPLETE = 0.9  # Minimum fraction of the locations that the tractor must pass in a lap for learning from this lap [-]
UNKNOWN_M = 1e3  # Value that represents an unknown error of the best lap in a file [m]
NOTHING = np.empty(0)


class Cell(NamedTuple):
    """Sums over the ticks of the current lap at one location of the map."""

    ticks: float = 0.0  # Number of ticks
    square: float = 0.0  # Sum of the squared errors [m2]
    learnt: float = 0.0  # Number of ticks used for learning
    correction: float = 0.0  # Sum of the corrections in the ticks used for learning [unit of the map]


class LapState(NamedTuple):
    """State of a `LapMap` between two ticks. Arrays have shape (locations,) and are empty before the first tick."""

    lap: int = 0
    s: float = 0.0  # Arc length along the path [m]
    map_: Array = NOTHING  # Map in use [unit of the map]
    before: Array = NOTHING  # Previous map [unit of the map], which is faded out
    since: float = inf  # Distance travelled since the current map was first used [m]
    best: Array = NOTHING  # Map of the best lap [unit of the map]
    best_square: Array = NOTHING  # Squared error of the best lap, averaged over about WINDOW_M [m2]
    best_rms: float = inf  # RMS error of the best lap [m], or infinity before the first complete lap
    cells: Array = NOTHING  # Sums at each location in the current lap, columns as in `Cell`, shape (locations, 4)
    here: Array = NOTHING  # Squared error of the current lap, averaged over about WINDOW_M [m2]
    cell: tuple[int, Cell] = (0, Cell())  # Index of the current location, and the sums of its ticks
    square: float = 0.0  # Current squared error, averaged over about WINDOW_M [m2]
    wanted: Array = NOTHING
    """Map plus correction of the last lap used for learning [unit of the map], or zero if no lap has been used."""
    whole: bool = False
    """Whether the map is unchanged since the start of the lap, so that the lap error belongs to this map."""
    returns: int = 0  # Number of returns to the best map

    @property
    def share(self) -> float:
        """Current learning gain divided by its initial value [-]."""
        return 0.5**self.returns if self.returns < GIVE_UP else 0.0

    @property
    def learning(self) -> bool:
        """Whether the current lap is used for learning."""
        return self.whole and self.share > 0.0


class LapMap(Spec):
    """Learning rule for a map of a quantity over arc length."""

    gain: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Fraction of the correction added to the map in each lap [-]. Assumed value (range 0.3-0.6). At 0.7 maps may
    diverge."""
    smoothing_m: Annotated[float, Field(ge=0.5, le=20)] = 2.0
    """Full width of the smoothing filter at half maximum [m]. Assumed value (range 1.5-4). At 1 m maps may diverge."""
    guard: bool = True
    """Whether the map of the best lap is restored when the cross-track error increases."""

    def value(self, state: LapState, s: float, lap: float) -> float:
        """Return the value of the map [unit of the map] at arc length `s` on a path with laps of length `lap` [m]."""
        if not len(state.map_):
            return 0.0
        fresh = min(state.since / FADE_M, 1.0)
        now = _at(state.map_, s / lap)
        return now if fresh == 1.0 else fresh * now + (1.0 - fresh) * _at(state.before, s / lap)

    def begin(self, s: float, lap: float, known: Learned | None = None, name: str = "") -> LapState:
        """Return the initial state at arc length `s` on a path with laps of length `lap` [m]. `known` contains a loaded
        map with the quantity `name`, or is None for an empty map."""
        n = max(round(lap / GRID_M), 2)
        map_, best, error, wanted = (_resample(known, key, n, lap) for key in _names(name))
        rms = float(np.sqrt(np.mean(error**2))) if known and error.max() < UNKNOWN_M else inf
        empty, number = np.zeros((n, len(Cell._fields))), int(s // lap)
        whole = s < number * lap + FADE_M
        here = np.zeros(n)
        return LapState(number, s, map_, map_, inf, best, error**2, rms, empty, here, wanted=wanted, whole=whole)

    def after(
        self, state: LapState, s: float, lap: float, error: float, correction: float | None, bound: float
    ) -> LapState:
        """Return the state after a tick at arc length `s` [m], with the cross-track `error` [m] and the `correction`.

        A tick without a correction (None) is not used for learning. `correction` and `bound`, the maximum magnitude of
        the map, are in the unit of the map.
        """
        way, k = s - state.s, int(s % lap / lap * len(state.map_)) % len(state.map_)
        if int(s // lap) > state.lap:
            state = self._next_lap(state, int(s // lap), bound)
        keep = exp(-max(way, 0.0) / WINDOW_M)
        square = keep * state.square + (1.0 - keep) * error * error
        state = state._replace(s=s, since=state.since + max(way, 0.0), square=square)
        state = _update_location(state, k, error, correction)
        return self._return_to_best(state) if self.guard and _worse_here(state, k) else state

    def learned(self, state: LapState, lap: float, bound: float, name: str) -> Learned:
        """Return the map of the quantity `name` for the next lap, and the best map with its error, by arc length."""
        if not len(state.map_):
            return {}
        state = self._next_lap(state, state.lap + 1, bound)
        known = state.best_rms < inf
        error = np.sqrt(state.best_square) if known else np.full(len(state.map_), UNKNOWN_M)
        values = state.map_, state.best, error, state.wanted
        place = lap * (np.arange(len(state.map_)) + 0.5) / len(state.map_)
        return {key: np.column_stack([place, value]) for key, value in zip(_names(name), values, strict=True)}

    def _next_lap(self, state: LapState, lap: int, bound: float) -> LapState:
        state = _update_location(state, -1, 0.0, None)
        ticks, square, learnt, corrected = state.cells.T
        fresh = state._replace(lap=lap, cells=np.zeros_like(state.cells), here=np.zeros_like(state.here), whole=True)
        if not (state.whole and np.mean(ticks > 0) > COMPLETE):
            return fresh
        correction = _smooth(corrected / np.maximum(learnt, 1.0), self.smoothing_m / GRID_M)
        fresh = fresh._replace(wanted=state.map_ + correction)
        rms = sqrt(float(square.sum() / ticks.sum()))
        if self.guard and rms > WORSE * state.best_rms + MARGIN_M:
            return self._return_to_best(fresh)._replace(whole=True)
        if rms < state.best_rms:
            fresh = fresh._replace(best=state.map_, best_square=state.here, best_rms=rms)
        if not (share := self.gain * state.share):
            return fresh
        repeats = _repeats(state.wanted, fresh.wanted)
        map_ = np.clip(repeats * (state.map_ + share * correction), -bound, bound)
        return fresh._replace(map_=map_, before=state.map_, since=0.0)

    def _return_to_best(self, state: LapState) -> LapState:
        """Return the state with the map of the best lap or, if this map is already in use, with an empty map. The next
        complete lap measures the error of the selected map."""
        learnt = not np.array_equal(state.map_, state.best)
        best = state.best if learnt else np.zeros_like(state.best)
        fading = state._replace(map_=best, before=state.map_, since=0.0, best=best, best_rms=inf, whole=False)
        return fading._replace(returns=state.returns + 1) if learnt else fading


def _update_location(state: LapState, k: int, error: float, correction: float | None) -> LapState:
    """Return the state after a tick at location `k` of the path. The sums of a location (`Cell`) are stored when the
    tractor leaves the location."""
    last, cell = state.cell
    if k != last:
        cells, here = state.cells.copy(), state.here.copy()
        cells[last] += cell
        here[last] = state.square
        state, cell = state._replace(cells=cells, here=here), Cell()
    if k >= 0:
        learnt = (0.0, 0.0) if correction is None else (1.0, correction)
        cell = Cell(cell.ticks + 1.0, cell.square + error * error, cell.learnt + learnt[0], cell.correction + learnt[1])
    return state._replace(cell=(max(k, 0), cell))


def _worse_here(state: LapState, k: int) -> bool:
    """Return whether the error at location `k` exceeds a limit based on the local and RMS errors of the best lap."""
    best = max(sqrt(state.best_square[k]), state.best_rms)  # the first lap may begin with a small error
    return sqrt(state.square) > WORSE_HERE * best + MARGIN_HERE_M


def _at(values: Array, turn: float) -> float:
    """Return `values` (n,) interpolated at the lap fraction `turn` [-]. Values are given at the centres of n equal
    segments of a lap."""
    n = len(values)
    place = turn % 1.0 * n - 0.5
    k = int(place // 1.0)
    share = place - k
    return float((1.0 - share) * values[k % n] + share * values[(k + 1) % n])


def _smooth(values: Array, width: float) -> Array:
    """Return the `values` of a lap, shape (n,), after a zero-phase filter whose full width at half maximum is `width`
    locations."""
    sigma = width / sqrt(8.0 * log(2.0))
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(values))
    return np.fft.irfft(np.fft.rfft(values) * np.exp(-0.5 * (sigma * omega) ** 2), len(values))


def _repeats(before: Array, now: Array) -> float:
    """Return the fraction of map plus correction that repeats the previous lap [-], or 1 without a previous lap."""
    size = float(before @ before) * float(now @ now)
    return max(float(before @ now), 0.0) ** 2 / size if size else 1.0


def _names(name: str) -> tuple[str, str, str, str]:
    """Return the names of the arrays in a file: map, best map, error of the best lap, map plus correction."""
    return name, f"{name}_best", f"{name}_best_error", f"{name}_wanted"


def _resample(known: Learned | None, name: str, n: int, lap: float) -> Array:
    """Return a learned array at the centres of n equal segments of a lap of length `lap` [m], or zeros if missing."""
    if not known or name not in known:
        return np.zeros(n)
    place, value = known[name].T
    found: Array = np.interp(lap * (np.arange(n) + 0.5) / n, place, value)
    return found
