"""Steering-angle loop that identifies the dead band and gain of its valve on each side by recursive least squares.

The static valve map for steering to side i (left, right) outside the dead band d_i is: rate = g_i (v - d_i), with the
gain g_i. The spool voltage v is computed from the commanded voltage with the delay and lag given by the keys.

Each time segment in which v stays outside the dead band of one side gives one equation for g_i and g_i d_i. Both
parameters are updated with a forgetting factor and are limited. The equation does not hold if the wheels hardly turn in
the segment, or turn while v is inside the dead band. In these cases only d_i is changed, by a small amount.

The command is found by inverting the map for the rate that corrects the error within `answer_s`. The error refers to
the angle predicted for the end of the valve delay, because voltages already commanded are still effective until then.
The loop returns to the initial map if the learned map predicts steering rates less accurately than the initial map.
"""

from collections.abc import Sequence
from math import exp, radians
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import AngleLoop
from agrobot_mj.control.pid import clip
from agrobot_mj.core.learned import Learned, read_learned
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Column
from agrobot_mj.core.spec import Latency, Positive
from agrobot_mj.extensions.learners.learning import require_quantity

GAIN_SHARES, WIDEST_V = (0.15, 4.0), 3.0
"""Range of gain divided by initial gain [-], and maximum dead band [V]. Assumed values, from worn to fast valves."""
SHORTEST_S, LONGEST_S = 0.2, 0.4
"""Minimum and maximum duration of a time segment used for learning [s]. Assumed values, for which `NOISE` causes
steering-rate noise of 0.7 and 0.35 deg/s."""
SLOWEST_V, FASTEST_V = 0.05, 3.5
"""Minimum and maximum spool voltage for learning [V]. Assumed values: lower voltages are inside the dead band, higher
voltages reach the pump limit."""
UNSURE = (0.5, 0.5)
"""Initial standard deviations of the gain [fraction of the initial gain] and of the dead band [V]. Assumed values."""
NOISE = radians(0.1)
"""Standard deviation of the angle at segment ends [rad]. Assumed value for the mean of 100 potentiometer samples."""
MOVING, SHIFT = radians(1.0), 0.2
"""Mean steering rate above which the wheels count as turning in a time segment [rad/s], and fraction of the rate error
by which the dead-band offset is shifted at lower rates [-]. Assumed values: the rate is about twice its noise."""
MOST = radians(6.0)  # Maximum rate error used in an update [rad/s], which limits the effect of outliers. Assumed value.
JUDGED, TRUST = 30.0, 1.5
"""Number of time segments over which the errors of the learned and initial map are averaged, and maximum ratio of these
errors [-]. Assumed values."""
SIDES = ("left", "right")


class Side(NamedTuple):
    """Learned valve parameters for steering to one side."""

    gain: float  # Gain g [rad/(s V)]
    offset: float  # Product of gain and dead band, g d [rad/s]
    P: tuple[float, float, float]
    """Covariance matrix of gain and offset, as elements (gain, gain), (gain, offset) and (offset, offset)."""

    @property
    def dead_band(self) -> float:
        """Dead band d, the minimum spool voltage for oil flow [V]."""
        return self.offset / self.gain

    def rate(self, v: float) -> float:
        """Return the steering rate [rad/s] for a spool voltage `v` towards this side [V]."""
        return max(self.gain * v - self.offset, 0.0)


class Stretch(NamedTuple):
    """Time segment in which the spool stays on one side of neutral, and either inside or outside the dead band."""

    side: int = 0  # Side of the valve: 1 left, -1 right, 0 none
    beyond: bool = False  # Whether the spool was outside the estimated dead band
    time: float = 0.0  # Duration of the time segment so far [s]
    volts: float = 0.0  # Time integral of the spool voltage towards the side [V s]
    turned: float = 0.0  # Change of the steering angle towards the side [rad]


class AdaptiveState(NamedTuple):
    """State of the steering loop `AdaptiveLoop` between two ticks."""

    sides: tuple[Side, Side]  # Learned parameters of the left and the right side
    reference: float = 0.0  # Current setpoint of the steering angle [rad]
    under_way: tuple[float, ...] = ()
    """Commanded voltages relative to neutral that have not yet passed the valve delay [V], oldest first."""
    spool: float = 0.0  # Voltage at the spool relative to neutral [V]
    mean: float = 0.0  # Mean spool voltage over the last tick [V]
    steer: float | None = None  # Last measured steering angle [rad], or None before the first tick
    piece: Stretch = Stretch()  # Time segment in progress
    misses: tuple[float, float] = (0.0, 0.0)
    """Mean squared errors [rad2/s2] of the steering rates predicted by the learned map and by the initial map."""
    resets: int = 0


class AdaptiveLoop(AngleLoop):
    """Steering-angle loop that inverts a learned valve map and compensates the valve delay."""

    kind: Literal["adaptive"] = "adaptive"
    gain_deg_s_v: Positive = 6.0
    """Initial valve gain for both sides [deg/(s V)]. Assumed value: default valve and cylinder give 6-7 deg/(s V)."""
    dead_band_v: Annotated[float, Field(ge=0, le=WIDEST_V)] = 0.3
    """Initial dead band for both sides [V]. Assumed value. Values above the true dead band cause oscillation."""
    delay_s: Latency = 0.1
    """Delay of the valve [s], rounded to whole ticks. Assumed value, equal to the default of `Valve`."""
    lag_s: Positive = 0.1
    """Time constant of the spool [s]. Assumed value, equal to the default of `Valve`."""
    answer_s: Annotated[float, Field(ge=0.05, le=5)] = 0.25
    """Time for correcting a steering error [s]. Assumed value (range 0.15-0.5): longer than the lag of the spool."""
    tolerance_deg: Positive = 0.15
    """Maximum angle error without correction [deg]. Assumed value (range 0.1-0.4): twice the potentiometer noise."""
    forgetting: Annotated[float, Field(ge=0.9, le=1)] = 0.99
    """Fraction of information kept after a time segment [-]. Assumed value (range 0.97-0.999), which gives a memory of
    about one minute."""
    learn: bool = True
    """Whether the valve map is updated during the run."""
    file: Annotated[str, Field(min_length=1)] | None = None
    """Initial valve map: `learned.parquet` of an earlier run. Default: `gain_deg_s_v` and `dead_band_v`."""

    def check(self) -> None:
        """Check the initial valve map in `file`. Raises ValueError if the file is invalid."""
        if self.file is not None:
            require_quantity(self.file, *_quantities())

    def init(self) -> AdaptiveState:
        """Return the initial state of the loop, with the valve map from `file` or from the keys."""
        first = self._first()
        if self.file is not None:
            known = read_learned(self.file)
            (g_l, g_r), (d_l, d_r) = ([float(known[f"{name}_{side}"][0, 1]) for side in SIDES] for name in _NAMES)
            left, right = first
            left, right = left._replace(gain=g_l, offset=g_l * d_l), right._replace(gain=g_r, offset=g_r * d_r)
            first = self._within(left), self._within(right)
        return AdaptiveState(first, under_way=(0.0,) * round(self.delay_s / TICK_S))

    def update(self, state: AdaptiveState, wanted: float, steer: float, dt: float) -> tuple[AdaptiveState, float]:
        """Learn from the last tick. Return the new state, and the valve voltage that corrects the predicted angle error
        [V]."""
        state = self._learn(state, steer, dt) if state.steer is not None else state
        error = wanted - steer - self._coming(state, dt)
        volts = 0.0
        if abs(error) > radians(self.tolerance_deg):
            side = state.sides[0 if error > 0 else 1]
            volts = clip((abs(error) / self.answer_s + side.offset) / side.gain, 0.0, NEUTRAL_V)
            volts = volts if error > 0 else -volts
        arriving, *later = *state.under_way, volts
        spool, mean = self._spool(state.spool, arriving, dt)
        state = state._replace(reference=wanted, under_way=tuple(later), spool=spool, mean=mean, steer=steer)
        return state, NEUTRAL_V + volts

    def _spool(self, spool: float, arriving: float, dt: float) -> tuple[float, float]:
        """Return the spool voltage at the end of a time step `dt` [s], and its mean over the step [V]. `arriving` is
        the constant input voltage of the spool."""
        keep, rest = exp(-dt / self.lag_s), spool - arriving
        return arriving + keep * rest, arriving + (1.0 - keep) * self.lag_s / dt * rest

    def _coming(self, state: AdaptiveState, dt: float) -> float:
        """Return the change of the steering angle that the delayed voltages will cause [rad]."""
        spool, angle = state.spool, 0.0
        for arriving in (*state.under_way, 0.0, 0.0):
            spool, mean = self._spool(spool, arriving, dt)
            angle += dt * _rate(state.sides, mean)
        return angle

    def _learn(self, state: AdaptiveState, steer: float, dt: float) -> AdaptiveState:
        """Return the state with the last tick added to the time segment. A completed segment updates the valve map."""
        v, turned = state.mean, steer - (state.steer or 0.0)
        side, inside = 1 if v > 0 else -1, not SLOWEST_V < abs(v) < FASTEST_V
        beyond = abs(v) > state.sides[0 if v > 0 else 1].dead_band
        piece = state.piece
        if piece.side and (inside or (side, beyond) != piece[:2] or piece.time >= LONGEST_S - 0.5 * dt):
            if piece.time >= SHORTEST_S - 0.5 * dt and self.learn:
                state = self._fit(state, piece)
            piece = Stretch()
        if not inside:
            piece = Stretch(side, beyond, piece.time + dt, piece.volts + dt * abs(v), piece.turned + side * turned)
        return state._replace(piece=piece)

    def _fit(self, state: AdaptiveState, piece: Stretch) -> AdaptiveState:
        """Return the state after learning the parameters of one valve side from the time segment `piece`, by the
        equation rate = gain v - offset with the mean spool voltage v of the segment."""
        number, first = (0 if piece.side > 0 else 1), self._first()
        side, v, rate = state.sides[number], piece.volts / piece.time, piece.turned / piece.time
        noise = 2.0 * (NOISE / piece.time) ** 2
        squares = ((known.rate(v) - rate) ** 2 for known in (side, first[number]))
        misses = [m + (min(square, 1.0) - m) / JUDGED for m, square in zip(state.misses, squares, strict=True)]
        sides = list(state.sides)
        if piece.beyond and rate > MOVING:
            side = _update_parameters(side, v, rate, noise, self.forgetting)
        elif piece.beyond or rate > MOVING:
            side = side._replace(offset=side.offset + SHIFT * (side.rate(v) - rate))
        sides[number] = self._within(side)
        state = state._replace(sides=(sides[0], sides[1]), misses=(misses[0], misses[1]))
        if misses[0] > TRUST * misses[1] + noise:
            return state._replace(sides=first, misses=(0.0, 0.0), resets=state.resets + 1)
        return state

    def _within(self, side: Side) -> Side:
        """Return the valve parameters of a side, limited to the bounds of gain and dead band."""
        low, high = (share * radians(self.gain_deg_s_v) for share in GAIN_SHARES)
        gain = clip(side.gain, low, high)
        dead_band = clip(side.dead_band, 0.0, WIDEST_V) if side.gain > 0.0 else 0.0
        return side._replace(gain=gain, offset=gain * dead_band)

    def _first(self) -> tuple[Side, Side]:
        g, d = radians(self.gain_deg_s_v), self.dead_band_v
        share, band = UNSURE
        P = ((share * g) ** 2, share**2 * g * g * d, (share * g * d) ** 2 + (g * band) ** 2)
        return Side(g, g * d, P), Side(g, g * d, P)

    def learned(self, state: AdaptiveState) -> Learned:
        """Return the learned gain [rad/(s V)] and dead band [V] of the valve for each side, by name of the quantity."""
        values = zip(_quantities(), self._valve(state), strict=True)
        return {name: np.array([[np.nan, value]]) for name, value in values}

    @staticmethod
    def _valve(state: AdaptiveState) -> tuple[float, ...]:
        return (*(side.gain for side in state.sides), *(side.dead_band for side in state.sides))

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the learned valve map, and of the number of its resets to the initial map."""
        about = (("rad/(s V)", "steering rate per volt beyond the dead band"), ("V", "dead band"))
        valve = [
            Column(f"{name}_{side}", unit, f"learned {text} of the valve, steering {side}")
            for name, (unit, text) in zip(_NAMES, about, strict=True)
            for side in SIDES
        ]
        return (*valve, Column("valve_resets", "-", "number of resets of the learned valve to the initial one"))

    def report(self, state: AdaptiveState) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        return (*self._valve(state), float(state.resets))


_NAMES = ("valve_gain", "valve_dead_band")


def _quantities() -> list[str]:
    return [f"{name}_{side}" for name in _NAMES for side in SIDES]


def _rate(sides: tuple[Side, Side], v: float) -> float:
    """Return the steering rate [rad/s] at the spool voltage `v` relative to neutral [V], positive to the left."""
    return sides[0].rate(v) if v > 0 else -sides[1].rate(-v)


def _update_parameters(side: Side, v: float, rate: float, noise: float, forgetting: float) -> Side:
    """Return the valve parameters after one least-squares update with the equation rate = gain v - offset. `noise` is
    the variance of the rate [rad2/s2]. Forgetting increases the covariance only in the excited direction."""
    a, b, c = side.P
    g_1, g_2 = a * v - b, b * v - c  # P phi with phi = (v, -1)
    total = g_1 * v - g_2 + noise
    miss = clip(rate - (side.gain * v - side.offset), -MOST, MOST)
    k_1, k_2 = g_1 / total, g_2 / total
    share = 1.0 / forgetting - 1.0
    P = (a - k_1 * g_1 + share * k_1 * g_1, b - k_1 * g_2 + share * k_1 * g_2, c - k_2 * g_2 + share * k_2 * g_2)
    return Side(side.gain + k_1 * miss, side.offset + k_2 * miss, P)
