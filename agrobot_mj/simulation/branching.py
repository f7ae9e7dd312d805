"""Branching runs, which have the same past and different noise after a branch.

A run is identified and reproduced by its scenario and its branches. Each process stores the states of its runs once
per simulated second. A new run starts from the last stored state that it shares with an earlier run.
"""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.snapshot import Snapshot
from agrobot_mj.simulation.stepping import Simulation

EVERY = 20  # Number of ticks between stored states [-]: one simulated second
MOST_BYTES = 200_000_000  # Maximum total size of the stored states [bytes]: hundreds of runs, fewer on deformable soil
LEAST_BYTES = 20_000  # Size of a state without its arrays [bytes]. Assumed value (range 10,000-30,000).

NESTED = (np.ndarray, tuple, list, dict)  # Types of the parts of a state that can contain arrays


class Branch(NamedTuple):
    """Branch of a run: index of its first tick, and index of the random streams used from this tick."""

    tick: int  # Number of ticks before the branch
    number: int  # Number of the random streams, see `Simulation.branch`


class _States:
    """Storage of run states by scenario, preceding branches, and tick."""

    def __init__(self) -> None:
        self._known: OrderedDict[tuple[str, tuple[Branch, ...], int], tuple[Snapshot, int]] = OrderedDict()
        self._bytes = 0

    def keep(self, name: str, branches: tuple[Branch, ...], sim: Simulation) -> None:
        """Store the current state of a run. Above a total of MOST_BYTES, delete the least recently used states."""
        rows, state, key = sim.rows, sim.save(), (name, _before(branches, sim.rows.filled), sim.rows.filled)
        size = LEAST_BYTES + _array_bytes(state.loop) + EVERY * (rows.values[0].nbytes + rows.poses[0].nbytes)
        self._bytes += size - self._known.pop(key, (state, 0))[1]
        self._known[key] = state, size
        while self._bytes > MOST_BYTES:
            self._bytes -= self._known.popitem(last=False)[1][1]

    def latest(self, name: str, branches: tuple[Branch, ...]) -> Snapshot | None:
        """Return the latest stored state at or before the last branch of a run, or None without a branch or a state."""
        for tick in range(branches[-1].tick // EVERY * EVERY if branches else 0, 0, -EVERY):
            key = name, _before(branches, tick), tick
            if key in self._known:
                self._known.move_to_end(key)
                return self._known[key][0]
        return None


def _array_bytes(state: Any) -> int:
    """Return the total size of the arrays in nested tuples, lists and dictionaries [bytes]."""
    if isinstance(state, np.ndarray):
        return state.nbytes
    parts = state.values() if isinstance(state, dict) else state
    return sum([_array_bytes(part) for part in parts if isinstance(part, NESTED)])


def _before(branches: tuple[Branch, ...], tick: int) -> tuple[Branch, ...]:
    return tuple(branch for branch in branches if branch.tick < tick)


_STATES = _States()


def steps(sim: Simulation, branches: Sequence[Branch]) -> Iterator[None]:
    """Simulate a run with `branches`, which are sorted by tick, and yield at least once per simulated second."""
    past, name = tuple(branches), _name(sim.scenario)
    if state := _STATES.latest(name, past):
        sim.restore(state)
    else:
        sim.reset()
    left = [branch for branch in past if branch.tick >= sim.rows.filled]
    while not sim.done:
        while left and left[0].tick == sim.rows.filled:
            sim.branch(left.pop(0).number)
        ahead = EVERY - sim.rows.filled % EVERY
        sim.advance(min(ahead, left[0].tick - sim.rows.filled) if left else ahead)
        if sim.rows.filled % EVERY == 0 and not sim.done:
            _STATES.keep(name, past, sim)
        yield


def _name(scenario: Scenario) -> str:
    return scenario.model_dump_json()
