"""What `agrobot-mj ros2` does: open the node, run, write the run's files."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.control.cmd_vel import CmdVel
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.links.ros2.node import RosNode
from agrobot_mj.links.ros2.profile import loopback_only
from agrobot_mj.links.ros2.session import Port, RosOptions, RosSession
from agrobot_mj.links.running import linked_outcome, warm_up
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher, run_with_watchers
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import write_log

SENSORS = {"sensors.imu.enabled": True, "sensors.gyro.enabled": True}
"""Sensors that a tractor on ROS has unless its scenario is told otherwise."""


class RosArguments(NamedTuple):
    """What the command line says beside the scenario."""

    options: RosOptions
    network: bool = False
    """Other computers may see the topics."""
    domain: int | None = None
    """ROS domain; that of the environment where it is left out."""
    stamped: bool = False
    """/cmd_vel is a TwistStamped."""
    live: bool = False
    """Watchers are told as the run goes."""


def ros2(
    scenario: Scenario,
    folder: Path,
    arguments: RosArguments,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario of guidance `cmd_vel` as a node; writes into `folder`.

    Raises `ScenarioError` without rclpy or with another guidance, `NoProgramError` where nothing is asked for.
    """
    with ExitStack() as stack:
        if not arguments.network:
            stack.enter_context(loopback_only())
        node = stack.enter_context(RosNode(arguments.stamped, arguments.domain))
        reach = "the network" if arguments.network else "this computer only"
        arguments.options.notify(f"node /tractor, on {reach}; waits for /cmd_vel")
        log = run_session(scenario, node, arguments.options, watchers, should_stop, arguments.live)
    write_log(log, folder)
    return log


def run_session(
    scenario: Scenario,
    port: Port,
    options: RosOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
    live: bool = False,
) -> Log:
    """Run a scenario over a port; its log has a metrics block `ros2`."""
    spec = scenario.guidance
    if not isinstance(spec, CmdVel):
        raise ScenarioError(f'guidance.kind: "{spec.kind}" is not driven over /cmd_vel; set it to "cmd_vel"')
    sessions: list[RosSession] = []
    quick = live or options.pace == "lock_step"

    def drive(sim: Simulation, tell: Callable[[], None]) -> None:
        # In real time the watchers hear of the run at its end: writing a recording takes longer than a turn.
        sessions.append(session := RosSession(sim, spec, port, options, tell if quick else lambda: None))
        session.run(should_stop)
        if not sim.done and session.ended is None:
            sim.abort()

    def finish(log: Log) -> Log:
        (session,) = sessions
        outcome = linked_outcome(log.outcome, session.ended)
        return replace(log, outcome=outcome, metrics={**log.metrics, "outcome": outcome, "ros2": report(session)})

    warm_up(scenario)
    return run_with_watchers(Simulation(scenario), watchers, drive, finish)


def report(session: RosSession) -> dict[str, Any]:
    """How the link went: requests, latency [s], late turns."""
    waits = np.array(session.latencies)
    real_time = session.options.pace == "real_time"
    return {
        "pace": session.options.pace,
        "requests": session.port.heard,
        "latency_median_s": float(np.median(waits)) if len(waits) else None,
        "latency_p95_s": float(np.quantile(waits, 0.95)) if len(waits) else None,
        "late_turns": session.pace.late if real_time else 0,
        "worst_delay_s": session.pace.worst if real_time else 0.0,
        "waited_s": max(session.started, 0) * TICK_S,
    }
