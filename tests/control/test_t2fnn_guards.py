"""Six guards of the network, individually and together with adversarial inputs."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from network_states import derivatives, plain_firing, random_state
from pydantic import ValidationError

from agrobot_mj.control.t2fnn import T1Fnn, T2Fnn, T2FnnState

TICK = 0.05


def _memberships(s: T2FnnState, x1: float, x2: float) -> np.ndarray:
    """Return the memberships in all lower and upper sets, shape (n,)."""
    pairs = ((x1, s.c1, s.d1_lower), (x1, s.c1, s.d1_upper), (x2, s.c2, s.d2_lower), (x2, s.c2, s.d2_upper))
    return np.concatenate([1 - np.abs(x - c) / d for x, c, d in pairs])


def _single(x_minus_c: float, lower: float = 0.5, upper: float = 0.8) -> T2FnnState:
    """Return a network with one rule. Input x1 = 0 is `x_minus_c` above its centre, x2 = 0 is 0.1 above its centre."""
    return T2FnnState(
        c1=np.array([-x_minus_c]),
        c2=np.array([-0.1]),
        d1_lower=np.array([lower]),
        d1_upper=np.array([upper]),
        d2_lower=np.array([0.5]),
        d2_upper=np.array([0.8]),
        f=np.array([[0.1]]),
        q=0.5,
    )


# Guard 1


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (3, 3), (7, 4)])
@pytest.mark.parametrize("x", [(0.0, 0.0), (1e4, -3.0)])
def test_initial_inputs_are_inside_every_fuzzy_set_but_not_at_a_centre(
    size: tuple[int, int], x: tuple[float, float]
) -> None:
    state = T2Fnn(rules_1=size[0], rules_2=size[1]).init(*x)
    assert state.f.shape == size
    assert _memberships(state, *x).min() > 0.05
    assert min(np.abs(x[0] - state.c1).min(), np.abs(x[1] - state.c2).min()) > 0.02


def test_widths_that_exclude_the_initial_inputs_are_rejected() -> None:
    with pytest.raises(ValidationError, match="width_lower_2"):
        T2Fnn(width_lower_2=0.4)
    with pytest.raises(ValidationError, match="width_upper_1"):
        T2Fnn(width_upper_1=0.55)


def test_network_does_not_learn_from_inputs_outside_its_fuzzy_sets() -> None:
    state = start = _single(5.0)
    for k in range(100):
        state, tau_n = T2Fnn().update(state, np.sin(k), np.cos(k), 1.0, TICK)
        assert tau_n == 0
    assert np.array_equal(state.f, start.f)


# Guard 2


@pytest.mark.parametrize("tau_c", [-0.3, 0.3])
@pytest.mark.parametrize("x_minus_c", [1e-5, -1e-5, 0.0009, 0.0011, -0.0011])
def test_width_denominator_has_a_minimum_magnitude_and_keeps_its_sign(x_minus_c: float, tau_c: float) -> None:
    rate = derivatives(T2Fnn(alpha=0.2), _single(x_minus_c), 0.0, 0.0, tau_c).d1_lower[0]
    magnitude = (1 - abs(x_minus_c) / 0.5) * 0.2 * 0.25 / max(abs(x_minus_c), 0.001) * 0.3 / 0.35
    assert rate == pytest.approx(-np.sign(tau_c) * magnitude)


def test_fuzzy_set_centred_on_the_input_keeps_its_width() -> None:
    assert derivatives(T2Fnn(), _single(0.0), 0.0, 0.0, 1.0).d1_lower[0] == 0


@pytest.mark.parametrize("f_second", [0.1001, 0.0999, 0.1, 0.3, -0.3])
def test_q_denominator_has_a_minimum_magnitude_and_keeps_its_sign(f_second: float) -> None:
    state = _single(0.2)._replace(
        c1=np.array([-0.2, -0.3]),
        d1_lower=np.array([0.5, 0.5]),
        d1_upper=np.array([0.8, 0.9]),
        f=np.array([[0.1], [f_second]]),
    )
    W_lower, W_upper = plain_firing(state, 0.0, 0.0)
    D = (state.f * (W_lower - W_upper)).sum()
    floored = D if abs(D) >= 0.001 else (0.001 if D >= 0 else -0.001)
    assert abs(D) < 0.0005 or abs(D) > 0.002
    assert derivatives(T2Fnn(alpha=0.2), state, 0.0, 0.0, 0.95).q == pytest.approx(-0.2 * 0.95 / floored)


def test_f_denominator_has_a_minimum_value() -> None:
    state = _single(0.6)._replace(q=0.99)  # only the upper sets fire, with weight 0.01: W W = 1e-4
    rate = derivatives(T2Fnn(alpha=0.2), state, 0.0, 0.0, 0.95).f[0, 0]
    assert rate == pytest.approx(-0.01 * 0.2 * 0.95 / 0.001)


# Guard 3


@pytest.mark.parametrize("tau_c", [-1.0, 1.0])
@pytest.mark.parametrize("x_minus_c", [1e-9, -1e-4, 0.003, 0.2, 0.49])
@pytest.mark.parametrize("alpha", [0.05, 5.0, 500.0])
def test_large_learning_steps_keep_widths_ordered_and_within_limits(
    alpha: float, x_minus_c: float, tau_c: float
) -> None:
    network, state = T2Fnn(alpha=alpha), _single(x_minus_c)
    for _ in range(300):
        state, _ = network.update(state, 0.0, 0.0, tau_c, TICK)
        for lower, upper in ((state.d1_lower, state.d1_upper), (state.d2_lower, state.d2_upper)):
            assert network.d_min <= lower[0] <= upper[0] <= network.d_max
        assert _memberships(state, 0.0, 0.0).min() > 0


@pytest.mark.parametrize("d_min", [0.001, 0.55])
@pytest.mark.parametrize("tau_c", [-1.0, 1.0])
def test_fuzzy_set_widths_at_their_limit_keep_firing_strengths_constant(tau_c: float, d_min: float) -> None:
    network = T2Fnn(d_min=d_min, d_max=2.0, alpha=0.5)
    state = start = network.init(0.0, 0.0)
    for _ in range(2000):
        state, _ = network.update(state, 0.0, 0.0, tau_c, TICK)
    held, _ = network.update(state, 0.0, 0.0, tau_c, TICK)
    assert np.array_equal(held.d1_upper, state.d1_upper)
    assert not np.allclose(state.d1_upper, start.d1_upper, rtol=0.05)
    for a, b in zip(plain_firing(start, 0.0, 0.0), plain_firing(state, 0.0, 0.0), strict=True):
        assert a == pytest.approx(b, rel=0.05)
    back, _ = network.update(state, 0.0, 0.0, -tau_c, TICK)
    assert not np.array_equal(back.d1_upper, state.d1_upper)


def test_widths_outside_the_limits_are_clipped() -> None:
    state, _ = T2Fnn().update(_single(0.1, lower=500.0, upper=300.0), 0.0, 0.0, 0.1, TICK)
    assert state.d1_lower[0] == state.d1_upper[0] == 100.0


def test_learning_keeps_an_input_inside_the_upper_membership_function() -> None:
    state = _single(0.6, lower=0.3)
    for _ in range(300):
        state, _ = T2Fnn(alpha=50.0).update(state, 0.0, 0.0, 1.0, TICK)
        assert _memberships(state, 0.0, 0.0)[1] > 0


# Guard 4


@pytest.mark.parametrize(
    ("q", "direction", "moves"), [(1.0, 1, False), (1.0, -1, True), (0.0, -1, False), (0.0, 1, True)]
)
def test_q_at_its_limit_accepts_only_updates_towards_the_valid_range(q: float, direction: int, moves: bool) -> None:
    rng = np.random.default_rng(3)
    state = random_state(rng, (2, 2))._replace(q=q)
    while abs(derivatives(T2Fnn(), state, 0.0, 0.0, 1.0).q) > 2:
        state = random_state(rng, (2, 2))._replace(q=q)
    raising = np.sign(derivatives(T2Fnn(), state, 0.0, 0.0, 1.0).q)  # sign of a tau_c that raises q
    new, _ = T2Fnn().update(state, 0.0, 0.0, direction * raising, TICK)
    assert np.sign(new.q - q) == (direction if moves else 0)
    assert 0 <= new.q <= 1


def test_update_of_q_beyond_its_limits_is_discarded_not_clipped() -> None:
    state = _single(0.2)._replace(q=0.9)  # one rule: denominator 0, floored, so that q would jump
    for tau_c in (-1.0, 1.0):
        assert T2Fnn(alpha=5.0).update(state, 0.0, 0.0, tau_c, TICK)[0].q == 0.9


def test_denominator_of_q_update_is_nonzero_for_initial_consequents() -> None:
    state = T2Fnn(f_init=0.02).init(0.0, 0.0)
    W_lower, W_upper = plain_firing(state, 0.0, 0.0)
    assert np.abs(state.f) == pytest.approx(0.02)
    assert (state.f * (W_lower - W_upper)).sum() == pytest.approx(0.02 * np.abs(W_lower - W_upper).sum())
    assert np.abs(W_lower - W_upper).sum() > 0.1


# Guard 5


def test_network_output_is_zero_and_rates_are_finite_if_no_rule_fires() -> None:
    state = _single(3.0)
    rates = derivatives(T2Fnn(), state, 0.0, 0.0, 1.0)
    assert T2Fnn().infer(state, 0.0, 0.0) == 0
    assert not rates.f.any()
    assert not rates.d1_upper.any()
    assert np.isfinite(rates.q)


# Guard 6


def test_fuzzy_set_centres_follow_inputs_while_learning_is_disabled() -> None:
    network = T2Fnn()
    state = network.init(0.1, 0.2)
    held, tau_held = network.update(state, 0.4, 0.1, 0.3, TICK, learn=False)
    learnt, tau_learnt = network.update(state, 0.4, 0.1, 0.3, TICK)
    assert tau_held == tau_learnt
    assert np.array_equal(held.c1, learnt.c1)
    assert held.q == state.q
    assert all(np.array_equal(a, b) for a, b in zip(held[2:7], state[2:7], strict=True))
    assert not np.array_equal(learnt.f, state.f)


# All together


def _pattern(name: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return n input triples (x1, x2, tau_c)."""
    scale = 10 ** rng.uniform(-6, 3, size=3)
    if name == "constant":
        return np.tile(scale, (n, 1))
    if name == "zero":
        return np.zeros((n, 3))
    if name == "huge":
        return rng.choice([-np.inf, -1e300, -1e9, 1e9, 1e300, np.inf], size=(n, 3))
    if name == "flipping":
        return scale * (-1.0) ** np.arange(n)[:, None]
    return scale * rng.normal(size=(n, 3))


def _start(network: T2Fnn, outside: bool, rng: np.random.Generator) -> T2FnnState:
    """Return an initial state, or a random state with some or all sets away from the input."""
    if not outside:
        return network.init(*rng.normal(size=2))
    state = random_state(rng)
    if isinstance(network, T1Fnn):
        state = state._replace(d1_lower=state.d1_upper, d2_lower=state.d2_upper)
    return state._replace(c1=state.c1 + rng.choice([0.0, 1.0, 50.0]), q=float(rng.integers(2)))


NETWORKS = st.builds(
    lambda cls, **kwargs: cls(**kwargs),
    st.sampled_from([T2Fnn, T2Fnn, T1Fnn]),
    alpha=st.sampled_from([1e-3, 0.05, 1.0, 30.0, 1e4]),
    delta_s=st.sampled_from([1e-9, 0.05]),
    rules_1=st.integers(1, 4),
    rules_2=st.integers(1, 4),
    centres=st.sampled_from(["follow", "fixed"]),
    d_max=st.sampled_from([1.0, 100.0]),
)
PATTERNS = st.lists(st.sampled_from(["constant", "zero", "huge", "flipping", "noise"]), min_size=5, max_size=5)


def _assert_bounds(network: T2Fnn, outside: bool, patterns: list[str], seed: int) -> None:
    """Check for NaN and violated bounds during 1,000 ticks."""
    rng = np.random.default_rng(seed)
    state = _start(network, outside, rng)
    for x1, x2, tau_c in np.concatenate([_pattern(name, 200, rng) for name in patterns]).tolist():
        state, tau_n = network.update(state, x1, x2, tau_c, TICK)
        widths = np.concatenate(state[2:6])
        assert np.isfinite(tau_n)
        assert np.isfinite(state.c1).all()
        assert np.isfinite(state.c2).all()
        assert np.isfinite(state.f).all()
        assert network.d_min <= widths.min() <= widths.max() <= network.d_max
        assert (state.d1_lower <= state.d1_upper).all()
        assert (state.d2_lower <= state.d2_upper).all()
        assert 0 <= state.q <= 1


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(NETWORKS, st.booleans(), PATTERNS, st.integers(0, 2**32))
def test_adversarial_inputs_keep_parameters_within_bounds(
    network: T2Fnn, outside: bool, patterns: list[str], seed: int
) -> None:
    _assert_bounds(network, outside, patterns, seed)


@pytest.mark.slow
@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(NETWORKS, st.booleans(), PATTERNS, st.integers(0, 2**32))
def test_a_million_adversarial_ticks_keep_parameters_within_bounds(
    network: T2Fnn, outside: bool, patterns: list[str], seed: int
) -> None:
    _assert_bounds(network, outside, patterns, seed)
