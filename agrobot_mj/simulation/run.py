"""A whole run of a scenario, followed by watchers."""

import time
from collections.abc import Callable
from typing import Protocol

from agrobot_mj.core.errors import ScenarioError
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

    The same scenario gives bit-identical signals on the same machine. `should_stop` is called every tick; once it
    returns True the run ends as `aborted`. Raises `ScenarioError` if the parameters describe no possible tractor, and
    for a guidance law that lives outside.
    """
    if command := scenario.guidance.outside:
        kind = scenario.guidance.kind
        raise ScenarioError(f'guidance.kind: "{kind}" is driven by another program; use `agrobot-mj {command}`')

    def drive(sim: Simulation, tell: Callable[[], None]) -> None:
        sim.reset()
        while not sim.done:
            sim.step()
            if should_stop():
                sim.abort()
            tell()

    return followed(Simulation(scenario), watchers, drive)


def followed(
    sim: Simulation,
    watchers: tuple[Watcher, ...],
    drive: Callable[[Simulation, Callable[[], None]], None],
    finish: Callable[[Log], Log] = lambda log: log,
) -> Log:
    """The log of a simulation that `drive` takes to its end, followed by watchers.

    `drive` calls what it is given after each tick; `finish` may add to the log before the watchers see it.
    """
    for watcher in watchers:
        watcher.start(sim.scenario, sim.loop.plant.scene, sim.rows)
    try:
        audience, began = _Audience(sim.rows, watchers), time.perf_counter()
        drive(sim, audience.tell)
        wall = time.perf_counter() - began
        audience.tell(at_the_end=True)
        log = finish(sim.log(wall))
        for watcher in watchers:
            watcher.finish(log)
    except BaseException as error:
        for watcher in watchers:
            watcher.fail(error)
        raise
    return log


class _Audience:
    """Tells watchers of new rows piece by piece."""

    def __init__(self, rows: Rows, watchers: tuple[Watcher, ...]) -> None:
        self.rows, self.watchers, self.told, self.due = rows, watchers, 0, time.perf_counter() + TELL_S

    def tell(self, at_the_end: bool = False) -> None:
        """After each tick, and once at the end."""
        rows = self.rows
        if at_the_end or rows.filled - self.told >= chunk_ticks(rows.filled) or time.perf_counter() > self.due:
            for watcher in self.watchers:
                watcher.advance(self.told)
            self.told, self.due = rows.filled, time.perf_counter() + TELL_S


def chunk_ticks(filled: int) -> int:
    """New rows after which watchers are told, when `filled` rows are there."""
    return CHUNK_TICKS if filled <= LONG_TICKS else LONG_CHUNK_TICKS
