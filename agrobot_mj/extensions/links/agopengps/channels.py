"""Datagram channels: sockets in real time, sockets paced by replies of the host, or a recorded session.

A link works in cycles of one tick (50 ms); `turn` is the number of a cycle. A cycle processes the datagrams received
since the previous cycle (`begin`) and sends a position. It then processes the replies (`rest`) before the board steers.
A board runs its control loop at 40 Hz. Therefore `rest` lasts 25 ms of the 50 ms.
"""

import time
from collections.abc import Callable, Iterator
from math import inf

from agrobot_mj.core.agopengps.traffic import Datagram
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.agopengps.udp import Incoming, UdpSockets
from agrobot_mj.extensions.links.pacing import Pace

BOARD_LOOP_S = 0.025  # Period of the control loop of a steer module [s], as in AgOpenGPS boards
QUIET_S = 0.010  # Time before each position in which no report is sent [s], because some hosts would lose the position
ANSWER_S = 0.5  # Time limit for the reply of a host that determines the pace of the run [s]. Assumed value.


class _Sockets:
    """Base class of channels over sockets. `pace` contains timing statistics, or None for a channel without a clock."""

    def __init__(self, sockets: UdpSockets) -> None:
        self.sockets, self.opened = sockets, time.perf_counter()

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> tuple[float, str]:
        """Send a datagram to the host or to `target`. Return the wall-clock time [s] and the address."""
        self.sockets.send(data, target)
        host, port = target or self.sockets.target
        return time.perf_counter() - self.opened, f"{host}:{port}"

    def _receive(self, until: float, quiet_from: float = inf) -> Iterator[Incoming]:
        for incoming in self.sockets.receive(until):
            yield incoming._replace(wall=incoming.wall - self.opened, quiet=incoming.wall > quiet_from)


class RealTime(_Sockets):
    """Channel over sockets in real time. One simulated second takes `slower` wall-clock seconds."""

    def __init__(self, sockets: UdpSockets, slower: float = 1.0) -> None:
        super().__init__(sockets)
        self.pace, self.loop = Pace(slower * TICK_S), slower * BOARD_LOOP_S

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Return the datagrams received until the cycle is due, and begin the cycle."""
        due = self.pace.next
        yield from self._receive(due, due - QUIET_S)
        self.pace.begin()

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """Return the datagrams received during one period of the board's control loop."""
        return self._receive(time.perf_counter() + self.loop)


class Answered(_Sockets):
    """Channel over sockets, paced by the host. The run continues as soon as the host has replied to a position.

    This pace is suitable for hosts that accept positions at any rate. Without replies, the run is in real time.
    """

    def __init__(self, sockets: UdpSockets) -> None:
        super().__init__(sockets)
        self.pace, self.alive = None, False

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Return the datagrams received since the previous cycle. If the host did not reply in that cycle, wait first
        for the rest of the tick."""
        wait = 0.0 if self.alive else TICK_S - BOARD_LOOP_S
        return self._receive(time.perf_counter() + wait)

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """Return the datagrams received until `answered()` is true (the host has replied), or until a time limit."""
        if answered():
            return
        for incoming in self._receive(time.perf_counter() + (ANSWER_S if self.alive else BOARD_LOOP_S)):
            yield incoming
            if answered():
                break
        self.alive = answered()


class Replayed:
    """Channel that replays a recorded session at the speed of the simulation."""

    pace = None

    def __init__(self, record: list[Datagram]) -> None:
        self.record = record
        self.turns: dict[int, list[Datagram]] = {}
        for datagram in record:
            if datagram.direction == "in":
                self.turns.setdefault(datagram.turn, []).append(datagram)

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Return no datagrams, because `rest` returns all datagrams of a cycle."""
        return iter(())

    def rest(self, turn: int, answered: Callable[[], bool]) -> Iterator[Incoming]:
        """Return all datagrams recorded in this cycle."""
        return (Incoming(d.wall, d.address, d.data) for d in self.turns.get(turn, ()))

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> tuple[float, str]:
        """Discard the datagram, because no host is connected."""
        return 0.0, "replay"


Channel = RealTime | Answered | Replayed
