"""Simulation of complete runs, with observers such as recordings."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from agrobot_mj.core.contracts import without_exit
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.interrupts import deferring, deliver
from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.branching import Branch, steps
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.stepping import Simulation

CHUNK_TICKS = 1200
"""Number of new rows between calls of the observers [-]: 60 s of simulated time. Fewer rows slow down recordings."""
REPORT_S = 5.0  # Maximum wall time between calls of the observers [s]


class Watcher(Protocol):
    """Protocol of an observer of a run, for example a recording or a progress bar."""

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Start observing before the first tick. `rows` is filled during the run."""

    def advance(self, first: int) -> None:
        """Process the new rows from `first` up to `rows.filled`."""

    def finish(self, log: Log) -> None:
        """Finish observing after the last tick; `log` contains all metrics."""

    def fail(self, error: BaseException) -> None:
        """Handle an error that has ended the run; called instead of `finish`."""


def run(
    scenario: Scenario,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
    branches: Sequence[Branch] | None = None,
    ticks: Callable[[Simulation], Iterator[None]] | None = None,
) -> Log:
    """Simulate a scenario to its end and return the log, without writing files.

    The same scenario gives bit-identical signals on the same machine. `should_stop` is called after each episode (see
    `Simulation.advance`); the run ends as `aborted` if this function returns True.

    Each of the `branches` switches the noise to other random streams. If `branches` is given, even empty, the process
    stores states of the run, from which other runs can start. `ticks` is a function that replaces the loop over all
    ticks: the function begins the run or restores a state, and yields after each tick or episode.

    Raises `ScenarioError` for an infeasible tractor and for a guidance law that is an external program.
    """
    if command := scenario.guidance.outside:
        kind = scenario.guidance.kind
        raise ScenarioError(f'guidance.kind: "{kind}" needs an external program; use `agrobot-mj {command}`')

    def drive(sim: Simulation, tell: Callable[[], None]) -> None:
        for _ in (ticks or _ticks)(sim) if branches is None else steps(sim, branches):
            deliver()
            if should_stop():
                sim.abort()
            tell()

    with deferring():  # signals take effect between two ticks
        return run_with_watchers(Simulation(scenario), watchers, drive)


def _ticks(sim: Simulation) -> Iterator[None]:
    sim.reset()
    deliver()  # the first call of `advance` compiles kernels
    while not sim.done:
        sim.advance()
        yield


def run_with_watchers(
    sim: Simulation,
    watchers: tuple[Watcher, ...],
    drive: Callable[[Simulation, Callable[[], None]], None],
    finish: Callable[[Log], Log] = lambda log: log,
) -> Log:
    """Call `drive`, which simulates a run, inform the observers during the run, and return the log.

    `drive` must call its second argument after each tick or episode. `finish` may extend the log before the observers
    receive the log.
    """
    for watcher in watchers:
        watcher.start(sim.scenario, sim.loop.plant.scene, sim.rows)
    try:
        reporting, began = _Reporting(sim.rows, watchers), time.perf_counter()
        deliver()
        with without_exit():
            drive(sim, reporting.tell)
        wall = time.perf_counter() - began
        reporting.tell(at_the_end=True)
        log = finish(sim.log(wall))
        for watcher in watchers:
            watcher.finish(log)
    except BaseException as error:
        for watcher in watchers:
            watcher.fail(error)
        raise
    return log


class _Reporting:
    """Dispatcher of new rows to the observers of a run."""

    def __init__(self, rows: Rows, watchers: tuple[Watcher, ...]) -> None:
        self.rows, self.watchers, self.reported, self.due = rows, watchers, 0, time.perf_counter() + REPORT_S

    def tell(self, at_the_end: bool = False) -> None:
        """Call the observers if CHUNK_TICKS rows or REPORT_S seconds have passed since the last call, or at the end."""
        rows = self.rows
        if at_the_end or rows.filled - self.reported >= CHUNK_TICKS or time.perf_counter() > self.due:
            for watcher in self.watchers:
                watcher.advance(self.reported)
            self.reported, self.due = rows.filled, time.perf_counter() + REPORT_S
