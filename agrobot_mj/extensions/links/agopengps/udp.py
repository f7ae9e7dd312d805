"""Sockets of a link, and the wall clock that paces it.

On loopback a host may send to 127.0.0.1 or to a broadcast address of that network, and on Linux a socket bound to one
of them hears only that one: three sockets then. Any other address must be asked for and opens the port on all
interfaces. What comes in is bounded in size and in number per turn, so that a flood cannot stop the simulation.
"""

import errno
import select
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from ipaddress import AddressValueError, IPv4Address
from typing import NamedTuple, Self

from agrobot_mj.core.errors import ScenarioError

BOARD_PORT, HOST_PORT = 8888, 9999
"""Ports on which boards and hosts of the AgOpenGPS family listen."""
LOOPBACK = ("127.0.0.1", "127.0.0.255", "127.255.255.255")
LONGEST = 2048
"""Bytes read of a datagram; longer ones are cut and rejected [bytes]."""
MOST_A_TURN = 500
"""Datagrams taken in one turn of the link's loop; what is left waits for the next."""


class Incoming(NamedTuple):
    """A datagram from the network."""

    wall: float
    """Wall time of its arrival [s]: `time.perf_counter`, or since the link opened."""
    address: str
    """`host:port` of its sender."""
    data: bytes
    quiet: bool = False
    """Whether it came too close before the next position for an answer."""


def address_of(text: str, option: str = "--address") -> IPv4Address:
    """An IPv4 address from a command line. Raises `ScenarioError`."""
    try:
        return IPv4Address(text)
    except AddressValueError:
        raise ScenarioError(f"{option}: {text!r} is no IPv4 address; 127.0.0.1 is this computer") from None


class UdpSockets:
    """One port for the boards; sends to one host."""

    def __init__(self, address: str = "127.0.0.1", board_port: int = BOARD_PORT, host_port: int = HOST_PORT) -> None:
        """Open the sockets. Raises `ScenarioError` where the port is taken."""
        ip = address_of(address)
        self.target, self.port, self.lost = (address, host_port), board_port, 0
        self.sockets: list[socket.socket] = []
        for own in LOOPBACK if ip.is_loopback else ("0.0.0.0",):
            try:
                self.sockets.append(_bound(own, board_port))
            except OSError as error:
                # only Linux answers for the whole network 127.0.0.0/8; elsewhere the first address must do
                if error.errno == errno.EADDRNOTAVAIL and self.sockets:
                    continue
                self.close()
                raise ScenarioError(_why(own, board_port, error)) from None

    @property
    def address(self) -> tuple[int, int, int, int]:
        """Address under which the host sees this computer: that of the way to it; loopback where there is no way."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way, suppress(OSError):
            way.connect(self.target)  # of UDP: nothing is sent
            a, b, c, d = IPv4Address(way.getsockname()[0]).packed
            return a, b, c, d
        return 127, 0, 0, 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back."""
        for each in self.sockets:
            each.close()

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> None:
        """Send one datagram to the host, or to `target`; a network that is down counts, no more."""
        try:
            self.sockets[0].sendto(data, target or self.target)
        except OSError:
            self.lost += 1

    def receive(self, until: float, most: int = MOST_A_TURN) -> Iterator[Incoming]:
        """What arrives before `until` of `time.perf_counter` [s]; what is there already also after it."""
        taken = 0
        while True:
            ready, _, _ = select.select(self.sockets, [], [], max(0.0, until - time.perf_counter()))
            if not ready:
                return
            for each in ready:
                with suppress(OSError):
                    data, (host, port) = each.recvfrom(LONGEST)
                    yield Incoming(time.perf_counter(), f"{host}:{port}", data)
                taken += 1
            if taken >= most:
                time.sleep(max(0.0, until - time.perf_counter()))
                return


def _bound(address: str, port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        opened.bind((address, port))
        opened.setblocking(False)
    except BaseException:
        opened.close()
        raise
    return opened


def _why(address: str, port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"{address}:{port} is in use: another link or a real module runs; stop it, or choose another with --port"
    if error.errno == errno.EACCES:
        return f"{address}:{port} may not be opened by this user; choose a port above 1023 with --port"
    return f"{address}:{port} cannot be opened: {error.strerror}"
