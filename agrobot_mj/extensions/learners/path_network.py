"""Network from the path to an angle or a speed: fixed interval type-2 sets, consequents that learn.

Inputs are what the path says beforehand, not the error: curvature ahead kappa [1/m], speed u [m/s], roll of the ground
phi [rad]. Triangular sets lie evenly over the range of each input and never move; a set's upper width is
(1 + uncertainty) and its lower width (1 - uncertainty) times the distance of the centres. The output is linear in the
consequents f:  y = f . w,  w = q w_lower + (1 - q) w_upper,  q = 1/2, with the normalised firing of the lower and of
the upper sets. With uncertainty 0 the bounds coincide and the network is of type 1.

A feedback e(t) tells what was wrong with the output a loop delay ago. So each rule keeps a trace of its firing, lagged
by about that delay, and the rules that were responsible learn:

    trace' = (w - trace) / lag,   f' = eta e trace / (trace . trace)

which moves the lagged output f . trace at the rate eta e, however many rules fire. f stays within its bound.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.t2fnn_laws import membership, normalised
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import NonNegative, Positive, Spec

Q = 0.5
"""Fraction of the lower firing in the output [-]."""
LEAST_TRACE = 0.01
"""Floor of trace . trace while the trace builds up; 1/N with N equal rules [-]."""


class PathInput(NamedTuple):
    """Inputs from the path and the ground."""

    curvature: float
    """Curvature of the path ahead, left positive [1/m]."""
    speed: float
    """Speed of the reference [m/s]."""
    roll: float = 0.0
    """Roll of the ground, left side up positive [rad]."""


class PathNetworkState(NamedTuple):
    """Consequents learned by the network, and the traces of its rules."""

    f: Array
    """Consequents, curvature slowest, roll fastest, shape (rules,) [unit of the output]."""
    trace: Array
    """Lagged firing, shape (rules,) [-]."""


class PathNetwork(Spec):
    """Fixed interval type-2 sets over curvature, speed and roll; consequents learned from a feedback."""

    eta: NonNegative = 0.2
    """Fraction of the feedback learned per second [1/s]. Assumed value (0.1-0.6); larger values oscillate."""
    trace_s: Positive = 0.4
    """Lag of the trace: delay and lag of the loop that answers the output [s]. Assumed value (0.2-0.8)."""
    uncertainty: float = Field(0.3, ge=0, lt=0.5)
    """Fraction of the distance of the centres by which the upper and lower widths differ [-]. Assumed value (0-0.49;
    then gaps)."""
    curvature_sets: int = Field(11, ge=1, le=51)
    """Number of sets of the curvature [-]. Assumed value (5-21): one each 0.1 1/m."""
    curvature_range_per_m: Positive = 0.5
    """Curvature of the outermost centres, either side [1/m]. Assumed value (0.3-0.7): 2 m, below the tightest turn."""
    speed_sets: int = Field(2, ge=1, le=21)
    """Number of sets of the speed, from 0 up [-]. Assumed value (1-5)."""
    speed_range_m_s: Positive = 3.0
    """Speed of the last centre [m/s]. Assumed value (2-5)."""
    roll_sets: int = Field(3, ge=1, le=21)
    """Number of sets of the roll [-]. Assumed value (1-7); needs `sensors.imu.enabled`."""
    roll_range_rad: Positive = 0.26
    """Roll of the outermost centres, either side [rad]. Assumed value (0.1-0.4)."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of sets of curvature, speed and roll."""
        return self.curvature_sets, self.speed_sets, self.roll_sets

    def init(self) -> PathNetworkState:
        """Return the state before anything is learned."""
        rules = int(np.prod(self.shape))
        return PathNetworkState(np.zeros(rules), np.zeros(rules))

    def firing(self, x: PathInput) -> Array:
        """w, the fraction of every rule in the output, shape (rules,)."""
        lower, upper = np.ones(1), np.ones(1)
        for value, sets in zip(x, _sets(self), strict=True):
            inside = min(max(value, sets.centres[0]), sets.centres[-1])  # beyond the range the outermost sets hold
            lower = np.outer(lower, membership(inside, sets.centres, sets.lower)).ravel()
            upper = np.outer(upper, membership(inside, sets.centres, sets.upper)).ravel()
        w: Array = Q * normalised(lower) + (1 - Q) * normalised(upper)
        return w

    def remembered(self, state: PathNetworkState, w: Array, dt: float) -> PathNetworkState:
        """Return the state with its trace after `dt` [s] in which the rules fired as `w`."""
        return state._replace(trace=state.trace + (w - state.trace) * dt / (self.trace_s + dt))

    def learnt(self, state: PathNetworkState, e: float, bound: float, dt: float) -> PathNetworkState:
        """Return the state with consequents updated by feedback `e` for `dt` [s], |f| <= `bound` [unit of the
        output]."""
        step = dt * self.eta * e * state.trace / max(float(state.trace @ state.trace), LEAST_TRACE)
        return state._replace(f=np.clip(state.f + step, -bound, bound))


class Sets(NamedTuple):
    """Fuzzy sets of one input of the network."""

    centres: Array
    """Centres of the sets [unit of the input]."""
    lower: Array
    """Widths of the lower sets [unit of the input]."""
    upper: Array
    """Widths of the upper sets [unit of the input]."""


@lru_cache(maxsize=16)
def _sets(network: PathNetwork) -> tuple[Sets, ...]:
    curvature, speed, roll = network.curvature_range_per_m, network.speed_range_m_s, network.roll_range_rad
    ranges = ((-curvature, curvature), (0.0, speed), (-roll, roll))
    return tuple(_evenly(n, *span, network.uncertainty) for n, span in zip(network.shape, ranges, strict=True))


def _evenly(n: int, low: float, high: float, uncertainty: float) -> Sets:
    """n sets from `low` to `high`; a single one, in the middle, always fires, since inputs are clipped to it."""
    centres = np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])
    distance = (high - low) / max(n - 1, 1)
    return Sets(centres, np.full(n, (1 - uncertainty) * distance), np.full(n, (1 + uncertainty) * distance))
