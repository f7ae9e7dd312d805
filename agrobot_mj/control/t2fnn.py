"""Interval type-2 fuzzy neural network (A2-C0 TSK) with sliding-mode learning: the paper, section IV.

Inputs: x1, x2 (the yaw-rate error [rad/s] and its derivative [rad/s2]) and the learning error tau_c [rad]. Output:
tau_n [rad]; the steering angle is tau_c - tau_n. The equations are in `t2fnn_laws`; the state defines the array sizes.

Six guards handle singularities of the learning laws in the paper. Comments mark the lines of the guards:
1. centres start around the first input value, so that every set contains it (else the network stays inactive, because
equations `16` and `16ek` keep x - c constant);
2. denominators have a minimum magnitude and keep their sign (paper);
3. width updates respect limits and order and keep the input inside each set: a large Euler step cannot overshoot;
4. the weight q of the lower sets stays within [0, 1]: updates that would leave the interval are omitted (paper);
5. the normalised firing is 0 if no rule fires;
6. learning can be disabled, for example while the steering saturates.

Inputs are clipped to a bound (the paper's B_x) to keep the arithmetic finite. With `centres = "follow"` the width laws
do not change the normalised firing (appendix A). The network is then an integrator: d tau_n/dt = -alpha sgn(tau_c), and
twice this rate while q adapts with a denominator above its minimum.
"""

from functools import lru_cache
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.control.t2fnn_laws import Learning, Network, T2FnnState, firing, inference, tick
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held
from agrobot_mj.core.signals import Array, Column
from agrobot_mj.core.spec import Fraction, Positive, Spec

__all__ = ["T1Fnn", "T2Fnn", "T2FnnState"]


class T2Fnn(Spec):
    """Type-2 fuzzy neural network with its learning laws. The paper states only the values of `delta_s` and `floor`."""

    alpha: Positive = 0.02
    """Learning rate [rad/s], bounded below by Theorem 1. Assumed value from tuning; 0.02 with `gains = "paper"`."""
    delta_s: Positive = 0.05
    """Smoothing width of the sign function [rad]. Paper."""
    rules_1: int = Field(3, ge=1, le=50)
    """Number of fuzzy sets of the first input [-]. Assumed value (range 2-9)."""
    rules_2: int = Field(3, ge=1, le=50)
    """Number of fuzzy sets of the second input [-]. Assumed value (range 2-9)."""
    spread_1: Positive = 0.5
    """Maximum initial distance of the fuzzy-set centres from the first value of x1 [unit of x1]. Assumed value (range
    0.1-1): the yaw-rate error of a turn in the wrong direction."""
    spread_2: Positive = 0.5
    """Maximum initial distance of the fuzzy-set centres from the first value of x2 [unit of x2]. Assumed value (range
    0.1-1)."""
    width_lower_1: Positive = 0.6
    """Initial width of the lower sets of input x1 [unit of x1]. Assumed value, above `spread_1`."""
    width_upper_1: Positive = 0.9
    """Initial width of the upper sets of input x1 [unit of x1]. Assumed value, above `width_lower_1`."""
    width_lower_2: Positive = 0.6
    """Initial width of the lower sets of input x2 [unit of x2]. Assumed value, above `spread_2`."""
    width_upper_2: Positive = 0.9
    """Initial width of the upper sets of input x2 [unit of x2]. Assumed value, above `width_lower_2`."""
    d_min: Positive = 0.001
    """Minimum width of a fuzzy set [unit of the input]. Assumed value, at which a set is almost a single point."""
    d_max: Positive = 100.0
    """Maximum width of a fuzzy set [unit of the input]. Assumed value, at which a set contains all inputs."""
    f_init: Positive = 0.01
    """Magnitude of the initial rule consequents [rad]. Assumed value; 0 would move q to its limit at once (guard 4)."""
    q_init: Fraction = 0.5
    """Initial weight q of the lower firing strengths [-]. Assumed value: the middle of [0, 1]."""
    centres: Literal["follow", "fixed"] = "follow"
    """Whether the centres of the fuzzy sets follow the inputs (as in the paper) or are fixed."""
    adapt_widths: bool = True
    """Whether to learn the widths of the fuzzy sets. Default: true, as in the paper."""
    adapt_q: bool = True
    """Whether to learn the weight q of the lower firing strengths. Default: true, as in the paper."""
    type_1: ClassVar[bool] = False
    """Whether the lower fuzzy sets equal the upper sets; the weight q is then constant and has no effect."""
    floor: Positive = 0.001
    """Minimum magnitude of denominators in the learning laws [unit of the denominator]. Paper."""
    input_bound: Positive = 1e6
    """Magnitude at which inputs are clipped, the paper's B_x [unit of the input]. Assumed value to prevent overflow."""

    @model_validator(mode="after")
    def _check_fuzzy_sets(self) -> Self:
        for k, spread, lower, upper in (
            (1, self.spread_1, self.width_lower_1, self.width_upper_1),
            (2, self.spread_2, self.width_lower_2, self.width_upper_2),
        ):
            if not self.d_min <= lower <= upper <= self.d_max:
                raise ValueError(f"width_lower_{k}: must satisfy d_min <= width_lower_{k} <= width_upper_{k} <= d_max")
            if lower < spread:
                raise ValueError(
                    f"width_lower_{k}: must be at least spread_{k}, otherwise the fuzzy set stays inactive"
                )
        return self

    def init(self, x1: float, x2: float) -> T2FnnState:
        """Return the initial state, with fuzzy sets centred around the first values of x1 and x2 (guard 1)."""
        x1, x2 = self._bound(x1), self._bound(x2)
        c1 = x1 + _offsets(self.rules_1, self.spread_1)
        c2 = x2 + _offsets(self.rules_2, self.spread_2)
        d1_upper, d2_upper = np.full_like(c1, self.width_upper_1), np.full_like(c2, self.width_upper_2)
        d1_lower, d2_lower = np.full_like(c1, self.width_lower_1), np.full_like(c2, self.width_lower_2)
        if self.type_1:
            d1_lower, d2_lower = d1_upper, d2_upper
        f = np.zeros((c1.size, c2.size))
        state = T2FnnState(c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f, self.q_init, x1, x2)
        # Guard 4: with uniform f (or 0) the denominator of `q_q` is 0, and one step moves q to a limit. These
        # signs maximise the denominator for consequents of this magnitude.
        W_lower, W_upper = firing(state, x1, x2)
        return state._replace(f=np.where(W_lower >= W_upper, self.f_init, -self.f_init))

    def infer(self, state: T2FnnState, x1: float, x2: float) -> float:
        """Return the network output tau_n [rad] at the inputs x1, x2; the centres do not move."""
        x1, x2 = self._bound(x1), self._bound(x2)
        return inference(_plain(state, x1, x2), x1, x2)

    def update(
        self, state: T2FnnState, x1: float, x2: float, tau_c: float, dt: float, learn: bool = True
    ) -> tuple[T2FnnState, float]:
        """Return the network after a tick of `dt` [s] of learning from tau_c [rad], and its output tau_n [rad].

        With `learn=False` only the centres change (guard 6).
        """
        known = ((state.x1, x1), (state.x2, x2))
        last = (self._bound(new) if old is None else float(old) for old, new in known)
        network, tau_n, _, _ = tick(held(Network(_plain(state, *last), self._learning)), x1, x2, tau_c, dt, learn)
        return fetched(network).state, tau_n

    def start(self, x1: float, x2: float) -> Held[Network]:
        """Return the initial network for `tick`, with fuzzy sets centred around the first values of x1 and x2."""
        return held(Network(self.init(x1, x2), self._learning))

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the network (centres c, widths d, consequents f, firing strengths w): c1_0, ..., f_0_0, ..."""
        return _columns(self.rules_1, self.rules_2)

    def _bound(self, x: float) -> float:
        return min(max(float(x), -self.input_bound), self.input_bound)

    @property
    def _learning(self) -> Learning:
        return Learning(
            self.alpha,
            self.delta_s,
            self.floor,
            self.d_min,
            self.d_max,
            self.centres == "follow",
            self.adapt_widths,
            self.adapt_q,
            self.type_1,
            self.input_bound,
        )


class T1Fnn(T2Fnn):
    """Type-1 fuzzy neural network, which has the learning laws of `T2Fnn` and equal lower and upper fuzzy sets."""

    type_1: ClassVar[bool] = True
    """Always True, because the lower fuzzy sets equal the upper fuzzy sets."""


@lru_cache(maxsize=16)
def _columns(rules_1: int, rules_2: int) -> tuple[Column, ...]:
    sets = {"1": range(rules_1), "2": range(rules_2)}
    units, inputs = {"1": "rad/s", "2": "rad/s2"}, {"1": "the yaw-rate error", "2": "its derivative"}
    centres = [Column(f"c{k}_{i}", units[k], f"centre of set {i} of {inputs[k]}") for k in "12" for i in sets[k]]
    widths = [
        Column(f"d{k}_{bound}_{i}", units[k], f"width of the {bound} set {i} of {inputs[k]}")
        for k in "12"
        for bound in ("lower", "upper")
        for i in sets[k]
    ]
    rules = [f"{i}_{j}" for i in sets["1"] for j in sets["2"]]
    consequents = [Column(f"f_{rule}", "rad", f"consequent of rule {rule}") for rule in rules]
    firings = [
        Column(f"w_{bound}_{rule}", "-", f"normalised {bound} firing of rule {rule}")
        for bound in ("lower", "upper")
        for rule in rules
    ]
    return (*centres, *widths, *consequents, *firings)


def _plain(s: T2FnnState, x1: float, x2: float) -> T2FnnState:
    """Return the state at the inputs x1 and x2, with the types required by the compiled equations."""
    c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f = (np.ascontiguousarray(a, dtype=float) for a in s[:7])
    return T2FnnState(c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f, float(s.q), x1, x2)


def _offsets(n: int, spread: float) -> Array:
    """Return offsets of `n` centres from the first input value, evenly spaced in the spread and shifted by 1/4 step.

    A centre equal to the input would violate Theorem 1: its membership remains 1 while the other memberships are
    scaled, so that the normalised firing changes.
    """
    return spread * (2 * np.arange(n) - (n - 1) + 0.5) / n
