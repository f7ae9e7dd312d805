"""Interrupted steps are completed or undone; copies of a simulation are independent."""

import copy
import gc
import os
import pickle
import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from turns import by_turns

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core.errors import CommandError, ScenarioError
from agrobot_mj.core.long_array import PIECE
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.mujoco.protection import PROTECTED

SHORT = {"plant.settle_s": 0.15, "duration_s": 1.4}
CASES = {
    "mujoco": ("hills", {}),
    "bicycle": ("figure_eight", {"plant.kind": "bicycle"}),
    "faults": ("soft_tyre", {"fault": [{"kind": "payload", "mass_kg": 90.0, "ahead_m": -0.4, "start_s": 0.3}]}),
    "implement": ("plough", {}),
    "ruts": ("ruts", {}),
    "contact": ("hills", {"plant.tyre.kind": "contact"}),
}
WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda sim: pickle.loads(pickle.dumps(sim)),
}


def begun(case, ticks=11):
    name, overrides = CASES[case]
    sim = Simulation(name, SHORT | overrides)
    sim.reset()
    for _ in range(ticks):
        sim.step()
    return sim


def driven(sim):
    """Run a simulation to its end, and return the rows and poses of its log."""
    while not sim.done:
        sim.step()
    log = sim.log()
    assert log.outcome
    return log.rows.values[: log.rows.filled].copy(), log.poses.copy()


def equal(one, two):
    return all(map(lambda a, b: np.array_equal(a, b, equal_nan=True), one, two))


@pytest.mark.parametrize(("case", "way"), by_turns(CASES, WAYS))
def test_copies_of_a_simulation_continue_bit_identically(case, way):
    expected, original = driven(begun(case)), begun(case)
    one, two = WAYS[way](original), WAYS[way](original)
    for _ in range(5):
        two.step(steer=0.4)
    assert equal(driven(one), expected)
    assert equal(driven(original), expected)
    original = begun(case)
    three = WAYS[way](original)
    del original, one, two
    gc.collect()
    assert equal(driven(three), expected)


def test_simulation_can_be_copied_before_the_first_reset_and_after_its_end():
    sim = Simulation("hills", SHORT)
    expected = driven(begun("mujoco", 0))
    one = copy.deepcopy(sim)
    one.reset()
    assert equal(driven(one), expected)
    ended = copy.deepcopy(one)
    assert (ended.done, ended.outcome) == (True, one.outcome)
    assert equal(driven(ended), expected)
    ended.reset()
    assert equal(driven(ended), expected)


class Counting(Simulation):
    """Simulation with an additional attribute."""

    marks = ()


def test_copies_of_subclasses_keep_their_attributes():
    sim = Counting("figure_eight", SHORT | {"plant.kind": "bicycle"})
    sim.marks = [1, 2]
    for way in WAYS.values():
        made = way(sim)
        assert type(made) is Counting
        assert made.marks == [1, 2]
    assert copy.deepcopy(sim).marks is not sim.marks


@pytest.mark.skipif(not hasattr(os, "fork"), reason="POSIX")
@pytest.mark.parametrize("ticks", [60, PIECE + 60], ids=["in memory", "in a file"])
def test_simulations_in_forked_processes_continue_independently(ticks):
    keys = {"plant.kind": "bicycle", "duration_s": ticks * 0.05}

    def sim():
        made = Simulation("figure_eight", keys)
        made.reset()
        for _ in range(9):
            made.step()
        return made

    def on(sim, steer):
        for _ in range(9):
            sim.step(steer=steer)
        return sim.log().rows.values[:18].tobytes()

    expected, original = on(sim(), 0.2), sim()
    ours, theirs = os.pipe()
    if os.fork() == 0:
        os.write(theirs, bytes([on(original, 0.2) == expected]))
        os._exit(0)
    other = on(original, -0.1)
    assert os.read(ours, 1) == b"\1"
    assert original.log().rows.values[:18].tobytes() == other == on(sim(), -0.1)
    os.wait()


def test_step_from_a_second_thread_is_rejected(monkeypatch):
    sim, entered, leave = begun("mujoco"), threading.Event(), threading.Event()
    advance = MujocoPlant.advance_held

    def slow(*arguments):
        entered.set()
        assert leave.wait(60.0)
        return advance(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(MujocoPlant, "advance_held", slow)
        thread = threading.Thread(target=sim.step)
        thread.start()
        assert entered.wait(60.0)
        calls = [sim.step, sim.reset, sim.save, sim.log, lambda: sim.branch(3), lambda: copy.copy(sim)]
        for call in calls:
            with pytest.raises(CommandError, match="in use by another thread"):
                call()
        leave.set()
        thread.join()
    assert equal(driven(sim), driven(begun("mujoco")))


def test_error_in_a_law_leaves_the_state_before_the_step(monkeypatch):
    sim = begun("mujoco")
    law, calls = sim.loop.law, []

    def failing(*arguments):
        calls.append(arguments)
        raise ScenarioError("not today")

    with monkeypatch.context() as patched:
        patched.setattr(law, "update", failing)
        for _ in range(2):
            with pytest.raises(ScenarioError, match="not today"):
                sim.step()
    assert len(calls) == 2
    assert equal(driven(sim), driven(begun("mujoco")))


def test_step_after_an_incomplete_step_is_rejected(monkeypatch):
    sim = begun("mujoco")
    state = sim.save()

    def failing(*arguments):
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(sim.loop.plant, "advance_held", failing)
        with pytest.raises(MemoryError):
            sim.step()
    for call in (sim.step, sim.save, lambda: copy.deepcopy(sim)):
        with pytest.raises(CommandError, match="interrupted the last step"):
            call()
    sim.restore(state)
    assert equal(driven(sim), driven(begun("mujoco")))


@pytest.mark.skipif(not PROTECTED, reason="ends the process on this system")
@pytest.mark.parametrize("in_a_thread", [False, True])
def test_mujoco_error_raises_an_exception_and_keeps_the_process_alive(in_a_thread):
    sim = begun("mujoco")
    state, option = sim.save(), sim.loop.plant.model.opt
    solver, option.solver = option.solver, 55

    def failing():
        with pytest.raises(mujoco.FatalError, match="unknown solver type 55"):
            sim.step()
        return True

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(failing).result() if in_a_thread else failing()
    option.solver = solver
    with pytest.raises(CommandError, match="interrupted the last step"):
        sim.step()
    sim.restore(state)
    assert equal(driven(sim), driven(begun("mujoco")))


@pytest.mark.usefixtures("interruptible")
def test_step_interrupted_while_the_plant_advances_is_completed(monkeypatch):
    """Interrupts occur in every third step while the plant advances in compiled code."""
    sim, advance, count = begun("mujoco", 0), MujocoPlant.advance_held, [0]

    def hit(*arguments):
        count[0] += 1
        if count[0] % 3 == 0:
            os.kill(os.getpid(), signal.SIGINT)
        return advance(*arguments)

    raised = 0
    with monkeypatch.context() as patched:
        patched.setattr(MujocoPlant, "advance_held", hit)
        while not sim.done:
            try:
                sim.step()
            except KeyboardInterrupt:
                raised += 1
    assert raised == count[0] // 3 > 5
    assert equal(driven(sim), driven(begun("mujoco", 0)))


class Observer:
    """Observer that stores the rows and the error of a run."""

    rows, error = None, None

    def start(self, scenario, scene, rows):
        self.rows = rows

    def advance(self, first):
        pass

    def fail(self, error):
        self.error = error


@pytest.mark.usefixtures("single_ticks")
@pytest.mark.usefixtures("interruptible")
def test_interrupts_end_a_run_only_between_ticks(monkeypatch):
    scenario, advance, ticks = load_scenario("hills", SHORT), MujocoPlant.advance_held, []

    def hit(*arguments):
        ticks.append(len(ticks))
        if len(ticks) == 7:
            os.kill(os.getpid(), signal.SIGINT)
        return advance(*arguments)

    seen = Observer()
    monkeypatch.setattr(MujocoPlant, "advance_held", hit)
    with pytest.raises(KeyboardInterrupt):
        run(scenario, (seen,))
    assert len(ticks) == seen.rows.filled == 7
    assert isinstance(seen.error, KeyboardInterrupt)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("interruptible")
def test_interrupt_while_an_observer_starts_cancels_the_run(monkeypatch):
    def start(observer, *_):
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Observer, "start", start)
    observer, steps = Observer(), []
    monkeypatch.setattr(Simulation, "reset", lambda sim: steps.append(sim))
    with pytest.raises(KeyboardInterrupt):
        run(load_scenario("circle", SHORT | {"plant.kind": "bicycle"}), (observer,))
    assert isinstance(observer.error, KeyboardInterrupt)
    assert steps == []
