"""Run controlled by a program that publishes on /cmd_vel.

The link works in cycles of one tick (50 ms): publish the sensors and the clock, receive a command, steer, step. In real
time, a command that arrives within 25 ms after the sensor messages acts in the same tick, a later command in the next
tick. In lock-step, the clock waits for one command every `every` ticks, so that a run is repeatable on any computer.
The run ends if commands stop. Until the first command, clock and sensors are published in real time and the tractor is
at rest.
"""

import time
from collections.abc import Callable
from contextlib import ExitStack
from math import nan
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from agrobot_mj.control.base import GuidanceLaw
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.cmd_vel import CmdVel, VelocityRequest
from agrobot_mj.extensions.links.pacing import Pace
from agrobot_mj.extensions.links.ros2.content import (
    AGAIN_TICKS,
    TickSample,
    messages,
    path,
    sample_of,
    site_of,
)
from agrobot_mj.extensions.links.ros2.node import LATCHED, RosNode, full_topic
from agrobot_mj.extensions.links.ros2.profile import loopback_only
from agrobot_mj.extensions.links.running import NotBegunError, gyro_heading, run_session
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import write_log

ANSWER_S = 0.025  # Time from the start of a cycle within which an arriving command is effective in this cycle [s]
SETTLE_S = 0.3
"""Time without commands after which replies to earlier clock messages are no longer expected [s]. Assumed value."""
ASK_TURNS = 60
"""Number of cycles without a command before the publishers of /cmd_vel are checked. Discovery of nodes takes 1-2 s."""


SENSORS = {"sensors.imu.enabled": True, "sensors.gyro.enabled": True}
"""Sensor settings of the command `ros2`, which override the scenario but not the option `--set`."""


class NoProgramError(NotBegunError):
    """Exception for an external program that does not send a command on /cmd_vel within the waiting time."""


class RosOptions(NamedTuple):
    """Options of a run as a ROS node, in addition to the scenario."""

    pace: Literal["real_time", "lock_step"] = "real_time"
    """Time base of the run: the wall clock (`real_time`), or the commands of the program (`lock_step`)."""
    every: int = 1  # Number of ticks per command in lock-step
    start: Literal["heard", "now"] = "heard"
    """Event that starts the clock of the run: the first command, or the opening of the link."""
    wait_s: float = 60.0  # Maximum time to wait for the start event and, in lock-step, for each command [s]
    network: bool = False  # Whether other computers can reach the topics
    domain: int | None = None  # ROS domain ID. Default: the environment.
    stamped: bool = False
    namespace: str = ""
    live: bool = False  # Whether observers receive rows during the run, and not only at its end
    recorded: bool = True
    notify: Callable[[str], None] = lambda text: None


class RosSession:
    """Run controlled by velocity commands over a port. The method `run` may only be called once."""

    def __init__(self, sim: Simulation, port: RosNode, options: RosOptions) -> None:
        spec: GuidanceLaw = sim.scenario.guidance
        if not isinstance(spec, CmdVel):
            raise ScenarioError(f'guidance.kind: "{spec.kind}" is not controlled by /cmd_vel; set it to "cmd_vel"')
        self.sim, self.spec, self.port, self.options = sim, spec, port, options
        self.place = full_topic(options.namespace, "/cmd_vel")
        self.site, self.path = site_of(sim.scenario), path(sim.scenario)
        self.yaw, self.request = nan, VelocityRequest()
        """Heading of the simulated inertial unit [rad], and velocity command in effect."""
        self.pace = Pace(TICK_S)
        self.turn, self.started = 0, -1
        self.refused = 0
        """Number of commands ignored up to the previous cycle."""
        self.answered = 0
        """Number of the last cycle with a command. In lock-step, the next command is due `every` cycles later."""
        self.latencies: list[float] = []
        """Wall-clock times from the publication of the sensor messages to the first command of a cycle [s]."""
        self.ended: str | None = None
        """Outcome of the run determined by the link, or None if the simulation determines the outcome."""

    def run(self, should_stop: Callable[[], bool], tell: Callable[[], None]) -> None:
        """Simulate to the end, with a call of `tell` after each tick.

        Raises `NoProgramError` if no command arrives in time.
        """
        self.sim.reset()
        sample = self._sensed()
        while not self.sim.done and not should_stop():
            if self.started < 0:
                self._starts()
            self._turn(sample)
            if self.port.refused and not self.refused:
                self.options.notify("non-finite velocities on /cmd_vel are ignored; see `refused` in metrics.json")
            self.refused = self.port.refused
            if self.ended:
                return
            self.turn += 1
            if self.started < 0:
                continue
            self.sim.drive(self.request)
            tell()
            self.request = self.request._replace(age=self.request.age + TICK_S)
            if self.port.heard and self.request.age > self.spec.give_up_s:
                self.ended = "host_lost"
                return
            if not self.sim.done:
                sample = self._sensed()
        if not self.port.heard:
            self.ended = "not_engaged"

    def _sensed(self) -> TickSample:
        sample = sample_of(self.sim)
        self.yaw = gyro_heading(self.yaw, sample.gyro, sample.yaw, TICK_S)
        return sample

    def _turn(self, sample: TickSample) -> None:
        port, lock_step = self.port, self.options.pace == "lock_step"
        held = lock_step and self.started >= 0
        before = port.heard
        if held:
            port.spin(0.0)  # late commands belong to no tick
        else:
            port.spin(self.pace.next)
            self.pace.begin()
        heard, now = port.heard, time.perf_counter()
        if heard > before and not held:
            self.answered = self.turn - 1
        if self.turn % AGAIN_TICKS == 0:
            port.publish(LATCHED, self.path)
        for topic, content in messages(sample, self.site, self.yaw, self.turn * TICK_S):
            port.publish(topic, content)
        if not held:
            port.spin(now + ANSWER_S, lambda: port.heard > heard)
        elif (self.turn - self.answered) % self.options.every == 0:
            port.spin(now + self.options.wait_s, lambda: port.heard > heard)
            if port.heard == heard:
                wait, every = self.options.wait_s, self.options.every
                text = f"no message on /cmd_vel for {wait:g} s; lock-step needs a message every {every * TICK_S:g} s"
                self.options.notify(f"{text}; if the program is slower, set --every above {every}")
                self.ended = "host_lost"
        if port.last is not None and port.heard > heard:
            self.answered = self.turn
            self.latencies.append(port.last.wall - now)
        if port.last is not None and port.heard > before:
            self.request = VelocityRequest(port.last.speed, port.last.yaw_rate, 0.0)

    def _starts(self) -> None:
        if self.options.start == "now" or self.port.heard:
            if self.port.heard and self.options.pace == "lock_step":
                self._settle()
            self.started = self.turn
            self.options.notify(f"the run starts, {self.turn * TICK_S:.1f} s after the node")
        elif self.turn * TICK_S > self.options.wait_s:
            problem = self.port.problem() or "see docs/extensions/links/ros2.md"
            raise NoProgramError(f"no message on {self.place} within {self.options.wait_s:g} s: {problem}")
        elif self.turn == ASK_TURNS and (problem := self.port.problem()):
            self.options.notify(f"no message on {self.place} yet: {problem}")

    def _settle(self) -> None:
        """Wait for all replies to earlier clock messages, so that later replies belong to a known tick."""
        heard = -1
        while heard != self.port.heard:
            heard = self.port.heard
            self.port.spin(time.perf_counter() + SETTLE_S)

    def metrics(self) -> dict[str, Any]:
        """Return the metrics of the link: received and ignored commands, latencies [s] and late cycles."""
        waits, real_time = np.array(self.latencies), self.options.pace == "real_time"
        return {
            "pace": self.options.pace,
            "requests": self.port.heard,
            "refused": self.port.refused,
            "latency_median_s": float(np.median(waits)) if len(waits) else None,
            "latency_p95_s": float(np.quantile(waits, 0.95)) if len(waits) else None,
            "late_turns": self.pace.late if real_time else 0,
            "worst_delay_s": self.pace.worst if real_time else 0.0,
            "waited_s": max(self.started, 0) * TICK_S,
        }


def ros2(
    scenario: Scenario,
    folder: Path,
    options: RosOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario with the guidance `cmd_vel` as a ROS node, and write the results to `folder`."""
    with ExitStack() as stack:
        if not options.network:
            stack.enter_context(loopback_only())
        reach = "the network" if options.network else "this computer only"
        node = stack.enter_context(RosNode(options.stamped, options.domain, options.namespace))
        name, asked = (full_topic(options.namespace, each) for each in ("tractor", "cmd_vel"))
        options.notify(f"node {name}, on {reach}, waits for {asked}")
        log = run_over(scenario, node, options, watchers, should_stop)
    write_log(log, folder, recorded=options.recorded)
    return log


def run_over(
    scenario: Scenario,
    port: RosNode,
    options: RosOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario with commands from a port. Return its log with the metrics block `ros2`. Raises `ScenarioError` or
    `NoProgramError`."""
    session = RosSession(Simulation(scenario), port, options)
    told = options.live or options.pace == "lock_step"
    return run_session(session, lambda log: {"ros2": session.metrics()}, watchers, should_stop, told)
