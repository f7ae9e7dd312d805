"""Saved and restored simulations: the continuation of a restored state is bit-identical to the first one."""

import pickle
from typing import Any, Literal

import numpy as np
import pytest
from removed import REMOVED
from turns import by_turns

from agrobot_mj import Simulation, load_scenario
from agrobot_mj.control import GuidanceLaw, Situation
from agrobot_mj.core.errors import CommandError
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Command
from agrobot_mj.core.spec import every
from agrobot_mj.terrain import Terrain
from agrobot_mj.tyres import Tyre

SENSORS = {f"sensors.{name}.enabled": True for name in ("gyro", "imu", "wheel_speed")}
FAULTS = [
    {"kind": "payload", "start_s": 0.5, "end_s": 1.5, "mass_kg": 120.0},
    {"kind": "drawbar", "start_s": 0.2, "pull_n": 900.0, "noise_share": 0.3},
    {"kind": "side_force", "start_s": 0.2, "end_s": 1.7, "force_n": 300.0},
    {"kind": "valve_wear", "start_s": 0.6},
    {"kind": "soft_tyre", "start_s": 0.4},
    {"kind": "gnss_loss", "start_s": 0.7, "end_s": 1.4},
]
LATE = {"estimator.kind": "ekf_full", "sensors.gnss.latency_s": 0.3, **SENSORS}
LINE = {"guidance.kind": "implement_ilc", "sensors.implement_gnss.enabled": True}
LEARNING: dict[str, tuple[str, dict[str, Any]]] = {
    "learning": ("figure_eight", {"guidance.kind": "learned_feedforward"}),
    "learning by place": ("figure_eight", {"guidance.kind": "ilc", "steering.loop.kind": "adaptive"}),
    "observing": ("figure_eight", {"guidance.kind": "eso"}),
    "learning an implement's line": ("seeder_contour", LINE),
}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{f"tyre {tyre.model_fields['kind'].default}": ("circle", _) for tyre in every(Tyre)
       for _ in [{"plant.tyre.kind": tyre.model_fields["kind"].default}]},
    "bicycle": ("figure_eight", {"plant.kind": "bicycle"}),
    "bicycle, worn valve": ("circle", {"plant.kind": "bicycle", "fault": [FAULTS[3]]}),
    "ridges": ("circle", {"terrain.kind": "ridges"}),
    "rough": ("circle", {"terrain.kind": "rough"}),
    "slope, own contact": ("side_slope", {"plant.tyre.kind": "contact"}),
    "slope, ekf_bias": ("side_slope", {"estimator.kind": "ekf_bias"}),
    "late fixes": ("side_slope", LATE),
    "faults": ("circle", {"fault": FAULTS}),
    **({} if "learners" in REMOVED else LEARNING),
    "planning": ("circle", {"plant.kind": "bicycle", "guidance.kind": "nmpc"}),
    "mounted tool": ("trailer_s_bend", {"implement.kind": "mounted", "implement.linkage": "float"}),
    "drawn tool, receiver on it": ("seeder_receiver", {}),
    "no fixes": ("straight_line", {"fault": [{"kind": "gnss_loss", "start_s": 0.5}], "supervisor.max_fix_age_s": 0.5}),
}  # fmt: skip


def drive(sim: Simulation, ticks: int, by_hand: bool = False) -> None:
    for k in range(ticks):
        if sim.done:
            return
        if by_hand:
            sim.step(steer=0.2 * np.sin(0.3 * k), speed=1.0)
        else:
            sim.step()


def record(sim: Simulation) -> tuple[bytes, bytes, str, str]:
    """Return the bytes of the log, and outcome and reason of the end of the run."""
    rows = sim.rows
    return rows.values[: rows.filled].tobytes(), rows.poses[: rows.filled].tobytes(), sim.outcome, sim.reason


DRIVEN = [pytest.param(False, id="own guidance"), pytest.param(True, id="by hand")]


@pytest.mark.parametrize(("case", "by_hand"), by_turns(CASES, DRIVEN))
def test_a_restored_run_continues_bit_identically(case, by_hand):
    if case == "planning":
        pytest.importorskip("casadi", reason="needs casadi; pip install agrobot-mj[nmpc]")
    name, overrides = CASES[case]
    sim, other = Simulation(name, overrides), Simulation(name, overrides)
    sim.reset()
    drive(sim, 22, by_hand)
    state = sim.save()
    drive(sim, 40, by_hand)
    expected = record(sim)
    assert len(expected[0]) > 0
    drive(other, 37)  # somewhere else, under other conditions
    for again in (sim, other, sim):
        again.restore(state)
        drive(again, 40, by_hand)
        assert record(again) == expected


@pytest.mark.parametrize("terrain", [spec.model_fields["kind"].default for spec in every(Terrain)])
def test_saved_run_on_every_terrain_can_be_restored(terrain):
    if terrain == "heightmap":
        pytest.skip("needs a file; it becomes the same grid as the others")
    sim = Simulation("straight_line", {"terrain.kind": terrain, "plant.settle_s": 0.5})
    sim.reset()
    state = sim.save()
    drive(sim, 30)
    expected = record(sim)
    sim.restore(state)
    drive(sim, 30)
    assert record(sim) == expected


def test_restoring_a_state_before_a_payload_removes_its_effects():
    sim = Simulation("circle", {"fault": [{**FAULTS[0], "start_s": 0.2, "end_s": 0.4}]})
    sim.reset()
    before = sim.save()
    drive(sim, 15)
    after = sim.save()
    drive(sim, 15)
    expected = record(sim)
    for state, ticks in ((before, 30), (after, 15)):
        for again in (sim, Simulation(sim.scenario)):
            again.restore(state)
            drive(again, ticks)
            assert record(again) == expected


def test_pickled_state_at_a_block_border_of_the_log_can_be_restored():
    sim = Simulation("circle", {"plant.kind": "bicycle"})
    sim.reset()
    states = {}
    for k in range(100):
        states[k] = sim.save()
        drive(sim, 1)
    expected = record(sim)
    for k in (99, 31, 32, 33, 64, 0, 65, 63):
        other = Simulation(sim.scenario)
        for again in (sim, other):
            again.restore(pickle.loads(pickle.dumps(states[k])))
            assert again.rows.filled == k
            assert again.truth.t == pytest.approx(0.05 * k)
            drive(again, 100 - k)
            assert record(again) == expected


def test_tree_search_with_restored_states_equals_separate_runs():
    def branch(sim, steer):
        for _ in range(5):
            sim.step(steer=steer, speed=1.0)

    sim = Simulation("circle", {"plant.kind": "bicycle"})
    sim.reset()
    leaves = {}
    for first in (-0.2, 0.2):
        sim.reset()
        branch(sim, first)
        state = sim.save()
        for second in (-0.1, 0.1):
            sim.restore(state)
            branch(sim, second)
            leaves[first, second] = record(sim)
    for (first, second), leaf in leaves.items():
        sim.reset()
        branch(sim, first)
        branch(sim, second)
        assert record(sim) == leaf


def test_saved_state_includes_the_end_of_the_run():
    sim = Simulation("circle", {"plant.kind": "bicycle", "duration_s": 1.0})
    sim.reset()
    drive(sim, 19)
    state = sim.save()
    drive(sim, 1)
    ended = sim.save()
    assert sim.outcome == "completed"
    sim.restore(state)
    assert not sim.done
    sim.restore(ended)
    assert sim.outcome == "completed"


def test_restored_run_detects_a_stuck_tractor_in_the_same_tick():
    sim = Simulation("stuck_on_ice")
    sim.reset()
    drive(sim, 100)
    states = []
    while not sim.done:
        states.append(sim.save())
        drive(sim, 20)
    expected = record(sim)
    assert expected[2] == "stuck"
    other = Simulation(sim.scenario)
    other.restore(states[-1])
    drive(other, 20)
    assert record(other) == expected


def test_saved_state_includes_the_number_of_physics_warnings():
    sim = Simulation("circle", {"plant.settle_s": 0.0})
    sim.reset()
    sim.loop.plant.data.warning.number[2] = 5
    state = sim.save()
    other = Simulation(sim.scenario)
    other.restore(state)
    assert other.log().metrics["physics_warnings"] == 5


def test_restore_returns_the_measurement_at_the_time_of_saving():
    sim = Simulation("circle", {"plant.kind": "bicycle"})
    sim.reset()
    drive(sim, 10)
    state, measured = sim.save(), sim.measurement
    drive(sim, 10)
    assert sim.restore(state).steer == measured.steer
    assert sim.situation.route is sim.path


def test_restoring_the_state_of_another_scenario_is_rejected():
    state = Simulation("circle", {"plant.kind": "bicycle"}).save()
    with pytest.raises(CommandError, match=r"a different scenario \(.*seed.* differ\)"):
        Simulation("circle", {"plant.kind": "bicycle", "seed": 9}).restore(state)


class Scribbler(GuidanceLaw):
    """Guidance law that modifies its own state and draws random numbers."""

    kind: Literal["scribbler"] = "scribbler"

    def init(self) -> Any:
        """Return a state with a list, an array and a random generator."""
        return {"steps": [], "sum": np.zeros(2), "generator": stream(1, "scribbler")}

    def update(self, state: Any, situation: Situation, dt: float) -> tuple[Any, Command]:
        """Steer by values that the law has stored in its state."""
        state["steps"].append(situation.t)
        state["sum"] += state["generator"].standard_normal(2)
        return state, Command(0.01 * float(state["sum"][0]) + 0.001 * len(state["steps"]), 1.0)


def test_law_that_mutates_its_state_does_not_change_a_saved_state():
    sim = Simulation(load_scenario("circle", {"plant.kind": "bicycle"}).model_copy(update={"guidance": Scribbler()}))
    sim.reset()
    drive(sim, 10)
    state = sim.save()
    drive(sim, 20)
    expected = record(sim)
    for _ in range(2):
        sim.restore(state)
        drive(sim, 20)
        assert record(sim) == expected
