"""Simulations that are interrupted or copied at random times. The simulations must continue with bit-identical
results."""

import copy
import gc
import os
import pickle
import random
import signal
import threading
import time

import numpy as np

from agrobot_mj import Simulation, load_scenario, run

STATES = ("hills", "circle", "figure_eight", "ruts", "plough", "steering_backlash", "furrows_across")
"""Names of the simulated scenarios."""
SETTLING = {"plant.settle_s": 0.1}
ACKNOWLEDGED_S = 20.0  # Time in which an interrupt is received, on a busy machine [s]


def interrupts(chance: random.Random) -> str:
    """Interrupt steps or runs at random times. Every interrupt must be received, and the results must not change."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    scenario = _scenario(chance)
    work = chance.choice([_stepped, _stepped, _run_again])
    return f"{scenario.name}, {work.__name__}: {found}" if (found := work(chance, scenario)) else ""


def copies(chance: random.Random) -> str:
    """Copy a simulation at a random tick, possibly repeatedly. All copies and the original must continue
    identically."""
    scenario = _scenario(chance)
    tick, commands = chance.randrange(scenario.ticks - 2), _commands(chance, scenario.ticks)
    sim = Simulation(scenario)
    sim.reset()
    expected, original = _log(_driven(sim, commands)), Simulation(scenario)
    original.reset()
    _driven(original, commands[:tick])
    made = original
    for _ in range(chance.randint(1, 3)):
        made = chance.choice([copy.copy, copy.deepcopy, _pickled, _forked])(made)
    if chance.random() < 0.5:
        _driven(original, [0.3, -0.3, 0.3])
        del original
        gc.collect()
    else:
        if not _equal(_log(_driven(original, commands[tick:])), expected):
            return f"{scenario.name}: the original goes on otherwise after tick {tick}"
    return "" if _equal(_log(_driven(made, commands[tick:])), expected) else f"{scenario.name}: a copy of tick {tick}"


def _scenario(chance: random.Random):
    plant = {"plant.kind": "bicycle", "terrain": {"kind": "flat"}} if chance.random() < 0.2 else SETTLING
    name = chance.choice(STATES if plant is SETTLING else ("circle", "figure_eight"))
    return load_scenario(name, {**plant, "duration_s": chance.choice([0.6, 1.0, 1.7]), "seed": chance.randrange(999)})


def _commands(chance: random.Random, ticks: int) -> list[float | None]:
    """Return a steering angle for each tick [rad], or None for ticks in which the guidance law steers."""
    return [chance.choice([None, None, chance.uniform(-0.5, 0.5)]) for _ in range(ticks)]


def _driven(sim, commands):
    for steer in commands:
        if not sim.done:
            sim.step(steer=steer)
    return sim


def _log(sim):
    log = sim.log()
    return log.outcome, log.rows.values[: log.rows.filled].copy(), log.poses.copy()


def _equal(one, two) -> bool:
    return one[0] == two[0] and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one[1:], two[1:], strict=True))


def _pickled(sim):
    return pickle.loads(pickle.dumps(sim))


def _forked(sim):
    """Return the simulation of a forked process that has advanced and then restored its state."""
    ours, theirs = os.pipe()
    if (child := os.fork()) == 0:
        state = sim.save()
        _driven(sim, [0.2, None])
        sim.restore(state)
        with os.fdopen(theirs, "wb") as pipe:
            pickle.dump(sim, pipe)
        os._exit(0)
    os.close(theirs)
    with os.fdopen(ours, "rb") as pipe:
        made = pickle.load(pipe)
    os.waitpid(child, 0)
    return made


class _Interrupting:
    """Thread that repeatedly sends SIGINT to this process at random times. A signal is sent only after receipt of the
    previous signal."""

    def __init__(self, chance: random.Random, longest_s: float) -> None:
        self.pauses = [chance.uniform(0.0, longest_s) for _ in range(30)]
        self.sent = self.arrived = 0
        self.over, self.lost = threading.Event(), False
        self.thread = threading.Thread(target=self._send, daemon=True)

    def _send(self) -> None:
        for pause in self.pauses:
            if self.over.wait(pause):
                return
            self.sent += 1
            os.kill(os.getpid(), signal.SIGINT)
            end = time.monotonic() + ACKNOWLEDGED_S
            while self.arrived < self.sent:
                if time.monotonic() > end:
                    self.lost = True
                    return
                time.sleep(0.0002)

    def around(self, work) -> str:
        """Call the function `work` again after each interrupt until the function returns. Return a message if
        interrupts were lost."""
        started = False
        while True:
            try:
                if not started:
                    started = True
                    self.thread.start()
                work()
                self.over.set()
                while self.thread.is_alive():
                    self.thread.join(0.01)
                break
            except KeyboardInterrupt:
                self.arrived += 1
        return f"{self.sent} interrupts, {self.arrived} of them arrived" if self.lost else ""


def _stepped(chance: random.Random, scenario) -> str:
    expected, sim = Simulation(scenario), Simulation(scenario)
    expected.reset()
    sim.reset()
    commands = _commands(chance, scenario.ticks)
    wanted = _log(_driven(expected, commands))

    def work() -> None:
        while not sim.done:
            sim.step(steer=commands[sim.rows.filled])

    found = _Interrupting(chance, 0.02).around(work)
    return found or ("" if _equal(_log(sim), wanted) else "goes on otherwise")


def _run_again(chance: random.Random, scenario) -> str:
    wanted, logs = run(scenario), []
    found = _Interrupting(chance, 0.2).around(lambda: logs.append(run(scenario)))
    same = all(np.array_equal(log.rows.values, wanted.rows.values, equal_nan=True) for log in logs)
    return found or ("" if logs and same else "runs otherwise")
