"""Common functions for runs with external programs: compilation before the start, and calls of observers.

Observers usually receive the run at its end, because recording a link cycle in real time takes longer than the cycle. A
live observer receives the rows during the run.
"""

from collections.abc import Callable
from dataclasses import replace
from math import isnan, nan
from typing import Any, Protocol

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import wrap
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher, run_with_watchers
from agrobot_mj.simulation.stepping import Simulation


class NotBegunError(ScenarioError):
    """Exception for a run that does not start, because the external program does not respond in time."""


class LinkSession(Protocol):
    """Interface of a run controlled by an external program."""

    sim: Simulation
    ended: str | None
    """Outcome of the run determined by the link, or None if the simulation determines the outcome."""

    def run(self, should_stop: Callable[[], bool], tell: Callable[[], None]) -> None:
        """Simulate to the end and call `tell` after each tick. Raises `NotBegunError` if the program does not
        respond."""
        ...


def run_session(
    session: LinkSession,
    metrics: Callable[[Log], dict[str, Any]],
    watchers: tuple[Watcher, ...],
    should_stop: Callable[[], bool],
    told: bool,
) -> Log:
    """Run a session and return its log, including the results of the function `metrics`.

    If `told` is true, the observers are called during the run, otherwise after it. Raises `NotBegunError` if the run
    does not start.
    """

    def finish(log: Log) -> Log:
        own = log.outcome in ("completed", "aborted")
        outcome = session.ended if own and session.ended is not None else log.outcome
        return replace(log, outcome=outcome, metrics={**log.metrics, "outcome": outcome, **metrics(log)})

    _warm_up(session.sim)
    return run_with_watchers(
        session.sim, watchers, lambda _, tell: session.run(should_stop, tell if told else lambda: None), finish
    )


def gyro_heading(before: float, rate: float, true: float, dt: float) -> float:
    """Return the heading of an inertial unit [rad]: the integrated yaw rate `rate` [rad/s], starting at the true
    heading.

    `before` is the heading one time step `dt` [s] earlier, or NaN at the start. Without a gyro, `rate` and the heading
    are NaN.
    """
    if isnan(rate):
        return nan
    return true if isnan(before) else wrap(before + rate * dt)


def _warm_up(sim: Simulation) -> None:
    """Simulate one tick of a second simulation, so that compilation does not delay the messages of the run."""
    other = Simulation(sim.scenario)
    other.reset()
    other.step()
