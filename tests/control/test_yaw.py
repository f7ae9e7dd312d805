from math import nan, radians

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from agrobot_mj.control import Controller, OpenLoop, Pd, PdIsgn, PdT1fnn, PdT2fnn
from agrobot_mj.control.base import YawCommand
from agrobot_mj.control.t2fnn import T1Fnn, T2Fnn
from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.spec import every

TICK, LIMIT = 0.05, radians(45)


def _run(controller, errors, limit: float = LIMIT) -> tuple[object, list[YawCommand]]:
    state, commands = controller.init(), []
    for k, e in enumerate(errors):
        state, command = controller.update(state, k * TICK, e, TICK, limit)
        commands.append(command)
    return state, commands


def _errors(n: int = 400) -> list[float]:
    return list(0.5 * np.sin(0.3 * np.arange(n)) + np.random.default_rng(1).normal(0.2, 0.2, n))


@pytest.mark.parametrize("kind", every(Controller))
def test_every_controller_respects_the_steering_limit(kind) -> None:
    _, commands = _run(kind(), _errors(), limit=0.05)
    assert max(abs(c.steer) for c in commands) == 0.05


@pytest.mark.parametrize("kind", [kind for kind in every(Controller) if kind is not OpenLoop])
def test_every_closed_loop_controller_uses_the_yaw_rate_error(kind) -> None:
    _, commands = _run(kind(), _errors())
    wanted = [np.clip(c.tau_c - c.tau_n, -LIMIT, LIMIT) for c in commands]
    assert [c.steer for c in commands] == pytest.approx(wanted, abs=1e-15)
    assert [c.tau_c for c in commands] == pytest.approx([kind().kp * e for e in _errors()])


@pytest.mark.parametrize("kind", every(Controller))
def test_every_controller_is_selected_by_its_kind(kind) -> None:
    assert TypeAdapter(Controller).validate_python({"kind": kind().kind}) == kind()


@pytest.mark.parametrize("kind", every(Controller))
def test_repeated_runs_of_one_controller_object_are_identical(kind) -> None:
    def shown() -> str:
        state, commands = _run(controller, _errors(50))
        return str((state._replace(network=fetched(state.network)) if hasattr(state, "network") else state, commands))

    controller = kind()
    assert shown() == shown()


def test_open_loop_controller_applies_its_step_at_the_configured_time() -> None:
    _, commands = _run(OpenLoop(steer_deg=-3.0, at_s=1.0), [9.0] * 30)
    assert [c.steer for c in commands] == [0.0] * 20 + [radians(-3.0)] * 10
    assert commands[0].tau_c == commands[0].tau_n == 0
    assert _run(OpenLoop(steer_deg=60.0, at_s=0.0), [0.0], limit=0.2)[1][0].steer == 0.2


def test_pd_command_is_proportional_plus_derivative_term() -> None:
    _, commands = _run(Pd(kp=0.7, kd=0.1, derivative_filter_s=0.0), [0.0, 0.02, 0.04, 0.04])
    assert [c.steer for c in commands] == pytest.approx([0.0, 0.014 + 0.04, 0.028 + 0.04, 0.028])
    assert commands[0].q is nan
    assert commands[-1].tau_n == 0


def test_pd_isgn_adds_an_integral_of_the_smoothed_error_sign() -> None:
    _, commands = _run(PdIsgn(kp=0.5, alpha=0.2, delta_s=0.05), [0.1] * 11)
    assert commands[0].tau_n == 0
    assert commands[10].tau_n == pytest.approx(-0.2 * 0.05 / (0.05 + 0.05) * 10 * TICK)
    assert commands[10].steer > commands[0].steer > 0


def test_type_1_network_with_constant_widths_equals_pd_isgn() -> None:
    _, network = _run(PdT1fnn(network=T1Fnn(adapt_widths=False)), _errors())
    _, integral = _run(PdIsgn(), _errors())
    start = network[0].tau_n
    assert [c.tau_n - start for c in network] == pytest.approx([c.tau_n for c in integral], abs=1e-12)
    assert max(abs(c.tau_n) for c in integral) > 0.05


def test_t2fnn_output_increases_the_steering_command_of_the_pd_term() -> None:
    _, commands = _run(PdT2fnn(), [0.1] * 200)
    assert commands[-1].steer > commands[0].steer > 0
    assert commands[-1].tau_n < 0
    assert commands[0].q == PdT2fnn().network.q_init


def test_fuzzy_set_centres_start_at_the_first_error_and_follow_the_error() -> None:
    controller = PdT2fnn(kd=0.1)
    fixed = PdT2fnn(network=T2Fnn(centres="fixed"))
    started, _ = fixed.update(fixed.init(), 0.0, 0.7, TICK, LIMIT)
    assert np.array_equal(fetched(started.network).state.c1, fixed.network.init(0.7, 0.0).c1)
    state, _ = controller.update(controller.init(), 0.0, 0.7, TICK, LIMIT)
    network = fetched(state.network).state
    assert (network.x1, network.x2) == (0.7, 0.0)
    assert network.c1 == pytest.approx(controller.network.init(0.7, 0.0).c1)
    later, _ = controller.update(state, TICK, 0.8, TICK, LIMIT)
    after = fetched(later.network).state
    assert after.x2 == later.slope.rate > 0
    assert after.c1 - network.c1 == pytest.approx([0.1] * 3)


def test_command_uses_network_output_and_weight_q_from_before_the_update() -> None:
    controller, weights = PdT2fnn(network=T2Fnn(alpha=0.01)), set()
    state, _ = controller.update(controller.init(), 0.0, 0.1, TICK, LIMIT)
    for k, e in enumerate(_errors()):
        before = fetched(state.network).state
        state, command = controller.update(state, k * TICK, e, TICK, LIMIT)
        assert command.tau_n == pytest.approx(controller.network.infer(before, before.x1, before.x2))
        assert command.q == before.q
        weights.add(command.q)
    assert len(weights) > 10


@pytest.mark.parametrize("kind", [PdT2fnn, PdT1fnn])
def test_anti_windup_stops_learning_while_command_is_clipped(kind) -> None:
    _, free = _run(kind(), [2.0] * 300, limit=0.3)
    state, held = _run(kind(anti_windup=True), [2.0] * 300, limit=0.3)
    assert abs(free[-1].tau_n) > 0.1
    assert held[-1].tau_n == held[2].tau_n
    _, again = _run(kind(anti_windup=True), [2.0] * 50 + [0.1] * 50, limit=0.3)
    assert abs(again[-1].tau_n - again[50].tau_n) > 0.01
    assert state.saturated


def test_type_1_lower_and_upper_widths_stay_equal_while_learning() -> None:
    with pytest.raises(ValidationError):
        PdT1fnn.model_validate({"network": {"type_1": False}})
    assert PdT1fnn.model_validate({"network": {"alpha": 0.1}}).network.type_1
    assert not T2Fnn().type_1
