"""Interval type-2 fuzzy neural network (A2-C0 TSK) with the sliding-mode learning laws of the paper, section IV.

Inputs x1, x2 (here the yaw-rate error [rad/s] and its derivative [rad/s2]), learning error tau_c and output tau_n
[rad]; the steering is tau_c - tau_n. I x J rules; sizes are those of the state's arrays. Centres and widths have the
unit of their input, f that of the output.

The printed laws are singular in places. Six guards, each named beside its line, make them safe:
1. centres start about the first input, which so lies inside every set; 2. denominators keep a floor, sign preserved;
3. widths keep their limits, their order and the input inside the set; 4. q keeps to [0, 1]; 5. no rule fires: weights
are 0; 6. learning can be held. Inputs are clipped to a bound (the paper's B_x), so that arithmetic stays finite.

With centres following, the laws of the widths leave every normalised firing where it is (appendix A of the paper), and
the network is an integrator: d tau_n/dt = -alpha sgn(tau_c), twice that while q adapts.
"""

from typing import Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.control.t2fnn_laws import adapted_widths, firing, laws, output, sgn
from agrobot_mj.signals import Array
from agrobot_mj.spec import Fraction, Positive, Spec

def _offsets(n: int, spread: float) -> Array:
    """Evenly spaced, shifted by a quarter of a space: a set centred on the input would never change, which breaks
    the cancellation in appendix A of the paper."""
    return spread * (2 * np.arange(n) - (n - 1) + 0.5) / n


class T2FnnState(NamedTuple):
    """Parameters of the network and the inputs they were last moved with."""

    c1: Array
    """Centres of the sets of x1, shape (I,) [unit of x1]."""
    c2: Array
    """Centres of the sets of x2, shape (J,) [unit of x2]."""
    d1_lower: Array
    """Widths of the lower sets of x1, shape (I,) [unit of x1]."""
    d1_upper: Array
    """Widths of the upper sets of x1, shape (I,) [unit of x1]."""
    d2_lower: Array
    """Widths of the lower sets of x2, shape (J,) [unit of x2]."""
    d2_upper: Array
    """Widths of the upper sets of x2, shape (J,) [unit of x2]."""
    f: Array
    """Consequents, shape (I, J) [rad]."""
    q: float
    """Share of the lower firing in the output [-]."""
    x1: float | None = None
    """Input of the last update; None: unknown, the centres stay at the next update [unit of x1]."""
    x2: float | None = None
    """Input of the last update; None: unknown, the centres stay at the next update [unit of x2]."""


class Rates(NamedTuple):
    """Right-hand sides of the printed laws, shapes as in `T2FnnState`, per second."""

    d1_lower: Array
    d1_upper: Array
    d2_lower: Array
    d2_upper: Array
    f: Array
    q: float


class T2Fnn(Spec):
    """The network and its learning laws. Unmarked numbers are estimates; the paper prints delta_s and the floor only."""

    alpha: Positive = 0.05
    """Learning rate; Theorem 1 asks for more than the rate of the rest of the loop [rad/s]. Estimate."""
    delta_s: Positive = 0.05
    """Smoothing of the sign function [rad]. Paper."""
    rules_1: int = Field(3, ge=1, le=50)
    """I, number of sets of x1 [-]. Estimate."""
    rules_2: int = Field(3, ge=1, le=50)
    """J, number of sets of x2 [-]. Estimate."""
    spread_1: Positive = 0.5
    """Centres of x1 start within this distance of the first input [unit of x1]. Estimate."""
    spread_2: Positive = 0.5
    """Centres of x2 start within this distance of the first input [unit of x2]. Estimate."""
    width_lower_1: Positive = 0.6
    """Initial width of the lower sets of x1 [unit of x1]. Estimate."""
    width_upper_1: Positive = 0.9
    """Initial width of the upper sets of x1 [unit of x1]. Estimate."""
    width_lower_2: Positive = 0.6
    """Initial width of the lower sets of x2 [unit of x2]. Estimate."""
    width_upper_2: Positive = 0.9
    """Initial width of the upper sets of x2 [unit of x2]. Estimate."""
    d_min: Positive = 0.001
    """Smallest width [unit of the input]. Estimate."""
    d_max: Positive = 100.0
    """Largest width [unit of the input]. Estimate."""
    f_init: float = 0.01
    """Size of the initial consequents [rad]. Estimate."""
    q_init: Fraction = 0.5
    """Initial share of the lower firing [-]. Estimate."""
    centres: Literal["follow", "fixed"] = "follow"
    """Whether centres move with the inputs (the paper) or stay [-]."""
    adapt_widths: bool = True
    """Whether widths learn (the paper) [-]."""
    adapt_q: bool = True
    """Whether q learns (the paper) [-]."""
    type_1: bool = False
    """Lower bounds coincide with the upper ones and q, then without effect, rests [-]."""
    floor: Positive = 0.001
    """Smallest magnitude of a denominator [unit of the denominator]. Paper."""
    input_bound: Positive = 1e6
    """Inputs are clipped to this magnitude, the paper's B_x [unit of the input]. Estimate."""

    @model_validator(mode="after")
    def _first_input_inside_every_set(self) -> Self:
        for k, spread, lower, upper in (
            (1, self.spread_1, self.width_lower_1, self.width_upper_1),
            (2, self.spread_2, self.width_lower_2, self.width_upper_2),
        ):
            if not self.d_min <= lower <= upper <= self.d_max:
                raise ValueError(f"width_lower_{k} <= width_upper_{k} must hold, both between d_min and d_max")
            if lower < spread:
                raise ValueError(f"width_lower_{k}: below spread_{k}, a set would miss the first input for ever")
        return self

    def init(self, x1: float, x2: float) -> T2FnnState:
        """The network before its first update, its sets laid about the first inputs x1, x2."""
        x1, x2 = self._bounded(x1), self._bounded(x2)
        c1, c2 = x1 + _offsets(self.rules_1, self.spread_1), x2 + _offsets(self.rules_2, self.spread_2)  # guard 1
        d1_upper, d2_upper = np.full(self.rules_1, self.width_upper_1), np.full(self.rules_2, self.width_upper_2)
        d1_lower, d2_lower = np.full(self.rules_1, self.width_lower_1), np.full(self.rules_2, self.width_lower_2)
        if self.type_1:
            d1_lower, d2_lower = d1_upper, d2_upper
        W_lower, W_upper = firing(x1, x2, c1, c2, d1_lower, d1_upper, d2_lower, d2_upper)
        # Guard 4: with F(W_lower - W_upper) near 0 the first step would throw q to a limit; these signs keep it away.
        f = np.where(W_lower >= W_upper, self.f_init, -self.f_init)
        return T2FnnState(c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f, self.q_init, x1, x2)

    def infer(self, state: T2FnnState, x1: float, x2: float) -> float:
        """tau_n [rad] at the inputs x1, x2, the state as it is (centres do not follow)."""
        W_lower, W_upper = firing(self._bounded(x1), self._bounded(x2), *state[:6])
        return float(output(W_lower, W_upper, state.f, state.q))

    def derivatives(self, state: T2FnnState, x1: float, x2: float, tau_c: float) -> Rates:
        """Right-hand sides of the printed laws for widths, f and q, floors (guard 2) included; changes nothing."""
        return Rates(*self._laws(state, self._bounded(x1), self._bounded(x2), tau_c)[1:])

    def update(
        self, state: T2FnnState, x1: float, x2: float, tau_c: float, dt: float, learn: bool = True
    ) -> tuple[T2FnnState, float]:
        """Move the centres, infer tau_n [rad], then learn from tau_c [rad] for dt [s]; guard 6: `learn=False` holds."""
        x1, x2 = self._bounded(x1), self._bounded(x2)
        state = self._followed(state, x1, x2)
        tau_n, *rates = self._laws(state, x1, x2, tau_c)
        return (self._learnt(state, Rates(*rates), dt) if learn else state), float(tau_n)

    def _bounded(self, x: float) -> float:
        return min(max(x, -self.input_bound), self.input_bound)

    def _followed(self, state: T2FnnState, x1: float, x2: float) -> T2FnnState:
        c1, c2 = state.c1, state.c2
        if self.centres == "follow" and state.x1 is not None and state.x2 is not None:
            c1 = c1 + (x1 - state.x1)  # [agrobots: 16]
            c2 = c2 + (x2 - state.x2)  # [agrobots: 16ek]
        return state._replace(c1=c1, c2=c2, x1=x1, x2=x2)

    def _laws(self, state: T2FnnState, x1: float, x2: float, tau_c: float) -> tuple[float, *tuple[Array, ...], float]:
        s = sgn(self._bounded(tau_c), self.delta_s)
        return laws(x1, x2, *state[:8], self.alpha * s, self.floor)  # type: ignore[no-any-return]

    def _learnt(self, state: T2FnnState, rates: Rates, dt: float) -> T2FnnState:
        d1_lower, d1_upper, d2_lower, d2_upper = state[2:6]
        if self.adapt_widths:
            changes = [dt * rate for rate in rates[:4]]
            limits = (self.d_min, self.d_max)
            d1_lower, d1_upper = adapted_widths(state.x1, state.c1, d1_lower, d1_upper, *changes[:2], *limits)
            d2_lower, d2_upper = adapted_widths(state.x2, state.c2, d2_lower, d2_upper, *changes[2:], *limits)
        if self.type_1:
            d1_lower, d2_lower = d1_upper, d2_upper
        q = state.q + dt * rates.q
        if not self.adapt_q or self.type_1 or not 0 <= q <= 1:  # guard 4: tuning is off at the limits
            q = state.q
        f = state.f + dt * rates.f
        return T2FnnState(state.c1, state.c2, d1_lower, d1_upper, d2_lower, d2_upper, f, q, state.x1, state.x2)


class T1Fnn(T2Fnn):
    """The same network with bounds that coincide: a type-1 fuzzy neural network."""

    type_1: Literal[True] = True
    """Bounds coincide, always [-]."""
