"""Interval type-2 fuzzy neural network (A2-C0 TSK) with sliding-mode learning: the paper, section IV.

Inputs x1, x2 (the yaw-rate error [rad/s] and its derivative [rad/s2]), learning error tau_c and output tau_n
[rad]; the steering is tau_c - tau_n. The equations are in `t2fnn_laws`; a state's arrays give its size.

The printed laws are singular in places. Six guards, named beside their lines, make them safe:
1. centres start around the first input, which therefore lies inside every set (otherwise the network stays dead:
   `16` and `16ek` keep x - c constant);
2. denominators keep a floor, sign preserved (paper);
3. widths keep their limits, their order and the input: a large Euler step cannot overshoot;
4. q keeps to [0, 1]: an update that would leave is dropped, one that points inside is taken (paper);
5. where no rule fires the normalised firing is 0;
6. learning can be held, for instance while the steering saturates.
Inputs are clipped to a bound (the paper's B_x), so that arithmetic stays finite.

While centres follow, the width laws leave the normalised firing as it is (appendix A), so that the network is
an integrator: d tau_n/dt = -alpha sgn(tau_c), and twice that while q adapts unfloored.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.control.t2fnn_laws import Learning, T2FnnState, firing, inference, tick
from agrobot_mj.core.kernels import bound
from agrobot_mj.core.signals import Array, Column
from agrobot_mj.core.spec import Fraction, Positive, Spec

__all__ = ["T1Fnn", "T2Fnn", "T2FnnState"]


class T2Fnn(Spec):
    """The network and its learning laws; the paper prints only delta_s and the floor."""

    alpha: Positive = 0.02
    """Learning rate; Theorem 1 has a lower bound [rad/s]. Assumed value: searched; 0.02 with `gains = "paper"`."""
    delta_s: Positive = 0.05
    """Smoothing of the sign function [rad]. Paper."""
    rules_1: int = Field(3, ge=1, le=50)
    """Number I of sets of x1 [-]. Assumed value (2-9)."""
    rules_2: int = Field(3, ge=1, le=50)
    """Number J of sets of x2 [-]. Assumed value (2-9)."""
    spread_1: Positive = 0.5
    """Distance from the first input within which centres of x1 start [unit of x1]. Assumed value (0.1-1): a wrong
    turn."""
    spread_2: Positive = 0.5
    """Distance from the first input within which the centres of x2 start [unit of x2]. Assumed value (0.1-1):
    likewise."""
    width_lower_1: Positive = 0.6
    """Initial width of the lower sets of x1 [unit of x1]. Assumed value: above the spread; all sets see the first
    input."""
    width_upper_1: Positive = 0.9
    """Initial width of the upper sets of x1 [unit of x1]. Assumed value: above the lower width."""
    width_lower_2: Positive = 0.6
    """Initial width of the lower sets of x2 [unit of x2]. Assumed value: above the spread."""
    width_upper_2: Positive = 0.9
    """Initial width of the upper sets of x2 [unit of x2]. Assumed value: above the lower width."""
    d_min: Positive = 0.001
    """Smallest width [unit of the input]. Assumed value: guard; a width there counts as a point."""
    d_max: Positive = 100.0
    """Largest width [unit of the input]. Assumed value: guard; a width there counts as everywhere."""
    f_init: Positive = 0.01
    """Magnitude of the initial consequents [rad]. Assumed value: guard 4: not 0, or q saturates in one step."""
    q_init: Fraction = 0.5
    """Initial share of the lower firing [-]. Assumed value: the middle."""
    centres: Literal["follow", "fixed"] = "follow"
    """Whether the centres move with the inputs (paper) or stay."""
    adapt_widths: bool = True
    """Whether the widths learn (paper)."""
    adapt_q: bool = True
    """Whether q learns (paper)."""
    type_1: ClassVar[bool] = False
    """Whether the lower bounds coincide with the upper ones; q then has no effect and stays constant."""
    floor: Positive = 0.001
    """Least magnitude of a denominator [unit of the denominator]. Paper."""
    input_bound: Positive = 1e6
    """Magnitude to which inputs are clipped, the paper's B_x [unit of the input]. Assumed value: against overflow."""

    @model_validator(mode="after")
    def _first_input_inside_every_set(self) -> Self:
        for k, spread, lower, upper in (
            (1, self.spread_1, self.width_lower_1, self.width_upper_1),
            (2, self.spread_2, self.width_lower_2, self.width_upper_2),
        ):
            if not self.d_min <= lower <= upper <= self.d_max:
                raise ValueError(f"d_min <= width_lower_{k} <= width_upper_{k} <= d_max must hold")
            if lower < spread:
                raise ValueError(f"width_lower_{k}: must be at least spread_{k}, or a set stays dead")
        return self

    def init(self, x1: float, x2: float) -> T2FnnState:
        """The network before its first update, its sets placed around the first inputs x1, x2 (guard 1)."""
        x1, x2 = self._bounded(x1), self._bounded(x2)
        c1 = x1 + _offsets(self.rules_1, self.spread_1)
        c2 = x2 + _offsets(self.rules_2, self.spread_2)
        d1_upper, d2_upper = np.full_like(c1, self.width_upper_1), np.full_like(c2, self.width_upper_2)
        d1_lower, d2_lower = np.full_like(c1, self.width_lower_1), np.full_like(c2, self.width_lower_2)
        if self.type_1:
            d1_lower, d2_lower = d1_upper, d2_upper
        f = np.zeros((c1.size, c2.size))
        state = T2FnnState(c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f, self.q_init, x1, x2)
        # Guard 4: for uniform f (or 0) the denominator of `q_q` is 0, and one step throws q to a limit. These
        # signs make it as large as consequents of this magnitude can.
        W_lower, W_upper = firing(state, x1, x2)
        return state._replace(f=np.where(W_lower >= W_upper, self.f_init, -self.f_init))

    def infer(self, state: T2FnnState, x1: float, x2: float) -> float:
        """Output tau_n [rad] of the state at the inputs x1, x2; the centres do not follow."""
        x1, x2 = self._bounded(x1), self._bounded(x2)
        return inference(_plain(state, x1, x2), x1, x2)

    def update(
        self, state: T2FnnState, x1: float, x2: float, tau_c: float, dt: float, learn: bool = True
    ) -> tuple[T2FnnState, float]:
        """Centres follow, tau_n [rad] is inferred, then widths, f and q learn from tau_c [rad] for dt [s].

        Guard 6: with `learn=False` nothing adapts, the centres excepted.
        """
        known = ((state.x1, x1), (state.x2, x2))
        last = (self._bounded(new) if old is None else float(old) for old, new in known)
        return self.update_with_report(_plain(state, *last), x1, x2, tau_c, dt, learn)[:2]

    def update_with_report(
        self, state: T2FnnState, x1: float, x2: float, tau_c: float, dt: float, learn: bool = True
    ) -> tuple[T2FnnState, float, Array]:
        """As `update`, and the values of `columns` when the network gave this tau_n: centres moved, nothing learnt yet.

        The state is one that `init` or this method has returned, as it is the compiled equations'.
        Centres, widths [unit of their input], consequents [rad] and normalised firing [-], shape (3 (I + J + I J),).
        """
        inputs = (state.x1, state.x2), self._bounded(x1), self._bounded(x2), self._bounded(tau_c)
        found: tuple[T2FnnState, float, Array] = _compiled_tick()(state, *inputs, dt, self._learning, learn)
        return found

    @property
    def columns(self) -> tuple[Column, ...]:
        """Signals that it reports: c1_0, ..., d1_lower_0, ..., f_0_0, ..., w_lower_0_0, ..., w_upper_0_0, ..."""
        return _columns(self.rules_1, self.rules_2)

    def _bounded(self, x: float) -> float:
        return min(max(float(x), -self.input_bound), self.input_bound)

    @property
    def _learning(self) -> Learning:
        """The settings, as the compiled equations take them."""
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
        )


class T1Fnn(T2Fnn):
    """A type-1 fuzzy neural network: the same laws with lower and upper bounds that coincide."""

    type_1: ClassVar[bool] = True
    """Always True: the bounds coincide."""


@lru_cache(maxsize=1)
def _compiled_tick() -> Callable[..., Any]:
    """`tick` without numba's dispatch."""
    network, at = T2Fnn(), (0.0, 0.0)
    return bound(tick, network.init(*at), at, *at, 0.0, 0.0, network._learning, True)


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
    """The state at these inputs, with members of the types that the compiled equations take."""
    c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f = (np.ascontiguousarray(a, dtype=float) for a in s[:7])
    return T2FnnState(c1, c2, d1_lower, d1_upper, d2_lower, d2_upper, f, float(s.q), x1, x2)


def _offsets(n: int, spread: float) -> Array:
    """Even steps across the spread, shifted by a quarter of one: a centre on the input would break Theorem 1.

    (Its membership stays 1 while the others scale, so that the normalised firing moves.)
    """
    return spread * (2 * np.arange(n) - (n - 1) + 0.5) / n
