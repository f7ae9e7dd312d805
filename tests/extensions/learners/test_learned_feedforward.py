"""Learned feed-forward with a feedback law: learning on a plant with known feed-forward, and inhibited learning."""

from math import atan, cos, nan, radians, sin, tan

import numpy as np
import pytest
from pydantic import ValidationError

from agrobot_mj import load_scenario
from agrobot_mj.control import Kinematic, Pd, Situation
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Estimate
from agrobot_mj.extensions.learners.learned_feedforward import LearnedFeedforward, LearnedState, PathNetwork
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths import Circle
from agrobot_mj.paths.route import SampledRoute

DT, MACHINE = 0.05, TractorParameters()
LAW = LearnedFeedforward().using(Pd())


def _situation(path=None, t: float = 20.0, offset: float = 0.0, sigma: float = 0.01, **estimate) -> Situation:
    """Return the situation of a tractor on the path, or `offset` [m] to its left."""
    path = path or Circle()
    r = path.at(t)
    x, y = r.x - offset * sin(r.yaw), r.y + offset * cos(r.yaw)
    found = Estimate(x, y, r.yaw, 1.2, 0.0, x, y, np.eye(3) * sigma**2)._replace(**estimate)
    return Situation(t, found, r, SampledRoute(path), MACHINE, 0.0)


def _drive(law, situation: Situation, ticks: int = 40) -> LearnedState:
    state = law.init()
    for _ in range(ticks):
        state, _ = law.update(state, situation, DT)
    return state


def _follow_circle(law, turn: str, seconds: float = 60.0) -> tuple[LearnedState, list[float]]:
    """Drive a circle with a no-slip tractor, first-order steering lag and noise-free measurements; return the
    feedback angles."""
    path = Circle(direction=turn, turns=2, ramp_s=0.05)
    route, r = SampledRoute(path), path.at(0.0)
    l_r, L = MACHINE.cg_to_rear_axle, MACHINE.wheelbase_m
    x, y, yaw, steer, u, state, feedback = r.x, r.y, r.yaw, 0.0, 1.2, law.init(), []
    for k in range(round(seconds / DT)):
        rate = u * tan(steer) / L
        seen = Estimate(x, y, yaw, u, rate, x, y, np.eye(3) * 1e-4)
        state, command = law.update(state, Situation(k * DT, seen, path.at(k * DT), route, MACHINE, steer), DT)
        steer += (command.steer - steer) * DT / 0.4
        u += (command.speed - u) * DT / 0.5
        x += (u * cos(yaw) - l_r * rate * sin(yaw)) * DT
        y += (u * sin(yaw) + l_r * rate * cos(yaw)) * DT
        yaw += rate * DT
        feedback.append(state.feedback)
    return state, feedback


def test_feedforward_learns_the_kinematic_angle_and_feedback_vanishes() -> None:
    state, feedback = _follow_circle(LAW, "left")
    assert np.mean(np.abs(feedback[-100:])) < 0.05 * np.max(np.abs(feedback))
    sideslip = np.arcsin(MACHINE.cg_to_rear_axle / 10)
    assert state.feedforward == pytest.approx(
        atan(MACHINE.wheelbase_m * tan(sideslip) / MACHINE.cg_to_rear_axle), rel=0.03
    )


def test_mirrored_path_gives_mirrored_commands() -> None:
    left, right = _follow_circle(LAW, "left", 20), _follow_circle(LAW, "right", 20)
    assert np.abs(left[1]).max() > 0.02
    assert left[1] == pytest.approx([-e for e in right[1]], abs=1e-9)
    assert left[0].feedforward == pytest.approx(-right[0].feedforward, abs=1e-9)


def test_feedforward_is_learned_while_on_the_path() -> None:
    state = _drive(LAW, _situation(offset=0.3))
    assert state.learning
    assert np.abs(state.network.f).max() > 0.001


@pytest.mark.parametrize(
    "situation",
    [
        _situation(offset=0.3, sigma=0.5),
        _situation(offset=2.5),
        _situation(offset=0.3, speed=0.1),
        _situation(offset=0.3, speed=-1.2),
        _situation(offset=0.3, aligned=False),
        _situation(offset=0.3, yaw_rate=-9.0),
    ],
    ids=["coasting", "off the path", "standing", "in reverse", "not aligned", "saturated"],
)
def test_feedforward_is_not_learned_while_learning_is_inhibited(situation: Situation) -> None:
    state = _drive(LAW, situation)
    assert not state.learning
    assert not state.network.f.any()
    assert state.feedback != 0


def test_learned_feedforward_is_applied_while_learning_is_inhibited() -> None:
    state = _drive(LAW, _situation(offset=0.3))
    rests, command = LAW.update(state, _situation(offset=0.3, sigma=0.5), DT)
    assert not rests.learning
    assert np.array_equal(rests.network.f, state.network.f)
    assert command.steer == pytest.approx(rests.feedback + rests.feedforward)
    assert rests.feedforward != 0


def test_repeated_update_with_equal_state_gives_equal_results() -> None:
    """Repeated evaluations of one state give the same result."""
    state = _drive(LAW, _situation(offset=0.3))
    kept = [array.copy() for array in state.network]
    first = LAW.update(state, _situation(), DT)[1]
    assert LAW.update(state, _situation(), DT)[1] == first
    assert all(np.array_equal(a, b) for a, b in zip(kept, state.network, strict=True))


def test_law_with_learning_disabled_equals_the_inner_law() -> None:
    inert = LearnedFeedforward(network=PathNetwork(eta=0.0)).using(Pd())
    inner = Kinematic().using(Pd())
    situation = _situation(offset=0.3)
    assert inert.update(inert.init(), situation, DT)[1] == inner.update(inner.init(), situation, DT)[1]


def test_network_consequents_stay_within_their_bound() -> None:
    law = LearnedFeedforward(bound_deg=1.0, network=PathNetwork(eta=50.0)).using(Pd())
    state = _drive(law, _situation(offset=0.3), 200)
    assert np.abs(state.network.f).max() == pytest.approx(radians(1.0))


def test_roll_input_of_the_network_is_zero_without_an_imu() -> None:
    assert LAW.inputs(_situation()).roll == 0
    assert LAW.inputs(_situation()._replace(roll=nan)).roll == 0
    assert LAW.inputs(_situation()._replace(roll=0.1)).roll == 0.1


def test_law_reports_one_value_per_column() -> None:
    state = _drive(LAW, _situation(offset=0.3))
    values = dict(zip((c.name for c in LAW.columns), LAW.report(state), strict=True))
    assert len(values) == len(LAW.columns)
    assert sum(name.startswith("map_") for name in values) == state.network.f.size
    assert values["steer_feedback"] == values["tau_c"] == state.feedback


def test_inner_law_can_be_selected_in_the_scenario() -> None:
    chosen = load_scenario(
        "figure_eight", {"guidance.kind": "learned_feedforward", "guidance.inner.kind": "feedforward"}
    )
    assert chosen.guidance.inner.kind == "feedforward"
    with pytest.raises(ScenarioError, match=r"guidance\.inner"):
        load_scenario(
            "figure_eight", {"guidance.kind": "learned_feedforward", "guidance.inner.kind": "learned_feedforward"}
        )
    with pytest.raises(ValidationError):
        PathNetwork(uncertainty=0.5)
