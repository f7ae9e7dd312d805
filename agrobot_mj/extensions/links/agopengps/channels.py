"""Ways for datagrams to come: from sockets on the wall clock, from sockets as fast as the host answers, from a record.

A link turns once a tick. In a turn it takes what has come since the last (`begin`), sends a position, and takes the
answers (`rest`) before it steers. The board's loop runs at 40 Hz: `rest` lasts 25 ms of the 50 ms of a tick.
"""

import time
from collections.abc import Callable, Iterator
from math import inf
from typing import Protocol

from agrobot_mj.core.agopengps.traffic import Datagram
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.agopengps.udp import Incoming, UdpSockets
from agrobot_mj.extensions.links.pacing import Pace

BOARD_LOOP_S = 0.025
"""Loop of a steer module [s]. As AgOpenGPS boards."""
QUIET_S = 0.010
"""No report to the host this long before a position [s]: some hosts lose the position then."""
ANSWER_S = 0.5
"""Longest wait for an answer of a host that paces the run [s]. Assumed value."""


class Channel(Protocol):
    """A source and destination of datagrams."""

    @property
    def pace(self) -> Pace | None:
        """How well the wall clock was kept; None where there is none."""
        ...

    def begin(self, turn: int) -> Iterator[Incoming]:
        """What has come before this turn; returns when the turn is due."""
        ...

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """What comes in the turn before the board steers; `answered` when the host has taken the position."""
        ...

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> tuple[float, str]:
        """Send to the host, or to `target`; returns wall time [s] and address."""
        ...


class _Sockets:
    """What both channels with sockets share."""

    def __init__(self, sockets: UdpSockets) -> None:
        self.sockets, self.opened = sockets, time.perf_counter()

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> tuple[float, str]:
        self.sockets.send(data, target)
        host, port = target or self.sockets.target
        return time.perf_counter() - self.opened, f"{host}:{port}"

    def _received(self, until: float, quiet_from: float = inf) -> Iterator[Incoming]:
        for incoming in self.sockets.receive(until):
            yield incoming._replace(wall=incoming.wall - self.opened, quiet=incoming.wall > quiet_from)


class RealTime(_Sockets):
    """Sockets on the wall clock: one second of the run takes one second."""

    def __init__(self, sockets: UdpSockets) -> None:
        super().__init__(sockets)
        self.pace = Pace(TICK_S)

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Listen until the turn is due."""
        due = self.pace.next
        yield from self._received(due, due - QUIET_S)
        self.pace.begin()

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """Listen for the length of the board's loop."""
        return self._received(time.perf_counter() + BOARD_LOOP_S)


class Answered(_Sockets):
    """Sockets without a clock: the run goes on as soon as the host has answered a position.

    For hosts that take positions at any rate, such as `host`. While none answers the wall clock paces.
    """

    def __init__(self, sockets: UdpSockets) -> None:
        super().__init__(sockets)
        self.pace, self.alive = None, False

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Take what is there; wait for a host that has not answered yet."""
        wait = 0.0 if self.alive else TICK_S - BOARD_LOOP_S
        return self._received(time.perf_counter() + wait)

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """Listen until the host has answered."""
        if answered():
            return
        for incoming in self._received(time.perf_counter() + (ANSWER_S if self.alive else BOARD_LOOP_S)):
            yield incoming
            if answered():
                break
        self.alive = answered()


class Replayed:
    """The datagrams of a record, as fast as the simulation takes them."""

    pace = None

    def __init__(self, record: list[Datagram]) -> None:
        self.record = record
        self.turns: dict[int, list[Datagram]] = {}
        for datagram in record:
            if datagram.direction == "in":
                self.turns.setdefault(datagram.turn, []).append(datagram)

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Nothing: a turn's datagrams act alike wherever in the turn they come."""
        return iter(())

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """All that came in this turn."""
        return (Incoming(d.wall, d.address, d.data) for d in self.turns.get(turn, ()))

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> tuple[float, str]:
        """Nobody listens."""
        return 0.0, "replay"
