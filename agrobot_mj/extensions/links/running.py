"""How a run over a link goes, whatever the link: nothing compiled late, one word for the outcome.

In real time the watchers hear of the run only at its end, unless one shows it as it goes: writing a recording takes
longer than a turn.
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
    """The program outside has not started in time, so that there was no run."""


class LinkSession(Protocol):
    """A simulation that a program outside drives."""

    sim: Simulation
    ended: str | None
    """Outcome that the link gives the run; None keeps the run's own."""

    def run(self, should_stop: Callable[[], bool], tell: Callable[[], None]) -> None:
        """Drive to the end; `tell` is called after each tick. Raises `NotBegunError`."""
        ...


def run_session(
    session: LinkSession,
    metrics: Callable[[Log], dict[str, Any]],
    watchers: tuple[Watcher, ...],
    should_stop: Callable[[], bool],
    told: bool,
) -> Log:
    """The log of a session, with the `metrics` of its link; the watchers are `told` of it as it goes, or at its end.

    Raises `NotBegunError`.
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
    """Heading of an inertial unit [rad]: its gyro, integrated over `dt` [s] from the true heading at the start.

    `before` is NaN at the start, `rate` [rad/s] without a gyro, and so is the heading then.
    """
    if isnan(rate):
        return nan
    return true if isnan(before) else wrap(before + rate * dt)


def _warm_up(sim: Simulation) -> None:
    """One tick of a simulation of its own: what is compiled on first use must not make the first turns late."""
    other = Simulation(sim.scenario)
    other.reset()
    other.step()
