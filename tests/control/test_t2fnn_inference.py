import numpy as np
import pytest
from network_states import plain_firing, random_state
from pyit2fls import IT2FS, IT2TSK, BMM_algorithm, max_s_norm, product_t_norm, tri_mf

from agrobot_mj.control.t2fnn import T1Fnn, T2Fnn, T2FnnState


def _peer_output(s: T2FnnState, x1: float, x2: float) -> float:
    """Return the output of the same network in the library pyit2fls."""

    def sets(c: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> list[IT2FS]:
        domain = np.linspace(-3, 3, 3)
        return [
            IT2FS(domain, tri_mf, [m - u, m, m + u, 1.0], tri_mf, [m - w, m, m + w, 1.0])
            for m, w, u in zip(c, lower, upper, strict=True)
        ]

    peer = IT2TSK(product_t_norm, max_s_norm)
    peer.algorithm = lambda intervals: np.array([BMM_algorithm(intervals, [s.q, 1 - s.q])] * 2)
    for name in ("x1", "x2"):
        peer.add_input_variable(name)
    peer.add_output_variable("y")
    sets_1, sets_2 = sets(s.c1, s.d1_lower, s.d1_upper), sets(s.c2, s.d2_lower, s.d2_upper)
    for (i, j), f in np.ndenumerate(s.f):
        peer.add_rule([("x1", sets_1[i]), ("x2", sets_2[j])], [("y", {"const": f, "x1": 0.0, "x2": 0.0})])
    return float(peer.evaluate({"x1": x1, "x2": x2})["y"])


def test_output_equals_pyit2fls_for_1000_random_states() -> None:
    rng, compared = np.random.default_rng(1), 0
    while compared < 1000:
        state, (x1, x2) = random_state(rng), rng.uniform(-0.5, 0.5, 2)
        if not plain_firing(state, x1, x2)[0].any():
            continue  # pyit2fls returns NaN if only the upper sets fire
        assert T2Fnn().infer(state, x1, x2) == pytest.approx(_peer_output(state, x1, x2), abs=1e-12)
        compared += 1


def test_output_uses_upper_firing_strengths_when_lower_ones_are_zero() -> None:
    rng, compared = np.random.default_rng(2), 0
    while compared < 50:
        state, (x1, x2) = random_state(rng), rng.uniform(-1.5, 1.5, 2)
        W_lower, W_upper = plain_firing(state, x1, x2)
        if W_lower.any() or not W_upper.any():
            continue
        expected = (1 - state.q) * (W_upper * state.f).sum()
        assert T2Fnn().infer(state, x1, x2) == pytest.approx(expected, abs=1e-12)
        compared += 1


def test_infer_does_not_change_the_state() -> None:
    network = T2Fnn()
    state = network.init(0.0, 0.0)
    before = [np.copy(part) for part in state]
    assert network.infer(state, 0.1, 0.1) != network.infer(state, 0.0, 0.0)
    assert all(np.array_equal(a, b) for a, b in zip(before, state, strict=True))


def test_infer_accepts_integers_lists_and_strided_arrays() -> None:
    whole = T2FnnState([0, 1], [0], [2, 2], [3, 3], [1], [2], [[1], [2]], 1)  # type: ignore[arg-type]
    arrays = T2FnnState(*(np.array(part, dtype=float) for part in whole[:7]), 1.0)
    assert T2Fnn().infer(whole, 0.2, 0.1) == T2Fnn().infer(arrays, 0.2, 0.1)
    strided = arrays._replace(c1=np.array([0.0, 9.0, 1.0])[::2])
    assert T2Fnn().infer(strided, 0.2, 0.1) == T2Fnn().infer(arrays, 0.2, 0.1)


def test_equal_lower_and_upper_widths_give_a_type_1_network() -> None:
    network, rng = T1Fnn(rules_1=4, rules_2=2, alpha=0.5), np.random.default_rng(3)
    state = network.init(0.2, -0.1)
    for _ in range(500):
        x1, x2, tau_c = rng.normal(size=3)
        state, _ = network.update(state, x1, x2, tau_c, 0.05)
        mu_1 = np.maximum(1 - np.abs(x1 - state.c1) / state.d1_upper, 0)
        mu_2 = np.maximum(1 - np.abs(x2 - state.c2) / state.d2_upper, 0)
        plain = (mu_1 @ state.f @ mu_2) / (mu_1.sum() * mu_2.sum())
        assert network.infer(state, x1, x2) == pytest.approx(plain, abs=1e-12)
        assert np.array_equal(state.d1_lower, state.d1_upper)
        assert np.array_equal(state.d2_lower, state.d2_upper)
    assert state.q == network.q_init
    assert not np.allclose(state.d1_upper, network.width_upper_1)
