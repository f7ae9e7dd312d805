"""Common parts of runs with external programs: compilation before the start, observers, outcome.

Observers usually receive the run at its end, because recording a turn in real time takes longer than the turn. A live
observer receives the run while it lasts.
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
    """Exception for an external program that does not start in time, so that the run does not begin."""


class LinkSession(Protocol):
    """Run controlled by an external program."""

    sim: Simulation
    ended: str | None
    """Outcome set by the link, or None if the outcome is determined by the simulation."""

    def run(self, should_stop: Callable[[], bool], tell: Callable[[], None]) -> None:
        """Simulate to the end and call `tell` after each tick. Raises `NotBegunError` if the program does not start."""
        ...


def run_session(
    session: LinkSession,
    metrics: Callable[[Log], dict[str, Any]],
    watchers: tuple[Watcher, ...],
    should_stop: Callable[[], bool],
    told: bool,
) -> Log:
    """Run a session and return its log with the `metrics` of the link. Raises `NotBegunError` if it does not begin. If
    `told`, the observers are called during the run, otherwise at its end."""

    def finish(log: Log) -> Log:
        own = log.outcome in ("completed", "aborted")
        outcome = session.ended if own and session.ended is not None else log.outcome
        return replace(log, outcome=outcome, metrics={**log.metrics, "outcome": outcome, **metrics(log)})

    _warm_up(session.sim)
    return run_with_watchers(
        session.sim, watchers, lambda _, tell: session.run(should_stop, tell if told else lambda: None), finish
    )


def gyro_heading(before: float, rate: float, true: float, dt: float) -> float:
    """Return the heading of an inertial unit: the gyro integrated over `dt` [s] from the true initial heading [rad].
    `before` is the previous heading, NaN at the start. Without a gyro, `rate` [rad/s] and the heading are NaN."""
    if isnan(rate):
        return nan
    return true if isnan(before) else wrap(before + rate * dt)


def _warm_up(sim: Simulation) -> None:
    """Simulate one tick of a copy of the simulation, so that compilation does not delay the exchange of messages."""
    other = Simulation(sim.scenario)
    other.reset()
    other.step()
