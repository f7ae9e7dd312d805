"""A run of a scenario over a link: the simulation, its boards and the outer program; returns log and record.

In real time the watchers hear of the run only at its end, unless one shows it as it goes: writing a recording takes
longer than a turn.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from agrobot_mj.control.agopengps import AgOpenGps
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.links.agopengps.board import LOOPBACK, Board
from agrobot_mj.links.agopengps.channels import Channel
from agrobot_mj.links.agopengps.report import health, link_metrics
from agrobot_mj.links.agopengps.session import Options, Session
from agrobot_mj.links.agopengps.traffic import Datagram
from agrobot_mj.links.running import linked_outcome, warm_up
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher, run_with_watchers
from agrobot_mj.simulation.stepping import Simulation


def keys_of(scenario: Scenario) -> AgOpenGps:
    """The keys of the link. Raises `ScenarioError` where the scenario has another guidance."""
    if not isinstance(scenario.guidance, AgOpenGps):
        kind = scenario.guidance.kind
        raise ScenarioError(f'guidance.kind: "{kind}" is not driven over a link; set it to "agopengps"')
    return scenario.guidance


class LinkRun(NamedTuple):
    """A finished run over a link."""

    log: Log
    session: Session


def run_link(
    scenario: Scenario,
    channel: Channel,
    options: Options,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
    record: list[Datagram] | None = None,
    live: bool = False,
    address: tuple[int, int, int, int] = LOOPBACK,
) -> LinkRun:
    """Run a scenario of guidance `agopengps` over a channel; `record` is that which a replay drives from.

    `address` is the boards' own, told to a host that scans.

    Raises `ScenarioError` where the scenario has another guidance, and `NoHostError` where no host answers.
    """
    spec = keys_of(scenario)
    unit = scenario.sensors.imu.enabled or scenario.sensors.gyro.enabled
    board = Board(spec, scenario.tractor.steer_limit, unit, address)
    sessions: list[Session] = []

    def drive(sim: Simulation, tell: Callable[[], None]) -> None:
        quick = tell if live or channel.pace is None else (lambda: None)
        sessions.append(session := Session(sim, board, channel, options, quick))
        session.run(should_stop)
        if not sim.done and session.ended is None:
            sim.abort()

    def finish(log: Log) -> Log:
        (session,) = sessions
        outcome = linked_outcome(log.outcome, session.ended)
        block = link_metrics(session, log, session.traffic.kept if record is None else record)
        for line in health(block):
            options.notify(line)
        return replace(log, outcome=outcome, metrics={**log.metrics, "outcome": outcome, "link": block})

    warm_up(scenario)
    log = run_with_watchers(Simulation(scenario), watchers, drive, finish)
    return LinkRun(log, sessions[0])
