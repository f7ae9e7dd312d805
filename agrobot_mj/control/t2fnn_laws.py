"""Compiled equations of the type-2 fuzzy neural network: inference, learning laws and their time step.

All functions are pure. Centres and widths have shape (I,) for x1 and (J,) for x2, in the unit of x; firing strengths W
and consequents f [rad] have shape (I, J). Source: the paper, section IV. Guards 2, 3 and 5 of `t2fnn` are applied.
"""

from typing import NamedTuple

import numpy as np

from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.signals import Array, Matrix, Vector

LARGE_STEP = 0.01  # Maximum relative change of a width in one explicit Euler step (guard 3) [-]. Assumed value.
MIN_MEMBERSHIP = 1e-6
"""Minimum membership of the input in a shrinking fuzzy set (guard 3) [-]. Assumed value, above rounding errors."""
TINY = 1e-12  # Minimum denominator of a width update [-], which keeps the width finite


class T2FnnState(NamedTuple):
    """Parameters of the network and its last inputs."""

    c1: Vector  # Centres of the fuzzy sets of input x1 [unit of x1], shape (I,)
    c2: Vector  # Centres of the fuzzy sets of input x2 [unit of x2], shape (J,)
    d1_lower: Vector  # Widths of the lower fuzzy sets of input x1 [unit of x1], shape (I,)
    d1_upper: Vector  # Widths of the upper fuzzy sets of input x1 [unit of x1], shape (I,)
    d2_lower: Vector  # Widths of the lower fuzzy sets of input x2 [unit of x2], shape (J,)
    d2_upper: Vector  # Widths of the upper fuzzy sets of input x2 [unit of x2], shape (J,)
    f: Matrix  # Consequents of the fuzzy rules [rad], shape (I, J)
    q: float  # Weight q of the lower firing strengths in the output [-]
    x1: float | None = None  # Last input x1 [unit of x1]; if None, the centres do not move in the next update
    x2: float | None = None  # Last input x2 [unit of x2]; if None, the centres do not move in the next update


class Rates(NamedTuple):
    """Time derivatives of the network parameters, with the shapes and units (per second) of `T2FnnState`."""

    d1_lower: Array
    d1_upper: Array
    d2_lower: Array
    d2_upper: Array
    f: Array
    q: float


class Learning(NamedTuple):
    """Learning settings of a network, taken from `T2Fnn`."""

    alpha: float  # Learning rate of the network [rad/s]
    delta_s: float  # Smoothing width of the sign function [rad]
    floor: float  # Minimum magnitude of denominators in the learning laws
    d_min: float  # Minimum width of a fuzzy set [unit of the input]
    d_max: float  # Maximum width of a fuzzy set [unit of the input]
    follow: bool  # Whether the centres of the fuzzy sets follow the inputs
    adapt_widths: bool  # Whether to learn the widths of the fuzzy sets
    adapt_q: bool  # Whether to learn the weight q of the lower firing strengths
    type_1: bool  # Whether the lower sets equal the upper sets
    input_bound: float  # Magnitude at which inputs are clipped [unit of the input]


class Network(NamedTuple):
    """Fuzzy neural network with its learning settings."""

    state: T2FnnState
    learning: Learning


@jit
def sgn(tau_c: float, delta_s: float) -> float:
    """Return the smoothed sign of tau_c in (-1, 1), with the smoothing width delta_s; both arguments in [rad]."""
    return tau_c / (abs(tau_c) + delta_s)  # [agrobots: chatter]


@jit
def membership(x: float, c: Array, d: Array) -> Array:
    """Return the triangular membership of the input x in fuzzy sets with centres c and widths d > 0."""
    mu: Array = np.maximum(1 - np.abs((x - c) / d), 0.0)  # [agrobots: tri1i_alt]
    return mu


@jit
def strength(mu_1: Array, mu_2: Array) -> Array:
    """Return the firing strengths of the rules, shape (I, J), from the memberships of both inputs."""
    return np.outer(mu_1, mu_2)  # [agrobots: Rahib2_5]


@jit
def normalise(W: Array) -> Array:
    """Return the firing strengths divided by their sum, or zeros if no rule fires."""
    total = W.sum()
    if total == 0:  # guard 5: no rule fires
        return np.zeros_like(W)
    fraction: Array = W / total  # [agrobots: Rahib2_6]
    return fraction


@jit
def firing(s: T2FnnState, x1: float, x2: float) -> tuple[Array, Array]:
    """Return the normalised lower and upper firing strengths at the inputs x1 and x2, each of shape (I, J)."""
    W_lower = strength(membership(x1, s.c1, s.d1_lower), membership(x2, s.c2, s.d2_lower))
    W_upper = strength(membership(x1, s.c1, s.d1_upper), membership(x2, s.c2, s.d2_upper))
    return normalise(W_lower), normalise(W_upper)


@jit
def output(W_lower: Array, W_upper: Array, f: Array, q: float) -> float:
    """Return the network output tau_n [rad] from normalised firing strengths, consequents f [rad] and weight q."""
    tau_n: float = q * (f * W_lower).sum() + (1 - q) * (f * W_upper).sum()  # [agrobots: eq19]
    return tau_n


@jit
def with_floor(x: float, floor: float) -> float:
    """Return x with its sign (positive for 0) and a magnitude of at least `floor` (guard 2)."""
    if abs(x) >= floor:
        return x
    return floor if x >= 0 else -floor


@jit
def width_rates(x: float, c: Array, d: Array, alpha_sgn: float, floor: float) -> Array:
    """Return the rates of change of the fuzzy-set widths `d` at the input x; `alpha_sgn` is alpha sgn(tau_c)
    [rad/s]."""
    mu, rate = membership(x, c, d), np.zeros_like(d)
    for i in range(d.size):
        slope = -alpha_sgn * d[i] ** 2 / with_floor(x - c[i], floor)
        rate[i] = mu[i] * slope * np.sign((x - c[i]) / d[i])  # [agrobots: enyeni1]
    return rate


@jit
def f_rates(W_lower: Array, W_upper: Array, q: float, alpha_sgn: float, floor: float) -> Array:
    """Return the rates of change of the rule consequents [rad/s], shape (I, J)."""
    W = q * W_lower + (1 - q) * W_upper
    return -W * alpha_sgn / with_floor((W * W).sum(), floor)  # [agrobots: fij]


@jit
def q_rate(W_lower: Array, W_upper: Array, f: Array, alpha_sgn: float, floor: float) -> float:
    """Return the rate of change of the weight q [1/s]."""
    return -alpha_sgn / with_floor((f * (W_lower - W_upper)).sum(), floor)  # [agrobots: q_q]


@jit
def inference(s: T2FnnState, x1: float, x2: float) -> float:
    """Return the network output tau_n [rad] at the inputs x1 and x2."""
    W_lower, W_upper = firing(s, x1, x2)
    return output(W_lower, W_upper, s.f, s.q)


@jit
def laws(
    s: T2FnnState, W: tuple[Array, Array], x1: float, x2: float, alpha_sgn: float, floor: float
) -> tuple[float, Rates]:
    """Return the output tau_n [rad] for firing strengths W, and the parameter rates for alpha sgn(tau_c) [rad/s]."""
    W_lower, W_upper = W
    rates = Rates(
        width_rates(x1, s.c1, s.d1_lower, alpha_sgn, floor),
        width_rates(x1, s.c1, s.d1_upper, alpha_sgn, floor),
        width_rates(x2, s.c2, s.d2_lower, alpha_sgn, floor),
        width_rates(x2, s.c2, s.d2_upper, alpha_sgn, floor),
        f_rates(W_lower, W_upper, s.q, alpha_sgn, floor),
        q_rate(W_lower, W_upper, s.f, alpha_sgn, floor),
    )
    return output(W_lower, W_upper, s.f, s.q), rates


@jit
def step_widths(d: Vector, change: Array) -> Vector:
    """Return the widths after an explicit Euler step in d or, if the step is large, in 1/d (guard 3).

    Membership is linear in 1/d. A step in 1/d therefore scales the memberships of all sets equally and never overshoots
    the input.
    """
    if np.all(np.abs(change) <= LARGE_STEP * d):
        return d + change
    return d / np.maximum(1 - change / d, TINY)


@jit
def loses_input(x: float, c: Array, d: Array, new: Array) -> bool:
    """Return whether fuzzy sets that shrink from widths `d` to `new` would no longer contain the input x (guard 3)."""
    return bool(np.any((new < d) & (membership(x, c, new) < MIN_MEMBERSHIP)))


@jit
def update_widths(
    x: float, c: Vector, lower: Vector, upper: Vector, lower_change: Array, upper_change: Array, learning: Learning
) -> tuple[Vector, Vector]:
    """Return the lower and upper widths of one input after a step, with d_min <= lower <= upper <= d_max (guard 3).

    If one width would exceed a limit, all widths of its vector are unchanged: learning stops at the limit, as the paper
    does for q. Clipping only one width would end the uniform scaling required by the proof of Theorem 1 (appendix A).
    """
    new_lower, new_upper = step_widths(lower, lower_change), step_widths(upper, upper_change)
    if loses_input(x, c, lower, new_lower) or new_lower.min() < learning.d_min:
        new_lower = lower
    if loses_input(x, c, upper, new_upper) or new_upper.max() > learning.d_max:
        new_upper = upper
    if np.any(new_lower > new_upper):
        new_lower, new_upper = lower, upper
    new_upper = np.minimum(np.maximum(new_upper, learning.d_min), learning.d_max)  # for states not built by `init`
    return np.minimum(np.maximum(new_lower, learning.d_min), new_upper), new_upper


@jit
def move_centres(s: T2FnnState, last: tuple[float, float], x1: float, x2: float, follow: bool) -> T2FnnState:
    """Return the network at the inputs x1 and x2. If `follow`, the centres move by the change of the inputs since
    `last`, otherwise the centres are fixed."""
    c1, c2 = s.c1, s.c2
    if follow:
        c1 = c1 + (x1 - last[0])  # [agrobots: 16]
        c2 = c2 + (x2 - last[1])  # [agrobots: 16ek]
    return T2FnnState(c1, c2, s.d1_lower, s.d1_upper, s.d2_lower, s.d2_upper, s.f, s.q, x1, x2)


@jit
def apply_rates(s: T2FnnState, x1: float, x2: float, rates: Rates, dt: float, learning: Learning) -> T2FnnState:
    """Return the network after `dt` [s] at the given rates of widths, consequents f and weight q, limited by guards 3
    and 4."""
    d1_lower, d1_upper, d2_lower, d2_upper = s.d1_lower, s.d1_upper, s.d2_lower, s.d2_upper
    if learning.adapt_widths:
        change, upper_change = dt * rates.d1_lower, dt * rates.d1_upper
        d1_lower, d1_upper = update_widths(x1, s.c1, d1_lower, d1_upper, change, upper_change, learning)
        change, upper_change = dt * rates.d2_lower, dt * rates.d2_upper
        d2_lower, d2_upper = update_widths(x2, s.c2, d2_lower, d2_upper, change, upper_change, learning)
    if learning.type_1:
        d1_lower, d2_lower = d1_upper, d2_upper
    f, q = s.f + dt * rates.f, s.q + dt * rates.q
    if not learning.adapt_q or learning.type_1 or not 0 <= q <= 1:  # guard 4
        q = s.q
    return T2FnnState(s.c1, s.c2, d1_lower, d1_upper, d2_lower, d2_upper, f, q, x1, x2)


@stage
def tick(
    network: Held[Network], x1: float, x2: float, tau_c: float, dt: float, learn: bool
) -> tuple[Held[Network], float, float, Vector]:
    """Return the network after a tick of `dt` [s], and the output tau_n [rad], q and log values before learning."""
    s, learning = fetched(network)
    bound = learning.input_bound
    x1, x2, tau_c = min(max(x1, -bound), bound), min(max(x2, -bound), bound), min(max(tau_c, -bound), bound)
    s = move_centres(s, (s.x1, s.x2), x1, x2, learning.follow)  # type: ignore[arg-type]
    W = firing(s, x1, x2)
    tau_n, rates = laws(s, W, x1, x2, learning.alpha * sgn(tau_c, learning.delta_s), learning.floor)
    after = apply_rates(s, x1, x2, rates, dt, learning) if learn else s
    return held(Network(after, learning)), tau_n, s.q, report_of(s, W)


@jit
def report_of(s: T2FnnState, W: tuple[Array, Array]) -> Vector:
    """Return the log values: centres, widths, consequents and normalised firing strengths, shape (3 (I + J + I J),)."""
    W_lower, W_upper = W
    rows = (s.c1, s.c2, s.d1_lower, s.d1_upper, s.d2_lower, s.d2_upper, s.f.ravel(), W_lower.ravel(), W_upper.ravel())
    return np.concatenate(rows)
