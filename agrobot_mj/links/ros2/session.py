"""A run that a program drives over /cmd_vel, turn by turn.

A turn is a tick of 50 ms: publish the sensors and the clock, take what is asked for, steer, step. In real time a
request acts in the tick in which it arrives, at the latest 25 ms after the sensors. In lock-step the clock waits for
the program: one request each `every` ticks, so that a run repeats however fast the
computer is; without it the run ends. Before the run starts
the tractor stands, and the clock and the sensors go on in real time until the program is heard.
"""

import time
from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol

from agrobot_mj.control.cmd_vel import CmdVel, VelocityRequest
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.links.pacing import Pace
from agrobot_mj.links.ros2.content import Content, messages, path, site_of
from agrobot_mj.links.ros2.node import LATCHED, VelocityMessage
from agrobot_mj.links.ros2.sample import Heading, TickSample, sample_of
from agrobot_mj.links.running import NotBegunError
from agrobot_mj.simulation.stepping import Simulation

Pacing = Literal["real_time", "lock_step"]
"""The wall clock paces the run, or the program by its requests."""
ANSWER_S = 0.025
"""Part of a turn in which a request still acts in it [s]."""
SETTLE_S = 0.3
"""Silence after which no answer to an old clock is under way in lock-step [s]. Estimate."""
PATH_TURNS = 100
"""Turns after which /path is sent again, for subscribers that came later."""


class NoProgramError(NotBegunError):
    """Nothing was asked for on /cmd_vel in time."""


class Port(Protocol):
    """Where messages go and requests come from: a node, or a double of one."""

    heard: int
    """Number of requests."""
    last: VelocityMessage | None
    """The newest request."""

    def publish(self, topic: str, content: Content) -> None:
        """Send a message."""
        ...

    def spin(self, until: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Take what comes until `until` of `time.perf_counter` [s], or until `enough`."""
        ...


class RosOptions(NamedTuple):
    """How a session runs."""

    pace: Pacing = "real_time"
    every: int = 1
    """Ticks for each request in lock-step."""
    start: Literal["heard", "now"] = "heard"
    """What starts the run's clock."""
    wait_s: float = 60.0
    """Longest wait for the start, and for a request in lock-step [s]."""
    notify: Callable[[str], None] = lambda text: None
    """Told in a line what happens."""


class RosSession:
    """One run over a port; `run` once."""

    def __init__(
        self, sim: Simulation, spec: CmdVel, port: Port, options: RosOptions, tell: Callable[[], None]
    ) -> None:
        """`spec` is the simulation's guidance; `tell` is called after each tick."""
        self.sim, self.spec, self.port, self.options, self.tell = sim, spec, port, options, tell
        self.site, self.path = site_of(sim.scenario), path(sim.scenario)
        self.heading, self.request = Heading(), VelocityRequest()
        self.pace = Pace(TICK_S)
        self.turn, self.started = 0, -1
        self.answered = 0
        """Turn that was answered last: those `every` turns later are waited for."""
        self.latencies: list[float] = []
        """Wall time from the sensors to the first request in a turn [s]."""
        self.ended: str | None = None
        """Outcome that the link gives the run, None where the run's own stands."""

    def run(self, should_stop: Callable[[], bool] = lambda: False) -> None:
        """Drive to the end. Raises `NoProgramError` where nothing is asked for in time."""
        self.sim.reset()
        sample, yaw = self._sensed()
        while not self.sim.done and not should_stop():
            if self.started < 0:
                self._starts()
            self._turn(sample, yaw)
            if self.ended:
                return
            self.turn += 1
            if self.started < 0:
                continue
            self.sim.drive(self.request)
            self.tell()
            self.request = self.request._replace(age=self.request.age + TICK_S)
            if self.port.heard and self.request.age > self.spec.give_up_s:
                self.ended = "host_lost"
                return
            if not self.sim.done:
                sample, yaw = self._sensed()
        if not self.port.heard:
            self.ended = "not_engaged"

    def _sensed(self) -> tuple[TickSample, float]:
        sample = sample_of(self.sim)
        return sample, self.heading.follow(sample)

    def _turn(self, sample: TickSample, yaw: float) -> None:
        """Publish, and take the newest request."""
        port, lock_step = self.port, self.options.pace == "lock_step"
        held = lock_step and self.started >= 0
        before = port.heard
        if held:
            port.spin(0.0)  # what came late belongs to no tick
        else:
            port.spin(self.pace.next)
            self.pace.begin()
        heard, now = port.heard, time.perf_counter()
        if heard > before and not held:
            self.answered = self.turn - 1
        self._publish(sample, yaw)
        if not held:
            port.spin(now + ANSWER_S, lambda: port.heard > heard)
        elif (self.turn - self.answered) % self.options.every == 0:
            port.spin(now + self.options.wait_s, lambda: port.heard > heard)
            if port.heard == heard:
                self.options.notify(f"nothing on /cmd_vel for {self.options.wait_s:g} s; lock-step cannot go on")
                self.ended = "host_lost"
        if port.last is not None and port.heard > heard:
            self.answered = self.turn
            self.latencies.append(port.last.wall - now)
        if port.last is not None and port.heard > before:
            self.request = VelocityRequest(port.last.speed, port.last.yaw_rate, 0.0)

    def _publish(self, sample: TickSample, yaw: float) -> None:
        if self.turn % PATH_TURNS == 0:
            self.port.publish(LATCHED, self.path)
        for topic, content in messages(sample, self.site, yaw, self.turn * TICK_S):
            self.port.publish(topic, content)

    def _starts(self) -> None:
        """Start the run's clock if it is time. Raises `NoProgramError` if it should have been."""
        if self.options.start == "now" or self.port.heard:
            if self.port.heard and self.options.pace == "lock_step":
                self._settle()
            self.started = self.turn
            self.options.notify(f"the run starts, {self.turn * TICK_S:.1f} s after the node")
        elif self.turn * TICK_S > self.options.wait_s:
            wait = f"{self.options.wait_s:g} s"
            raise NoProgramError(f"no message on /cmd_vel within {wait}; see docs/ros2.md")

    def _settle(self) -> None:
        """Wait until no answer to an earlier clock is under way: in lock-step each has its tick."""
        heard = -1
        while heard != self.port.heard:
            heard = self.port.heard
            self.port.spin(time.perf_counter() + SETTLE_S)
