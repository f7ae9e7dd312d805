"""Random states of the network, and an independent implementation of the paper's laws for the tests."""

import numpy as np

from agrobot_mj.control.t2fnn import T2Fnn, T2FnnState
from agrobot_mj.control.t2fnn_laws import Rates, firing, laws, sgn


def random_state(rng: np.random.Generator, size: tuple[int, int] | None = None) -> T2FnnState:
    """Return a random network state whose fuzzy sets are scattered about the origin. Some sets contain the origin."""
    n1, n2 = size or (int(rng.integers(1, 5)), int(rng.integers(1, 5)))
    d1_lower, d2_lower = rng.uniform(0.3, 1.2, n1), rng.uniform(0.3, 1.2, n2)
    return T2FnnState(
        c1=rng.uniform(-0.8, 0.8, n1),
        c2=rng.uniform(-0.8, 0.8, n2),
        d1_lower=d1_lower,
        d1_upper=d1_lower + rng.uniform(0, 0.6, n1),
        d2_lower=d2_lower,
        d2_upper=d2_lower + rng.uniform(0, 0.6, n2),
        f=rng.normal(size=(n1, n2)),
        q=rng.uniform(0.01, 0.99),
    )


def plain_firing(s: T2FnnState, x1: float, x2: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the normalised lower and upper firing strengths, computed in scalar steps, or zeros if no rule fires."""
    shares = []
    for d1, d2 in ((s.d1_lower, s.d2_lower), (s.d1_upper, s.d2_upper)):
        W = np.zeros(s.f.shape)
        for i, j in np.ndindex(W.shape):
            mu_1 = 1 - abs((x1 - s.c1[i]) / d1[i]) if abs(x1 - s.c1[i]) < d1[i] else 0
            mu_2 = 1 - abs((x2 - s.c2[j]) / d2[j]) if abs(x2 - s.c2[j]) < d2[j] else 0
            W[i, j] = mu_1 * mu_2
        shares.append(W / W.sum() if W.sum() > 0 else W)
    return shares[0], shares[1]


def printed_laws(s: T2FnnState, x1: float, x2: float, alpha: float, sign: float) -> Rates:
    """Return right-hand sides of the adaptation laws as printed in the paper, without limits of denominators."""

    def widths(x: float, c: np.ndarray, d: np.ndarray) -> np.ndarray:
        rates = np.zeros(len(d))
        for i in range(len(d)):
            mu = 1 - abs((x - c[i]) / d[i]) if abs(x - c[i]) < d[i] else 0
            rates[i] = mu * (-alpha * d[i] ** 2) / (x - c[i]) * sign * np.sign((x - c[i]) / d[i])
        return rates

    W_lower, W_upper = plain_firing(s, x1, x2)
    W = s.q * W_lower + (1 - s.q) * W_upper
    return Rates(
        widths(x1, s.c1, s.d1_lower),
        widths(x1, s.c1, s.d1_upper),
        widths(x2, s.c2, s.d2_lower),
        widths(x2, s.c2, s.d2_upper),
        -W * alpha * sign / (W.ravel() @ W.ravel()),
        -alpha * sign / (s.f.ravel() @ (W_lower - W_upper).ravel()),
    )


def derivatives(network: T2Fnn, s: T2FnnState, x1: float, x2: float, tau_c: float) -> Rates:
    """Return the right-hand sides of the laws as implemented in the network. Only the guards 2 and 5 have an effect."""
    alpha_sgn = network.alpha * sgn(tau_c, network.delta_s)
    return laws(s._replace(x1=x1, x2=x2), firing(s, x1, x2), x1, x2, alpha_sgn, network.floor)[1]


def far_from_guards(s: T2FnnState, x1: float, x2: float) -> bool:
    """Return whether no denominator is near its lower limit and rules of both bounds fire."""
    W_lower, W_upper = plain_firing(s, x1, x2)
    near = min(np.abs(x1 - s.c1).min(), np.abs(x2 - s.c2).min())
    return bool(near > 0.01 and W_lower.any() and abs((s.f * (W_lower - W_upper)).sum()) > 0.01)
