"""A whole run of a scenario, followed by watchers."""

import time
from collections.abc import Callable
from typing import Protocol

from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.stepping import Simulation

CHUNK_TICKS = 200
"""New rows after which watchers are told: 10 s of simulated time."""
LONG_TICKS, LONG_CHUNK_TICKS = 12_000, 1200
"""Beyond 10 min they are told every 60 s, since each piece of a recording costs memory until its end."""
TELL_S = 5.0
"""Wall time after which they are told in any case, where a run is slow [s]."""


class Watcher(Protocol):
    """Follows a run as it goes: a recording, a progress bar."""

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Before the first tick; `rows` fills as the run goes."""

    def advance(self, first: int) -> None:
        """Rows `first` to `rows.filled` are new."""

    def finish(self, log: Log) -> None:
        """After the last tick; metrics are known."""

    def fail(self, error: BaseException) -> None:
        """Instead of `finish`, where an error ends the run."""


def run(
    scenario: Scenario,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario to its end; writes nothing by itself.

    The same scenario gives bit-identical signals on the same machine. `should_stop` is asked every tick; once it says
    yes the run ends as `aborted`. Raises `ScenarioError` when the scenario's numbers make no tractor.
    """
    sim = Simulation(scenario)
    for watcher in watchers:
        watcher.start(scenario, sim.loop.plant.scene, sim.rows)
    try:
        wall = _drive(sim, watchers, should_stop)
        log = sim.log(wall)
        for watcher in watchers:
            watcher.finish(log)
    except BaseException as error:
        for watcher in watchers:
            watcher.fail(error)
        raise
    return log


def _drive(sim: Simulation, watchers: tuple[Watcher, ...], should_stop: Callable[[], bool]) -> float:
    """Tick by tick to the end; returns the wall time [s]."""
    rows, began, told = sim.rows, time.perf_counter(), 0
    due = began + TELL_S
    sim.reset()
    while not sim.done:
        sim.step()
        if should_stop():
            sim.abort()
        if rows.filled - told >= chunk_ticks(rows.filled) or time.perf_counter() > due:
            for watcher in watchers:
                watcher.advance(told)
            told, due = rows.filled, time.perf_counter() + TELL_S
    wall = time.perf_counter() - began
    for watcher in watchers:
        watcher.advance(told)
    return wall


def chunk_ticks(filled: int) -> int:
    """New rows after which watchers are told, when `filled` rows are there."""
    return CHUNK_TICKS if filled <= LONG_TICKS else LONG_CHUNK_TICKS
