import numpy as np
import pytest

from agrobot_mj.extensions.learners.learned_feedforward import PathInput, PathNetwork

DT = 0.05


def _inputs(n: int = 200) -> list[PathInput]:
    rng = np.random.default_rng(1)
    return [
        PathInput(*x) for x in np.column_stack([rng.uniform(-0.6, 0.6, n), rng.uniform(0, 4, n), rng.normal(0, 0.2, n)])
    ]


@pytest.mark.parametrize("uncertainty", [0.0, 0.3, 0.49])
def test_firing_strengths_sum_to_one_inside_and_outside_input_range(uncertainty: float) -> None:
    network = PathNetwork(uncertainty=uncertainty)
    for x in _inputs():
        w = network.firing(x)
        assert w.min() >= 0
        assert w.sum() == pytest.approx(1)


def test_network_without_uncertainty_equals_linear_interpolation() -> None:
    """Triangular sets whose width equals the distance of their centres form a partition of unity, so that the output
    is linear."""
    network = PathNetwork(uncertainty=0.0, speed_sets=1, roll_sets=1)
    centres = np.linspace(-network.curvature_range_per_m, network.curvature_range_per_m, network.curvature_sets)
    f = np.random.default_rng(2).normal(size=centres.size)
    for x in _inputs():
        assert network.firing(x) @ f == pytest.approx(np.interp(x.curvature, centres, f))


def test_width_uncertainty_changes_the_firing_strengths() -> None:
    x = PathInput(0.08, 1.2)
    assert not np.allclose(PathNetwork(uncertainty=0.3).firing(x), PathNetwork(uncertainty=0.0).firing(x), atol=0.02)


def test_one_update_changes_the_output_by_learning_rate_times_error() -> None:
    network, x, e = PathNetwork(eta=0.3), PathInput(0.1, 1.2), 0.02
    state = network.init()
    for _ in range(400):
        state = network.fade_traces(state, network.firing(x), DT)
    moved = network.learn(state, e, 1.0, DT)
    assert moved.f @ state.trace - state.f @ state.trace == pytest.approx(0.3 * e * DT)


@pytest.mark.parametrize("uncertainty", [pytest.param(0.0, marks=pytest.mark.slow), 0.3])
def test_network_converges_to_the_true_feedforward_despite_a_lag(uncertainty: float) -> None:
    """The error is the missing feed-forward, atan(L kappa) plus a fraction of the roll, behind a first-order lag."""
    network = PathNetwork(uncertainty=uncertainty, curvature_range_per_m=0.15, curvature_sets=7)
    rng, state, answered, errors = np.random.default_rng(3), network.init(), 0.0, []
    for k in range(40_000):
        if k % 100 == 0:
            x = PathInput(rng.uniform(-0.14, 0.14), 1.2, rng.uniform(-0.1, 0.1))
        wanted = np.arctan(1.4 * x.curvature) + 0.4 * x.roll
        w = network.firing(x)
        answered += (wanted - state.f @ w - answered) * DT / (network.trace_s + DT)
        state = network.learn(network.fade_traces(state, w, DT), answered, 1.0, DT)
        errors.append((wanted, wanted - state.f @ w))
    wanted_square, error_square = np.square(errors[-8000:]).mean(axis=0)
    assert error_square < 0.02 * wanted_square


def test_network_consequents_stay_within_their_bound() -> None:
    network, state, bound = PathNetwork(), PathNetwork().init(), 0.1
    for x in _inputs():
        state = network.fade_traces(network.learn(state, 5.0, bound, DT), network.firing(x), DT)
    assert np.abs(state.f).max() == bound


def test_training_with_mirrored_inputs_gives_a_mirrored_network() -> None:
    network = PathNetwork()
    left = right = network.init()
    for k, x in enumerate(_inputs()):
        mirrored, e = x._replace(curvature=-x.curvature, roll=-x.roll), 0.1 * np.sin(k)
        left = network.learn(network.fade_traces(left, network.firing(x), DT), e, 0.5, DT)
        right = network.learn(network.fade_traces(right, network.firing(mirrored), DT), -e, 0.5, DT)
    for x in _inputs():
        mirrored = x._replace(curvature=-x.curvature, roll=-x.roll)
        assert network.firing(x) @ left.f == pytest.approx(-(network.firing(mirrored) @ right.f), abs=1e-12)
