"""Steering loop that learns its valve: dead band and gain on each side, by recursive least squares.

The valve's static map beyond its dead band d, steering to the side i: rate = g_i (v - d_i), v the voltage at the spool:
the one sent, after the delay and the lag that are given here. How far the wheels turned in a segment of time in which v
stayed beyond the dead band of one side is one equation for (g_i, g_i d_i), which are updated with forgetting and
projected onto bounds. Where they hardly turned, or turned although v was within the dead band, the equation does not
hold for all of the time: then d_i alone is moved, a little.

The voltage is the inverse of the map for the rate that takes the error away in `answer_s`; the error is that of the
angle predicted for the end of the delay, so that voltages under way are not sent a second time.

Guard: the learned map has to predict the wheels' turns no worse than the one it began with; where it does, it begins
again with that one.
"""

from collections.abc import Sequence
from math import exp, radians
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import AngleLoop
from agrobot_mj.control.pid import clip
from agrobot_mj.core.learned import Learned, read_learned, require_quantity
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Column
from agrobot_mj.core.spec import Latency, Positive

GAIN_SHARES, WIDEST_V = (0.15, 4.0), 3.0
"""Bounds of the gain relative to the initial one [-], and of the dead band [V]. Assumed value: a worn-out valve, a
machine twice as fast."""
SHORTEST_S, LONGEST_S = 0.2, 0.4
"""Length of the time segments used for learning [s]. Assumed value: 0.07 deg of noise are then 0.4 deg/s."""
SLOWEST_V, FASTEST_V = 0.05, 3.5
"""Range of voltages used for learning [V]. Assumed value: below it no valve moves, above it the pump may be the limit.
"""
UNSURE = (0.5, 0.5)
"""Initial standard deviation of gain and dead band [fraction of the gain, V]. Assumed value."""
NOISE = radians(0.1)
"""Noise of the angle at both ends of a time segment [rad]. Assumed value: 100 samples of a potentiometer."""
MOVING, SHIFT = radians(1.0), 0.2
"""Mean rate above which the wheels turned during the complete segment [rad/s], and fraction of the prediction error by
which the dead band is otherwise shifted [-]. Assumed value: twice the noise of the rate."""
MOST = radians(6.0)
"""Maximum error of a predicted rate, which limits the effect of a jumping measurement [rad/s]. Assumed value."""
JUDGED, TRUST = 30.0, 1.5
"""Number of time segments for the comparison of both maps, and allowed ratio of the learned map's error [-]. Assumed
value."""
SIDES = ("left", "right")


class Side(NamedTuple):
    """Learned parameters of one side of the valve."""

    gain: float
    """Gain g [rad/(s V)]."""
    offset: float
    """Product of gain and dead band, g d [rad/s]."""
    P: tuple[float, float, float]
    """Covariance of both relative to that of an equation: (gain, gain), (gain, offset), (offset, offset)."""

    @property
    def dead_band(self) -> float:
        """Dead band d [V]."""
        return self.offset / self.gain

    def rate(self, v: float) -> float:
        """Return the rate [rad/s] at a voltage `v` towards this side [V]."""
        return max(self.gain * v - self.offset, 0.0)


class Stretch(NamedTuple):
    """Time segment in which the spool stayed on one side, and inside or outside its dead band."""

    side: int = 0
    """Side: 1 left, -1 right, 0 none."""
    beyond: bool = False
    """Whether the spool was outside the dead band, as far as known."""
    time: float = 0.0
    """Duration of the time segment [s]."""
    volts: float = 0.0
    """Integral of the spool's voltage towards that side [V s]."""
    turned: float = 0.0
    """Turn of the wheels towards that side [rad]."""


class AdaptiveState(NamedTuple):
    """State of `AdaptiveLoop`."""

    sides: tuple[Side, Side]
    """Learned parameters of left and right side."""
    reference: float = 0.0
    """Current reference of the steering angle [rad]."""
    under_way: tuple[float, ...] = ()
    """Voltages relative to neutral that have not reached the spool, oldest first [V]."""
    spool: float = 0.0
    """Voltage at the spool relative to neutral [V]."""
    mean: float = 0.0
    """Mean spool voltage over the last tick [V]."""
    steer: float | None = None
    """Last measured angle; None before the first tick [rad]."""
    piece: Stretch = Stretch()
    """Time segment in progress."""
    misses: tuple[float, float] = (0.0, 0.0)
    """Mean squared error of the rates predicted by the learned map and by the initial one [rad2/s2]."""
    resets: int = 0
    """Number of resets to the initial map."""


class AdaptiveLoop(AngleLoop):
    """Inverse of a learned valve map, with compensated delay."""

    kind: Literal["adaptive"] = "adaptive"
    gain_deg_s_v: Positive = 6.0
    """Initial gain of both sides [deg/(s V)]. Assumed value: 6-7 for the default valve and cylinder."""
    dead_band_v: Annotated[float, Field(ge=0, le=WIDEST_V)] = 0.3
    """Initial dead band of both sides [V]. Assumed value: below the true band; else the loop oscillates at first."""
    delay_s: Latency = 0.1
    """Delay of the valve in whole ticks [s]. Assumed value, that of `Valve`."""
    lag_s: Positive = 0.1
    """Lag of the spool [s]. Assumed value, that of `Valve`."""
    answer_s: Annotated[float, Field(ge=0.05, le=5)] = 0.25
    """Time in which the loop corrects a steering error [s]. Assumed value (0.15-0.5): above the lag of the spool."""
    tolerance_deg: Positive = 0.15
    """Angle error that is not corrected [deg]. Assumed value (0.1-0.4): twice the potentiometer's noise."""
    forgetting: Annotated[float, Field(ge=0.9, le=1)] = 0.99
    """Fraction of the information kept between time segments [-]. Assumed value (0.97-0.999): about a minute."""
    learn: bool = True
    """Whether learning is enabled."""
    file: Annotated[str, Field(min_length=1)] | None = None
    """Initial valve: `learned.parquet` of an earlier run. Default: that of the keys."""

    def check(self) -> None:
        """Read the file. Raises ValueError."""
        if self.file is not None:
            require_quantity(self.file, *_quantities())

    def init(self) -> AdaptiveState:
        """Return the state at rest, with the valve of the keys or of the file."""
        first = self._first()
        if self.file is not None:
            known = read_learned(self.file)
            (g_l, g_r), (d_l, d_r) = ([float(known[f"{name}_{side}"][0, 1]) for side in SIDES] for name in _NAMES)
            left, right = first
            left, right = left._replace(gain=g_l, offset=g_l * d_l), right._replace(gain=g_r, offset=g_r * d_r)
            first = self._within(left), self._within(right)
        return AdaptiveState(first, under_way=(0.0,) * round(self.delay_s / TICK_S))

    def update(self, state: AdaptiveState, wanted: float, steer: float, dt: float) -> tuple[AdaptiveState, float]:
        """Learn from the last tick, then return the voltage [V] for the rate that corrects the predicted error."""
        state = self._learnt(state, steer, dt) if state.steer is not None else state
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
        """Return the voltage at the spool after `dt` [s] of an arriving voltage, and its mean in that time [V]."""
        keep, rest = exp(-dt / self.lag_s), spool - arriving
        return arriving + keep * rest, arriving + (1.0 - keep) * self.lag_s / dt * rest

    def _coming(self, state: AdaptiveState, dt: float) -> float:
        """Return the change of steering angle due to voltages still delayed by the valve [rad]."""
        spool, angle = state.spool, 0.0
        for arriving in (*state.under_way, 0.0, 0.0):
            spool, mean = self._spool(spool, arriving, dt)
            angle += dt * _rate(state.sides, mean)
        return angle

    def _learnt(self, state: AdaptiveState, steer: float, dt: float) -> AdaptiveState:
        """Return the state with the last tick's turn added to the time segment, learning at the end of a segment."""
        v, turned = state.mean, steer - (state.steer or 0.0)
        side, inside = 1 if v > 0 else -1, not SLOWEST_V < abs(v) < FASTEST_V
        beyond = abs(v) > state.sides[0 if v > 0 else 1].dead_band
        piece = state.piece
        if piece.side and (inside or (side, beyond) != piece[:2] or piece.time >= LONGEST_S - 0.5 * dt):
            if piece.time >= SHORTEST_S - 0.5 * dt and self.learn:
                state = self._fitted(state, piece)
            piece = Stretch()
        if not inside:
            piece = Stretch(side, beyond, piece.time + dt, piece.volts + dt * abs(v), piece.turned + side * turned)
        return state._replace(piece=piece)

    def _fitted(self, state: AdaptiveState, piece: Stretch) -> AdaptiveState:
        """Return the state updated by a segment's equation, rate = gain v - offset, by recursive least squares."""
        number, first = (0 if piece.side > 0 else 1), self._first()
        side, v, rate = state.sides[number], piece.volts / piece.time, piece.turned / piece.time
        noise = 2.0 * (NOISE / piece.time) ** 2
        squares = ((known.rate(v) - rate) ** 2 for known in (side, first[number]))
        misses = [m + (min(square, 1.0) - m) / JUDGED for m, square in zip(state.misses, squares, strict=True)]
        sides = list(state.sides)
        if piece.beyond and rate > MOVING:
            side = _updated(side, v, rate, noise, self.forgetting)
        elif piece.beyond or rate > MOVING:
            side = side._replace(offset=side.offset + SHIFT * (side.rate(v) - rate))
        sides[number] = self._within(side)
        state = state._replace(sides=(sides[0], sides[1]), misses=(misses[0], misses[1]))
        if misses[0] > TRUST * misses[1] + noise:
            return state._replace(sides=first, misses=(0.0, 0.0), resets=state.resets + 1)
        return state

    def _within(self, side: Side) -> Side:
        """Return the side projected onto the bounds of gain and dead band."""
        low, high = (share * radians(self.gain_deg_s_v) for share in GAIN_SHARES)
        gain = clip(side.gain, low, high)
        dead_band = clip(side.dead_band, 0.0, WIDEST_V) if side.gain > 0.0 else 0.0
        return side._replace(gain=gain, offset=gain * dead_band)

    def _first(self) -> tuple[Side, Side]:
        """Return the valve of the keys with its initial uncertainty."""
        g, d = radians(self.gain_deg_s_v), self.dead_band_v
        share, band = UNSURE
        P = ((share * g) ** 2, share**2 * g * g * d, (share * g * d) ** 2 + (g * band) ** 2)
        return Side(g, g * d, P), Side(g, g * d, P)

    def learned(self, state: AdaptiveState) -> Learned:
        """Return the gain [rad/(s V)] and dead band [V] of both sides."""
        values = zip(_quantities(), self._valve(state), strict=True)
        return {name: np.array([[np.nan, value]]) for name, value in values}

    @staticmethod
    def _valve(state: AdaptiveState) -> tuple[float, ...]:
        return (*(side.gain for side in state.sides), *(side.dead_band for side in state.sides))

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the learned valve, and of the number of resets."""
        about = (("rad/(s V)", "steering rate per volt beyond the dead band"), ("V", "dead band"))
        valve = [
            Column(f"{name}_{side}", unit, f"learnt {text} of the valve, steering {side}")
            for name, (unit, text) in zip(_NAMES, about, strict=True)
            for side in SIDES
        ]
        return (*valve, Column("valve_resets", "-", "how often the learnt valve was given up for the first one"))

    def report(self, state: AdaptiveState) -> Sequence[float]:
        """Return the values of `columns`."""
        return (*self._valve(state), float(state.resets))


_NAMES = ("valve_gain", "valve_dead_band")


def _quantities() -> list[str]:
    return [f"{name}_{side}" for name in _NAMES for side in SIDES]


def _rate(sides: tuple[Side, Side], v: float) -> float:
    """Return the rate [rad/s] at the spool voltage relative to neutral [V], left positive."""
    return sides[0].rate(v) if v > 0 else -sides[1].rate(-v)


def _updated(side: Side, v: float, rate: float, noise: float, forgetting: float) -> Side:
    """Return the side updated by the equation rate = gain v - offset with this variance of its noise [rad2/s2].

    Forgetting increases the covariance only along the excited direction.
    """
    a, b, c = side.P
    g_1, g_2 = a * v - b, b * v - c  # P phi with phi = (v, -1)
    total = g_1 * v - g_2 + noise
    miss = clip(rate - (side.gain * v - side.offset), -MOST, MOST)
    k_1, k_2 = g_1 / total, g_2 / total
    share = 1.0 / forgetting - 1.0
    P = (a - k_1 * g_1 + share * k_1 * g_1, b - k_1 * g_2 + share * k_1 * g_2, c - k_2 * g_2 + share * k_2 * g_2)
    return Side(side.gain + k_1 * miss, side.offset + k_2 * miss, P)
