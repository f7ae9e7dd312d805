from math import copysign
from typing import Any

import numpy as np
import pytest
from network_states import derivatives, far_from_guards, plain_firing, printed_laws, random_state

from agrobot_mj.control.t2fnn import T1Fnn, T2Fnn, T2FnnState
from agrobot_mj.control.t2fnn_laws import Rates

ALPHA, STEP, TICK = 0.3, 1e-6, 0.05
NETWORK = T2Fnn(alpha=ALPHA)


def _slope(network: T2Fnn, state: T2FnnState, x1: float, x2: float, tau_c: float) -> Rates:
    new, _ = network.update(state, x1, x2, tau_c, STEP)
    return Rates(*((np.asarray(b) - a) / STEP for a, b in zip(state[2:8], new[2:8], strict=True)))


def _assert_equal(a: Rates, b: Rates) -> None:
    for name, left, right in zip(Rates._fields, a, b, strict=True):
        assert left == pytest.approx(right, rel=1e-6, abs=1e-6), name


def test_small_learning_step_equals_the_published_adaptation_laws() -> None:
    rng, compared = np.random.default_rng(4), 0
    while compared < 300:
        state, (x1, x2), tau_c = random_state(rng), rng.uniform(-0.8, 0.8, 2), rng.normal()
        if not far_from_guards(state, x1, x2):
            continue
        printed = printed_laws(state, x1, x2, ALPHA, tau_c / (abs(tau_c) + 0.05))
        _assert_equal(_slope(NETWORK, state, x1, x2, tau_c), printed)
        _assert_equal(derivatives(NETWORK, state, x1, x2, tau_c), printed)
        compared += 1


@pytest.mark.parametrize("tau_c", [-0.2, 0.0, 0.2])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("distance", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("input_", [1, 2])
def test_width_rates_equal_the_published_law_in_each_branch(
    tau_c: float, side: int, distance: float, input_: int
) -> None:
    """Widths are 0.5 and 0.8. The input is inside both sets, inside the upper set only, or outside both sets."""
    c, lower, upper = np.array([0.1, 0.0]), np.array([0.5, 1.5]), np.array([0.8, 2.0])
    other = np.array([0.2]), np.array([1.0]), np.array([1.5])
    f, x = np.array([[0.3], [-0.4]]), 0.1 + side * distance
    if input_ == 1:
        state = T2FnnState(c, other[0], lower, upper, other[1], other[2], f, 0.4)
        rates = _slope(NETWORK, state, x, 0.0, tau_c)
        got = rates.d1_lower[0], rates.d1_upper[0]
    else:
        state = T2FnnState(other[0], c, other[1], other[2], lower, upper, f.T, 0.4)
        rates = _slope(NETWORK, state, 0.0, x, tau_c)
        got = rates.d2_lower[0], rates.d2_upper[0]
    alpha_sgn = ALPHA * tau_c / (abs(tau_c) + 0.05)
    expected = [-alpha_sgn * max(1 - distance / d, 0) * d**2 / distance for d in (0.5, 0.8)]
    assert got == pytest.approx(expected, abs=1e-6)


def test_fuzzy_set_centres_follow_the_inputs() -> None:
    state = NETWORK.init(0.3, -0.2)
    moved, _ = NETWORK.update(state, 0.5, -0.7, 0.1, STEP)
    assert moved.c1 - state.c1 == pytest.approx([0.2] * 3)
    assert moved.c2 - state.c2 == pytest.approx([-0.5] * 3)
    unknown, _ = NETWORK.update(state._replace(x1=None, x2=None), 0.5, -0.7, 0.1, STEP)
    assert np.array_equal(unknown.c1, state.c1)
    again, _ = NETWORK.update(unknown, 0.6, -0.7, 0.1, STEP)
    assert again.c1 - state.c1 == pytest.approx([0.1] * 3)


def test_fixed_fuzzy_set_centres_do_not_follow_the_inputs() -> None:
    network = T2Fnn(centres="fixed")
    state, _ = network.update(network.init(0.3, -0.2), 0.5, -0.7, 0.1, 0.05)
    assert np.array_equal(state.c1, network.init(0.3, -0.2).c1)


def test_width_and_q_adaptation_can_be_disabled() -> None:
    state = random_state(np.random.default_rng(5))
    frozen, _ = T2Fnn(adapt_widths=False, adapt_q=False).update(state, 0.1, 0.2, 0.3, 0.05)
    assert all(np.array_equal(a, b) for a, b in zip(state[2:6], frozen[2:6], strict=True))
    assert frozen.q == state.q
    assert not np.array_equal(frozen.f, state.f)


def _noisy_run(network: T2Fnn, ticks: int, seed: int) -> tuple[list[T2FnnState], np.ndarray, np.ndarray]:
    """Return states, outputs and sgn(tau_c) for random inputs and errors at 20 Hz."""
    rng = np.random.default_rng(seed)
    state, states, outputs, signs = network.init(*rng.normal(size=2)), [], [], []
    for _ in range(ticks):
        x1, x2, tau_c = rng.normal(size=3)
        state, tau_n = network.update(state, x1, x2, tau_c, 0.05)
        states.append(state)
        outputs.append(tau_n)
        signs.append(tau_c / (abs(tau_c) + network.delta_s))
    return states, np.array(outputs), np.array(signs)


def test_firing_strengths_are_constant_while_centres_follow_inputs() -> None:
    states, _, _ = _noisy_run(T2Fnn(adapt_widths=False), 400, 6)
    first, last = states[0], states[-1]
    assert last.x1 is not None
    assert last.x2 is not None
    assert abs(last.x1 - first.x1) > 0.1
    for a, b in zip(plain_firing(first, first.x1, first.x2), plain_firing(last, last.x1, last.x2), strict=True):
        assert a == pytest.approx(b, abs=1e-12)


def test_network_integrates_the_sign_of_tau_c_while_q_is_constant() -> None:
    network = T2Fnn(adapt_widths=False, adapt_q=False, alpha=0.2)
    _, outputs, signs = _noisy_run(network, 400, 7)
    integral = np.concatenate([[0.0], np.cumsum(signs[:-1]) * 0.05])
    assert outputs - outputs[0] == pytest.approx(-0.2 * integral, abs=1e-12)
    assert np.abs(integral).max() > 0.3


def test_width_adaptation_does_not_change_the_firing_strengths() -> None:
    states, _, _ = _noisy_run(T2Fnn(alpha=0.5), 2000, 8)
    first, last = states[0], states[-1]
    assert np.abs(last.d1_upper / first.d1_upper - 1).max() > 0.1
    for a, b in zip(plain_firing(first, first.x1, first.x2), plain_firing(last, last.x1, last.x2), strict=True):
        assert a == pytest.approx(b, rel=0.02)


@pytest.mark.parametrize(("adapt_q", "factor"), [(True, 2), (False, 1)])
def test_rate_of_network_output_doubles_when_weight_q_is_adapted(adapt_q: bool, factor: int) -> None:
    rng, compared, network = np.random.default_rng(9), 0, T2Fnn(alpha=ALPHA, adapt_q=adapt_q)
    while compared < 100:
        state, (x1, x2), tau_c = random_state(rng), rng.uniform(-0.5, 0.5, 2), rng.normal()
        if not far_from_guards(state, x1, x2):
            continue
        new, tau_n = network.update(state, x1, x2, tau_c, STEP)
        rate = (network.infer(new, x1, x2) - tau_n) / STEP
        assert rate == pytest.approx(-factor * ALPHA * tau_c / (abs(tau_c) + 0.05), rel=1e-3)
        compared += 1


def _reaching(network: T2Fnn, seed: int, warm_up: int) -> None:
    """Check Theorem 1 for one exogenous tau(t) with a rate below B < alpha, and random inputs."""
    rng, dt, alpha = np.random.default_rng(seed), 0.05, network.alpha
    B, kind = alpha * rng.uniform(0, 0.95), seed % 3
    state, tau = network.init(*rng.normal(size=2)), 0.0
    chatter = (3 * alpha + B) * dt
    for k in range(warm_up):
        tau += B * dt * np.sin(0.7 * k * dt)
        tau_c = network.infer(state, state.x1, state.x2) + tau
        state, _ = network.update(state, *rng.normal(size=2), tau_c, dt)
    tau += copysign(rng.uniform(0.1, 1.5), rng.normal())
    tau_c = start = network.infer(state, state.x1, state.x2) + tau
    reached, deadline = None, abs(start) / (alpha - B)
    for k in range(round(deadline / dt) + 100):
        if reached is None and tau_c * np.sign(start) < alpha * dt:
            reached = k * dt
        assert reached is None or abs(tau_c) < chatter
        rate = (np.sign(start), np.sin(1.3 * k * dt), rng.uniform(-1, 1))[kind] * B  # the first one is the worst case
        state, _ = network.update(state, *rng.normal(size=2), tau_c, dt)
        tau += rate * dt
        tau_c = network.infer(state, state.x1, state.x2) + tau
    assert reached is not None
    assert reached <= deadline + dt


@pytest.mark.parametrize("warm_up", [0, 500])
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("alpha", [0.05, 0.5])
def test_tau_c_reaches_zero_within_the_deadline_of_theorem_1(alpha: float, seed: int, warm_up: int) -> None:
    _reaching(T2Fnn(alpha=alpha, delta_s=1e-6), seed, warm_up)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(300))
def test_tau_c_reaches_zero_in_time_after_long_random_runs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = {"rules_1": int(rng.integers(1, 6)), "rules_2": int(rng.integers(1, 6))}
    _reaching(T2Fnn(alpha=10 ** rng.uniform(-2, 0.5), delta_s=1e-6, **size), seed, int(rng.integers(3000)))


@pytest.mark.parametrize("kind", [T2Fnn, T1Fnn])
@pytest.mark.parametrize("changes", [{}, {"centres": "fixed"}, {"adapt_widths": False}, {"adapt_q": False}])
def test_compiled_tick_equals_the_sequence_of_its_steps(kind: type[T2Fnn], changes: dict[str, Any]) -> None:
    """The results are bit-identical over a hundred ticks with and without learning."""
    network, rng = kind(alpha=0.3, **changes), np.random.default_rng(5)
    state = network.init(0.1, -0.2)
    for k in range(100):
        x1, x2, tau_c = rng.uniform(-0.4, 0.4, 3).tolist()
        found, tau_n = network.update(state, x1, x2, tau_c, TICK, learn=k % 3 != 0)
        follow = network.centres == "follow"
        at = state._replace(
            c1=state.c1 + (x1 - state.x1) * follow, c2=state.c2 + (x2 - state.x2) * follow, x1=x1, x2=x2
        )
        expected, rates = network.infer(at, x1, x2), derivatives(network, at, x1, x2, tau_c)
        assert tau_n == expected
        assert np.array_equal(found.c1, at.c1)
        if k % 3 == 0:
            assert all(np.array_equal(one, other) for one, other in zip(found, at, strict=True))
        else:
            assert np.array_equal(found.f, at.f + TICK * rates.f)
            q = at.q + TICK * rates.q
            learns = network.adapt_q and not network.type_1 and 0 <= q <= 1
            assert found.q == (q if learns else at.q)
            assert network.adapt_widths or np.array_equal(found.d1_upper, at.d1_upper)
        state = found
