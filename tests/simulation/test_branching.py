"""Runs with a common past: bit-identical before a branch, with different noise after the branch, and repeatable."""

import json

import numpy as np
import pytest

from agrobot_mj import Simulation, load_scenario
from agrobot_mj.core.randomness import generators, stream
from agrobot_mj.simulation import branching
from agrobot_mj.simulation.branching import Branch
from agrobot_mj.simulation.run import run

SENSORS = {f"sensors.{name}.enabled": True for name in ("gyro", "imu", "wheel_speed")}
FAULTS = [{"kind": "drawbar", "start_s": 0.2, "pull_n": 900.0, "noise_share": 0.3}]
PLANTS = pytest.mark.parametrize("plant", ["bicycle", "mujoco"])


def scenario(plant, seed=1):
    return load_scenario("straight_line", {"plant.kind": plant, "duration_s": 4.0, "seed": seed})


def values(log):
    return log.rows.values[: log.rows.filled]


@pytest.fixture(autouse=True)
def forget(monkeypatch):
    monkeypatch.setattr(branching, "_STATES", branching._States())


@PLANTS
def test_branches_are_bit_identical_before_and_differ_after_branching(plant):
    plain, branched, other = (
        values(run(scenario(plant), branches=branches)) for branches in (None, [Branch(30, 7)], [Branch(30, 8)])
    )
    for one, two in ((plain, branched), (plain, other), (branched, other)):
        assert one[:31].tobytes() == two[:31].tobytes()  # what was sensed before the branch counts in its first tick
        columns = np.flatnonzero(~np.isclose(one[31:], two[31:], equal_nan=True).all(axis=0))
        assert len(columns) > 10


@PLANTS
def test_run_from_a_cached_state_equals_the_run_from_the_beginning(plant, monkeypatch):
    branches = [Branch(25, 1), Branch(47, 2), Branch(47, 3), Branch(66, 4)]
    expected = values(run(scenario(plant), branches=branches)).tobytes()
    monkeypatch.setattr(branching, "_STATES", branching._States())
    for k in range(1, 4):
        run(scenario(plant), branches=branches[:k])
    run(scenario(plant, seed=2), branches=branches)
    begun = []
    monkeypatch.setattr(Simulation, "reset", lambda sim: begun.append(sim))
    assert values(run(scenario(plant), branches=branches)).tobytes() == expected
    assert begun == []


def test_cached_state_after_a_branch_is_used_only_for_the_same_branch():
    run(scenario("bicycle"), branches=[Branch(25, 1)])
    found = values(run(scenario("bicycle"), branches=[Branch(45, 2)]))
    assert found[:46].tobytes() == values(run(scenario("bicycle")))[:46].tobytes()


def test_recently_used_states_are_cached_up_to_a_maximum_size(monkeypatch):
    run(scenario("bicycle", seed=1), branches=[])
    size = branching._STATES._bytes
    assert 3 * 10_000 < size < 3 * 200_000  # of three states of a run of four seconds
    monkeypatch.setattr(branching, "MOST_BYTES", int(1.5 * size))
    for seed in (2, 3):
        run(scenario("bicycle", seed=seed), branches=[])
    kept = {json.loads(name)["seed"] for name, _, _ in branching._STATES._known}
    assert kept <= {2, 3}
    assert size <= branching._STATES._bytes <= 1.5 * size


def test_size_of_a_state_includes_nested_arrays():
    state = 1.0, {"plant": (np.zeros(3), [np.zeros((2, 2))])}, "text"
    assert branching._array_bytes(state) == 8 * (3 + 4)


def test_branch_reseeds_every_random_generator():
    """The first random numbers of all sensors and faults differ from the previous ones and from each other."""
    sim = Simulation(scenario("mujoco").changed({**SENSORS, "fault": FAULTS}))
    sim.reset()
    for _ in range(5):
        sim.step()
    state, first = sim.save(), []
    for number in (None, 1, 2, 1):
        sim.restore(state)
        if number is not None:
            sim.branch(number)
        first.append([generator.standard_normal() for generator in generators(vars(sim.loop.stages))])
    plain, one, two, again = first
    assert one == again
    assert len(plain) >= 12
    assert len({*plain, *one, *two}) == 3 * len(plain)


def test_random_generators_are_found_in_nested_objects():
    class Own:
        def __init__(self, generator):
            self.inner = {"deep": [generator, (generator, 1)]}

    globals()["Own"] = Own
    Own.__qualname__ = "Own"
    a, b = stream(1, "a"), stream(1, "b")
    assert generators((Own(a), [b], np.zeros(3))) == [a, b]
