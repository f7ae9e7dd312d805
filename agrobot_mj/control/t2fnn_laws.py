"""The equations of the type-2 network, compiled: inference and the right-hand sides of the learning laws.

Pure functions of arrays: centres and widths (I,) or (J,), firing W and consequents f (I, J). Source: the paper,
section IV. Guards 2, 3 and 5 of `t2fnn` stand here. With NUMBA_DISABLE_JIT=1 the same functions run uncompiled.
"""

import numpy as np

from agrobot_mj.compiled import jit
from agrobot_mj.signals import Array

LARGE_STEP = 0.01
"""Guard 3: largest change of a width in one explicit Euler step [-]. Estimate."""
LEAST_MEMBERSHIP = 1e-6
"""Guard 3: what shrinking leaves of a membership; less would drown in rounding and the set die [-]. Estimate."""
TINY = 1e-12
"""Stands for 0 where a width would grow without bound [-]."""


@jit
def sgn(tau_c: float, delta_s: float) -> float:
    """Smoothed sign of tau_c [rad], delta_s [rad]; in (-1, 1)."""
    return tau_c / (abs(tau_c) + delta_s)  # [agrobots: chatter]


@jit
def membership(x: float, c: Array, d: Array) -> Array:
    """Triangular membership of x in sets of centres c and widths d > 0."""
    return np.maximum(1 - np.abs((x - c) / d), 0.0)  # [agrobots: tri1i_alt]


@jit
def strength(mu_1: Array, mu_2: Array) -> Array:
    """Strength of the rules, (I, J)."""
    return np.outer(mu_1, mu_2)  # [agrobots: Rahib2_5]


@jit
def normalised(W: Array) -> Array:
    """Strength as shares of one."""
    total = W.sum()
    if total == 0:  # guard 5: no rule fires
        return np.zeros_like(W)
    return W / total  # [agrobots: Rahib2_6]


@jit
def output(W_lower: Array, W_upper: Array, f: Array, q: float) -> float:
    """tau_n [rad] from normalised firing."""
    return q * (f * W_lower).sum() + (1 - q) * (f * W_upper).sum()  # [agrobots: eq19]


@jit
def firing(
    x1: float, x2: float, c1: Array, c2: Array, d1_lower: Array, d1_upper: Array, d2_lower: Array, d2_upper: Array
) -> tuple[Array, Array]:
    """Normalised lower and upper firing, each (I, J)."""
    W_lower = strength(membership(x1, c1, d1_lower), membership(x2, c2, d2_lower))
    W_upper = strength(membership(x1, c1, d1_upper), membership(x2, c2, d2_upper))
    return normalised(W_lower), normalised(W_upper)


@jit
def floored(x: float, floor: float) -> float:
    """Guard 2: a denominator keeps at least the magnitude `floor`, sign preserved (plus for 0)."""
    if abs(x) >= floor:
        return x
    return floor if x >= 0 else -floor


@jit
def width_rates(x: float, c: Array, d: Array, alpha_sgn: float, floor: float) -> Array:
    """Rate of one family of widths; sgn(x - c) is literal, so that a set centred on the input rests."""
    mu, rate = membership(x, c, d), np.zeros_like(d)
    for i in range(d.size):
        slope = -alpha_sgn * d[i] ** 2 / floored(x - c[i], floor)
        rate[i] = mu[i] * slope * np.sign((x - c[i]) / d[i])  # [agrobots: enyeni1]
    return rate


@jit
def f_rates(W_lower: Array, W_upper: Array, q: float, alpha_sgn: float, floor: float) -> Array:
    """Rate of the consequents, (I, J) [rad/s]."""
    w = q * W_lower + (1 - q) * W_upper
    return -w * alpha_sgn / floored((w * w).sum(), floor)  # [agrobots: fij]


@jit
def q_rate(W_lower: Array, W_upper: Array, f: Array, alpha_sgn: float, floor: float) -> float:
    """Rate of q [1/s]."""
    return -alpha_sgn / floored((f * (W_lower - W_upper)).sum(), floor)  # [agrobots: q_q]


@jit
def laws(
    x1: float,
    x2: float,
    c1: Array,
    c2: Array,
    d1_lower: Array,
    d1_upper: Array,
    d2_lower: Array,
    d2_upper: Array,
    f: Array,
    q: float,
    alpha_sgn: float,
    floor: float,
) -> tuple[float, Array, Array, Array, Array, Array, float]:
    """tau_n [rad] and the rates of d1_lower, d1_upper, d2_lower, d2_upper, f and q."""
    W_lower, W_upper = firing(x1, x2, c1, c2, d1_lower, d1_upper, d2_lower, d2_upper)
    return (
        output(W_lower, W_upper, f, q),
        width_rates(x1, c1, d1_lower, alpha_sgn, floor),
        width_rates(x1, c1, d1_upper, alpha_sgn, floor),
        width_rates(x2, c2, d2_lower, alpha_sgn, floor),
        width_rates(x2, c2, d2_upper, alpha_sgn, floor),
        f_rates(W_lower, W_upper, q, alpha_sgn, floor),
        q_rate(W_lower, W_upper, f, alpha_sgn, floor),
    )


@jit
def stepped(d: Array, change: Array) -> Array:
    """Guard 3: one family of widths after an explicit Euler step, or, if that is large, after one in 1/d.

    Membership is linear in 1/d, so that those of a family scale alike there and no step overshoots the input.
    """
    if np.all(np.abs(change) <= LARGE_STEP * d):
        return d + change
    return d / np.maximum(1 - change / d, TINY)


@jit
def loses(x: float, c: Array, d: Array, new: Array) -> bool:
    """Whether a family of widths that shrinks from d to `new` would lose the input."""
    return bool(np.any((new < d) & (membership(x, c, new) < LEAST_MEMBERSHIP)))


@jit
def adapted_widths(
    x: float, c: Array, lower: Array, upper: Array, lower_change: Array, upper_change: Array, d_min: float, d_max: float
) -> tuple[Array, Array]:
    """Guard 3 for the sets of one input: lower and upper widths after a step, d_min <= lower <= upper <= d_max.

    A family of which one width would pass a limit rests as a whole (the paper does so with q). Were that width
    clipped by itself, the memberships would no longer scale alike and Theorem 1 would fail.
    """
    new_lower, new_upper = stepped(lower, lower_change), stepped(upper, upper_change)
    if loses(x, c, lower, new_lower) or new_lower.min() < d_min:
        new_lower = lower
    if loses(x, c, upper, new_upper) or new_upper.max() > d_max:
        new_upper = upper
    if np.any(new_lower > new_upper):
        new_lower, new_upper = lower, upper
    new_upper = np.minimum(np.maximum(new_upper, d_min), d_max)  # mends a state that was built outside the limits
    return np.minimum(np.maximum(new_lower, d_min), new_upper), new_upper
