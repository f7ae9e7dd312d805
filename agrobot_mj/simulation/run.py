"""A complete run of a scenario, followed by watchers."""

import time
from collections.abc import Callable
from typing import Protocol

from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.stepping import Simulation

CHUNK_TICKS = 200
"""Number of new rows after which watchers are called: 10 s of simulated time."""
LONG_TICKS, LONG_CHUNK_TICKS = 12_000, 1200
"""Length of a run beyond which watchers are called only every 60 s, since each piece of a recording costs memory until
its end: 10 min."""
REPORT_S = 5.0
"""Wall time after which watchers are called in any case, if a run is slow [s]."""


class Watcher(Protocol):
    """Follows a run as it goes: a recording, a progress bar."""

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Called before the first tick; `rows` fills during the run."""

    def advance(self, first: int) -> None:
        """Called when rows `first` to `rows.filled` are new."""

    def finish(self, log: Log) -> None:
        """Called after the last tick; metrics are known."""

    def fail(self, error: BaseException) -> None:
        """Called instead of `finish` if an error ends the run."""


def run(
    scenario: Scenario,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario to its end; writes nothing by itself.

    The same scenario gives bit-identical signals on the same machine. `should_stop` is called every tick; once it
    returns True the run ends as `aborted`. Raises `ScenarioError` if the parameters describe no possible tractor.
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
    """Run tick by tick to the end; returns the wall time [s]."""
    rows, began, reported = sim.rows, time.perf_counter(), 0
    due = began + REPORT_S
    sim.reset()
    while not sim.done:
        sim.step()
        if should_stop():
            sim.abort()
        if rows.filled - reported >= chunk_ticks(rows.filled) or time.perf_counter() > due:
            for watcher in watchers:
                watcher.advance(reported)
            reported, due = rows.filled, time.perf_counter() + REPORT_S
    wall = time.perf_counter() - began
    for watcher in watchers:
        watcher.advance(reported)
    return wall


def chunk_ticks(filled: int) -> int:
    """Number of new rows after which watchers are called, when `filled` rows exist."""
    return CHUNK_TICKS if filled <= LONG_TICKS else LONG_CHUNK_TICKS
