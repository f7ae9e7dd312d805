"""Map of a quantity over arc length, learned from lap to lap, with guards against divergence.

Iterative learning control: what had to be corrected at a place in one lap is there beforehand in the next,

    m_k+1 = r_k^2 (m_k + gain Z(c_k)),    |m| <= bound,      r_k = max(u_k . u_k-1 / (|u_k| |u_k-1|), 0),

c the correction at each place, Z a filter of zero phase over the distance, a Gaussian whose half-value width is
`smoothing_m`, and r^2 the share of what the places want, u = m + Z(c), that the lap before explains: little in ruts,
which every lap changes, nearly all on a slope. Places are GRID_M apart; the lap closes on itself.

Guards. A map counts as worse where the error of its lap is larger than that of the best lap by `WORSE` and `MARGIN_M`:
root mean square of the whole lap, and, while it drives, over about WINDOW_M against the same place and the mean of the
best lap. It then goes back to the map of the best lap, over FADE_M, halves its gain and learns nothing until a whole
lap has shown how good that one still is. Where the best map itself is worse, since the ground or the machine is
another, it begins again from nothing. After GIVE_UP such returns it stops learning for good.
"""

from math import exp, inf, log, sqrt
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.learned import Learned
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Spec

GRID_M = 0.25
"""Distance between the places [m]. Assumed value: a fifth of the narrowest filter that is of use."""
WINDOW_M, FADE_M = 2.0, 2.0
"""Distance over which the error is averaged while driving, and over which another map is blended in [m]. Assumed
value."""
WORSE, MARGIN_M = 1.1, 0.005
"""Relative and absolute increase of the error above which a lap counts as worse [-, m]. Assumed value: above noise. In
ruts, which change every lap, a wider margin would let it learn effects that do not repeat."""
WORSE_HERE, MARGIN_HERE_M = 1.5, 0.06
"""Relative and absolute increase of the error over WINDOW_M allowed while driving [-, m]. Assumed value."""
GIVE_UP = 4
"""Returns to the best map after which it stops learning [-]. Assumed value: the gain is then a sixteenth."""
COMPLETE = 0.9
"""Fraction of its places that a lap has to pass to be learned from [-]."""
UNKNOWN_M = 1e3
"""Error of a best lap that is not known, in a file [m]."""
NOTHING = np.empty(0)


class Cell(NamedTuple):
    """Values at one location in this lap."""

    ticks: float = 0.0
    """Number of ticks."""
    square: float = 0.0
    """Sum of the squared errors [m2]."""
    learnt: float = 0.0
    """Number of ticks learned from."""
    correction: float = 0.0
    """Sum of their corrections [unit]."""


class LapState(NamedTuple):
    """Memory of a `LapMap`; arrays of shape (places,) are empty before the first tick."""

    lap: int = 0
    """Number of the lap, from 0."""
    s: float = 0.0
    """Distance along the path [m]."""
    map_: Array = NOTHING
    """The map in use [unit]."""
    before: Array = NOTHING
    """The map before it, which fades out [unit]."""
    since: float = inf
    """Distance since it came into use [m]."""
    best: Array = NOTHING
    """The map of the best lap [unit]."""
    best_square: Array = NOTHING
    """Squared error of the best lap, averaged over about WINDOW_M [m2]."""
    best_rms: float = inf
    """Error of the best lap, root mean square; infinite before it is known [m]."""
    cells: Array = NOTHING
    """Values at each location in this lap, columns as in `Cell`, shape (places, 4)."""
    here: Array = NOTHING
    """Squared error of this lap, averaged over about WINDOW_M [m2]."""
    cell: tuple[int, Cell] = (0, Cell())
    """Present location, and its values so far."""
    square: float = 0.0
    """Squared error averaged over about WINDOW_M [m2]."""
    wanted: Array = NOTHING
    """Map plus correction of the last learned lap, by location; zero before it [unit]."""
    whole: bool = False
    """Whether this lap was driven with one map from its start, so that it can be evaluated."""
    returns: int = 0
    """Number of returns to the best map."""

    @property
    def share(self) -> float:
        """Fraction of the gain that is left [-]."""
        return 0.5**self.returns if self.returns < GIVE_UP else 0.0

    @property
    def learning(self) -> bool:
        """Whether this lap will be learned from."""
        return self.whole and self.share > 0.0


class LapMap(Spec):
    """Learning of a quantity over arc length."""

    gain: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Fraction of the correction that moves into the map each lap [-]. Assumed value (0.3-0.6): with 0.7 it may
    diverge."""
    smoothing_m: Annotated[float, Field(ge=0.5, le=20)] = 2.0
    """Full width at half maximum of the filter over the distance [m]. Assumed value (1.5-4): with 1 it may diverge."""
    guard: bool = True
    """Whether it goes back to the best map where a lap gets worse."""

    def value(self, state: LapState, s: float, lap: float) -> float:
        """Return the map at the distance `s` [m] along a path of laps of `lap` [m] [unit]."""
        if not len(state.map_):
            return 0.0
        fresh = min(state.since / FADE_M, 1.0)
        now = _at(state.map_, s / lap)
        return now if fresh == 1.0 else fresh * now + (1.0 - fresh) * _at(state.before, s / lap)

    def begun(self, s: float, lap: float, known: Learned | None = None, name: str = "") -> LapState:
        """Return the state before the first tick, at the arc length `s` [m] of a path with laps of `lap` [m].

        `known` are the values of the quantity `name` learned in an earlier run.
        """
        n = max(round(lap / GRID_M), 2)
        map_, best, error, wanted = (_resampled(known, key, n, lap) for key in _names(name))
        rms = float(np.sqrt(np.mean(error**2))) if known and error.max() < UNKNOWN_M else inf
        empty, number = np.zeros((n, len(Cell._fields))), int(s // lap)
        whole = s < number * lap + FADE_M
        here = np.zeros(n)
        return LapState(number, s, map_, map_, inf, best, error**2, rms, empty, here, wanted=wanted, whole=whole)

    def after(
        self, state: LapState, s: float, lap: float, error: float, correction: float | None, bound: float
    ) -> LapState:
        """Return the state after a tick at arc length `s` [m] with cross-track error `error` [m] and this correction of
        the law.

        Without a correction the tick is not learned from. |map| stays within `bound` [unit].
        """
        way, k = s - state.s, int(s % lap / lap * len(state.map_)) % len(state.map_)
        if int(s // lap) > state.lap:
            state = self._next_lap(state, int(s // lap), bound)
        keep = exp(-max(way, 0.0) / WINDOW_M)
        square = keep * state.square + (1.0 - keep) * error * error
        state = state._replace(s=s, since=state.since + max(way, 0.0), square=square)
        state = _met(state, k, error, correction)
        return self._returned(state) if self.guard and _worse_here(state, k) else state

    def learned(self, state: LapState, lap: float, bound: float, name: str) -> Learned:
        """Return the map of the quantity `name` for the next lap, and the best one with its error, by location."""
        if not len(state.map_):
            return {}
        state = self._next_lap(state, state.lap + 1, bound)
        known = state.best_rms < inf
        error = np.sqrt(state.best_square) if known else np.full(len(state.map_), UNKNOWN_M)
        values = state.map_, state.best, error, state.wanted
        place = lap * (np.arange(len(state.map_)) + 0.5) / len(state.map_)
        return {key: np.column_stack([place, value]) for key, value in zip(_names(name), values, strict=True)}

    def _next_lap(self, state: LapState, lap: int, bound: float) -> LapState:
        """Finish the lap: evaluate its map, learn from it, begin the next."""
        state = _met(state, -1, 0.0, None)
        ticks, square, learnt, corrected = state.cells.T
        fresh = state._replace(lap=lap, cells=np.zeros_like(state.cells), here=np.zeros_like(state.here), whole=True)
        if not (state.whole and np.mean(ticks > 0) > COMPLETE):
            return fresh
        correction = _smooth(corrected / np.maximum(learnt, 1.0), self.smoothing_m / GRID_M)
        fresh = fresh._replace(wanted=state.map_ + correction)
        rms = sqrt(float(square.sum() / ticks.sum()))
        if self.guard and rms > WORSE * state.best_rms + MARGIN_M:
            return self._returned(fresh)._replace(whole=True)
        if rms < state.best_rms:
            fresh = fresh._replace(best=state.map_, best_square=state.here, best_rms=rms)
        if not (share := self.gain * state.share):
            return fresh
        repeats = _repeats(state.wanted, fresh.wanted)
        map_ = np.clip(repeats * (state.map_ + share * correction), -bound, bound)
        return fresh._replace(map_=map_, before=state.map_, since=0.0)

    def _returned(self, state: LapState) -> LapState:
        """Return to the best map, or from that one to an empty map; its error must then be evaluated again."""
        learnt = not np.array_equal(state.map_, state.best)
        best = state.best if learnt else np.zeros_like(state.best)
        fading = state._replace(map_=best, before=state.map_, since=0.0, best=best, best_rms=inf, whole=False)
        return fading._replace(returns=state.returns + 1) if learnt else fading


def _met(state: LapState, k: int, error: float, correction: float | None) -> LapState:
    """Return the state with a tick at the location `k`; the values of the last location are stored when it is left."""
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
    """Return whether the error at location `k` is larger than that of the best lap there, and than that lap's mean."""
    best = max(sqrt(state.best_square[k]), state.best_rms)  # the first lap began without an error
    return sqrt(state.square) > WORSE_HERE * best + MARGIN_HERE_M


def _at(values: Array, turn: float) -> float:
    """`values` (n,) at the middles of n places round a lap, between them linearly, `turn` [laps]."""
    n = len(values)
    place = turn % 1.0 * n - 0.5
    k = int(place // 1.0)
    share = place - k
    return float((1.0 - share) * values[k % n] + share * values[(k + 1) % n])


def _smooth(values: Array, width: float) -> Array:
    """Return `values` (n,) of a lap, filtered with zero phase and the full width `width` at half maximum [places]."""
    sigma = width / sqrt(8.0 * log(2.0))
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(values))
    return np.fft.irfft(np.fft.rfft(values) * np.exp(-0.5 * (sigma * omega) ** 2), len(values))


def _repeats(before: Array, now: Array) -> float:
    """Return the fraction of a lap's map plus correction, by location, explained by the last lap [-]; 1 without one."""
    size = float(before @ before) * float(now @ now)
    return max(float(before @ now), 0.0) ** 2 / size if size else 1.0


def _names(name: str) -> tuple[str, str, str, str]:
    """Return the quantities of a map in a file: the map, the best one, the error of its lap, map plus correction of the
    last lap."""
    return name, f"{name}_best", f"{name}_best_error", f"{name}_wanted"


def _resampled(known: Learned | None, name: str, n: int, lap: float) -> Array:
    """Return a quantity of a file at the middles of n places of a lap [m]; zero without one."""
    if not known or name not in known:
        return np.zeros(n)
    place, value = known[name].T
    found: Array = np.interp(lap * (np.arange(n) + 0.5) / n, place, value)
    return found
