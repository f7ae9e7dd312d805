"""Guidance laws and estimators in Python within episodes."""

import builtins
import copy
import time
from math import nan
from typing import Any, Literal

import numpy as np
import pytest
from numba import config

from agrobot_mj import load_scenario, run
from agrobot_mj.control.base import GuidanceLaw
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Column, Command, Estimate
from agrobot_mj.estimation.base import StateEstimator
from agrobot_mj.simulation import interpreted
from agrobot_mj.simulation.episodes import SHORTEST
from agrobot_mj.simulation.stepping import Simulation

pytestmark = [
    pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled"),
    pytest.mark.filterwarnings("ignore:Pydantic serializer"),
]


class Counting(GuidanceLaw):
    """Law with side effects: it stores the time of each call, and its behaviour depends on the keys."""

    kind: Literal["counting"] = "counting"
    calls: list[float] = []
    voltage_between: tuple[float, float] = (nan, nan)
    fails_at: float = nan
    nan_at: float = nan
    numbers: int = 1

    def update(self, state, situation, dt):
        self.calls.append(situation.t)
        if situation.t >= self.fails_at:
            raise ValueError(f"no command at {situation.t:.2f} s")
        steer = nan if situation.t >= self.nan_at else 0.02 * np.sin(situation.t)
        low, high = self.voltage_between
        voltage = 6.4 if low <= situation.t < high else None
        return None, Command(float(steer), 1.2, voltage)

    @property
    def columns(self):
        return (Column("called", "-", "number of calls"),)

    def report(self, state):
        return [float(len(self.calls))] * (self.numbers if len(self.calls) > 30 else 1)


class FromTruth(StateEstimator):
    """Estimator that returns the fix, with an error after the time `wrong_after`."""

    kind: Literal["from_truth"] = "from_truth"
    wrong_after: float = nan
    wrong: Any = None
    variance: float = 0.01

    def init(self, x, y, yaw, tractor):
        return (x, y, yaw)

    def update(self, state, measurement, dt):
        x, y, yaw = state
        assert measurement.readings["gnss"].fix[:2] == measurement.fix[:2]
        if measurement.fix:
            x, y = measurement.fix.x, measurement.fix.y
        if measurement.t > self.wrong_after and self.wrong == "raise":
            raise RuntimeError("lost")
        found = self.wrong if measurement.t > self.wrong_after else 0.01
        return (x, y, yaw), Estimate(x, y, yaw, found, 0.0, x, y, self.variance * np.eye(3))


def simulated(part: Any, most: int, name: str = "guidance", **overrides: Any) -> Simulation:
    """Return a finished simulation with an own law or estimator, in calls of `advance` or, for `most` 0, of `step`."""
    base = load_scenario("straight_line", {"duration_s": 12.0, **overrides})
    sim = Simulation(base.model_copy(update={name: part}))
    sim.reset()
    advance_to_end(sim, most)
    return sim


def advance_to_end(sim: Simulation, most: int) -> None:
    calls = 0
    while not sim.done:
        calls += 1
        if most:
            sim.advance(most)
        else:
            sim.step()
    assert most < 200 or calls < 0.6 * sim.rows.filled


def ended(sim: Simulation) -> tuple[Any, ...]:
    values = np.ascontiguousarray(sim.rows.values[: sim.rows.filled])
    return sim.outcome, sim.reason, sim.rows.filled, values.tobytes()


@pytest.mark.parametrize("most", [0, SHORTEST, 200])
@pytest.mark.parametrize("law", [{}, {"voltage_between": (3.02, 6.0)}, {"nan_at": 4.0}])
def test_law_with_side_effects_is_called_once_per_tick(law, most):
    sim = simulated(Counting(calls=[], **law), most)
    times = sim.scenario.guidance.calls
    assert times == sorted(set(times))
    assert len(times) == sim.rows.filled + (sim.outcome == "diverged")


@pytest.mark.parametrize("law", [{}, {"voltage_between": (3.02, 6.0)}, {"nan_at": 4.0}])
def test_log_with_a_user_defined_law_does_not_depend_on_episodes(law):
    single, episodes = (simulated(Counting(calls=[], **law), most) for most in (0, 200))
    assert ended(single) == ended(episodes)


@pytest.mark.parametrize("part", [FromTruth(), FromTruth(variance=0.0), FromTruth(wrong_after=5.0, wrong=nan)])
def test_log_with_a_user_defined_estimator_does_not_depend_on_episodes(part):
    single, episodes = (simulated(part, most, "estimator") for most in (0, 200))
    assert ended(single) == ended(episodes)


def test_position_nees_is_missing_for_a_zero_covariance():
    sim = simulated(FromTruth(variance=0.0), 200, "estimator", duration_s=2.0)
    assert sim.outcome == "completed"
    assert np.isnan(sim.rows.column("position_nees")).all()
    assert sim.log().metrics["position_nees"] is None


@pytest.mark.parametrize(
    ("part", "name", "error", "text"),
    [
        (Counting(fails_at=5.0), "guidance", ValueError, "no command at 5.00 s"),
        (Counting(numbers=2), "guidance", ScenarioError, "must return 1 numbers"),
        (FromTruth(wrong_after=5.0, wrong="raise"), "estimator", RuntimeError, "lost"),
        (FromTruth(wrong_after=5.0, wrong="fast"), "estimator", ScenarioError, "non-numeric"),
    ],
)
def test_error_of_an_interpreted_stage_is_raised_at_the_same_tick(part, name, error, text):
    filled = []
    for most in (0, 200):
        sim = Simulation(load_scenario("straight_line", {"duration_s": 12.0}).model_copy(update={name: part}))
        sim.reset()
        part.__dict__.get("calls", []).clear()
        with pytest.raises(error, match=text):
            advance_to_end(sim, most)
        filled.append(sim.rows.filled)
    assert filled[0] == filled[1] > 0


@pytest.mark.parametrize(
    ("overrides", "stages"),
    [
        ({}, None),
        ({"guidance.kind": "pure_pursuit"}, "guidance"),
        ({"guidance.kind": "pure_pursuit", "estimator.kind": "ukf"}, "estimator, guidance"),
        ({"sensors.gnss.latency_s": 0.1}, "sensors"),
        ({"plant.kind": "bicycle"}, None),
    ],
)
def test_metrics_name_the_interpreted_stages(overrides, stages):
    log = run(load_scenario("straight_line", {"duration_s": 1.0, **overrides}))
    assert log.metrics.get("interpreted_stages") == stages


class Drawing(GuidanceLaw):
    """Law whose state changes in place, with a voltage in every 37th tick, which ends an episode."""

    kind: Literal["drawing"] = "drawing"

    def init(self):
        return {"ticks": 0, "noise": np.random.default_rng(1)}

    def update(self, state, situation, dt):
        state["ticks"] += 1
        steer = 0.01 * state["noise"].standard_normal()
        return state, Command(steer, 1.2, None if state["ticks"] % 37 else 6.3)


def waiting(sim: Simulation) -> Simulation:
    """Advance to a tick for which an episode has already called the law."""
    while sim.loop.law.pending is None:
        sim.advance()
    return sim


def begun(part: Any) -> Simulation:
    sim = Simulation(load_scenario("straight_line", {"duration_s": 12.0}).model_copy(update={"guidance": part}))
    sim.reset()
    return sim


@pytest.mark.parametrize("most", [0, 200])
def test_command_computed_in_an_ended_episode_is_kept_when_a_run_is_saved(most):
    sim, restored = waiting(begun(Drawing())), begun(Drawing())
    copied, state = copy.deepcopy(sim), sim.save()
    restored.restore(state)
    for each in (sim, copied, restored):
        advance_to_end(each, 0 if most == 0 else 50)
    assert ended(sim) == ended(copied) == ended(restored) == ended(simulated(Drawing(), 0))


def test_restored_run_ignores_a_command_computed_before_the_restore():
    sim = begun(Drawing())
    state = sim.save()
    waiting(sim).restore(state)
    advance_to_end(sim, 0)
    assert ended(sim) == ended(simulated(Drawing(), 0))


def test_law_command_computed_before_an_external_command_is_discarded():
    law = Counting(calls=[], voltage_between=(3.02, 6.0))
    sim = waiting(begun(law))
    sim.step(steer=0.0, speed=1.0)
    sim.step()
    assert law.calls[-1] == pytest.approx(law.calls[-2] + 0.05)


def test_slow_law_ends_an_episode_after_its_time_limit(monkeypatch):
    monkeypatch.setattr(interpreted, "LONGEST_S", 0.0)
    sim = simulated(Counting(calls=[]), 50)
    monkeypatch.undo()
    assert ended(sim) == ended(simulated(Counting(calls=[]), 0))
    law = Counting(calls=[])
    sim = begun(law)
    monkeypatch.setattr(Counting, "update", lambda *given: time.sleep(0.02) or (None, Command(0.0, 1.2)))
    sim.advance()
    assert 0 < sim.rows.filled < 60


class Reporting(Counting):
    """Law whose report is invalid after 2 s."""

    kind: Literal["reporting"] = "reporting"
    odd: Any = None
    raises: str = ""

    def report(self, state):
        if len(self.calls) <= 40:
            return (1.0,)
        if self.raises:
            raise getattr(builtins, self.raises)
        return self.odd


@pytest.mark.parametrize(
    ("odd", "error"),
    [
        *((odd, ScenarioError) for odd in (None, 1.0, (None,), "1", ("1",), (10**400,), (1.0, 2.0), ())),
        *((e.__name__, e) for e in (SystemExit, GeneratorExit, KeyboardInterrupt, StopIteration, ValueError)),
    ],
)
@pytest.mark.filterwarnings("error")  # an exception in a callback is a warning
def test_invalid_report_of_a_law_raises_an_error_at_the_same_tick(odd, error):
    filled = []
    for most in (0, 200):
        raises = odd if isinstance(odd, str) and odd != "1" else ""
        sim = begun(Reporting(calls=[], odd=odd, raises=raises))
        with pytest.raises(error):
            advance_to_end(sim, most)
        filled.append(sim.rows.filled)
    assert filled[0] == filled[1] > 35


def test_simulation_with_an_interpreted_law_is_freed_at_once():
    import gc
    import weakref

    sim = simulated(Counting(calls=[]), 200)
    loop = weakref.ref(sim.loop)
    gc.disable()
    try:
        del sim
        assert loop() is None
    finally:
        gc.enable()
