"""Runs that share a past: the noise of a run goes on otherwise from the ticks of its branches.

A run is known by its scenario and its branches, so that it can be driven again anywhere. Within a process the states of
runs are kept, one each second, so that a run begins where it leaves one that was driven before.
"""

import pickle
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.snapshot import Snapshot
from agrobot_mj.simulation.stepping import Simulation

EVERY = 20
"""Ticks between two states that are kept [-]: a second."""
MOST_BYTES = 200_000_000
"""Size of the states that are kept, the last ones used [bytes]: hundreds of runs, fewer where the soil remembers."""


class Branch(NamedTuple):
    """Where the noise of a run goes on otherwise."""

    tick: int
    """Number of ticks before it."""
    number: int
    """Number of its streams, see `Simulation.branch`."""


class _States:
    """Saved states of runs by scenario, branches before them, and tick."""

    def __init__(self) -> None:
        self._known: OrderedDict[tuple[str, tuple[Branch, ...], int], tuple[Snapshot, int]] = OrderedDict()
        self._bytes = 0

    def keep(self, name: str, branches: tuple[Branch, ...], sim: Simulation) -> None:
        """Keep the present state of a run, and forget those not used for longest where they are too large."""
        rows, state, key = sim.rows, sim.save(), (name, _before(branches, sim.rows.filled), sim.rows.filled)
        size = len(pickle.dumps(state.loop)) + EVERY * (rows.values[0].nbytes + rows.poses[0].nbytes)
        self._bytes += size - self._known.pop(key, (state, 0))[1]
        self._known[key] = state, size
        while self._bytes > MOST_BYTES:
            self._bytes -= self._known.popitem(last=False)[1][1]

    def latest(self, name: str, branches: tuple[Branch, ...]) -> Snapshot | None:
        """The last state that is known of this run up to its last branch."""
        for tick in range(branches[-1].tick // EVERY * EVERY if branches else 0, 0, -EVERY):
            key = name, _before(branches, tick), tick
            if key in self._known:
                self._known.move_to_end(key)
                return self._known[key][0]
        return None


def _before(branches: tuple[Branch, ...], tick: int) -> tuple[Branch, ...]:
    return tuple(branch for branch in branches if branch.tick < tick)


_STATES = _States()


def steps(sim: Simulation, branches: Sequence[Branch]) -> Iterator[None]:
    """Drive a run to its end with these branches, in the order of their ticks; control returns after each tick."""
    past, name = tuple(branches), _name(sim.scenario)
    if state := _STATES.latest(name, past):
        sim.restore(state)
    else:
        sim.reset()
    left = [branch for branch in past if branch.tick >= sim.rows.filled]
    while not sim.done:
        while left and left[0].tick == sim.rows.filled:
            sim.branch(left.pop(0).number)
        sim.step()
        if sim.rows.filled % EVERY == 0 and not sim.done:
            _STATES.keep(name, past, sim)
        yield


def _name(scenario: Scenario) -> str:
    return scenario.model_dump_json()
