"""UDP sockets of a link to a guidance program.

On the loopback network, a host may send to 127.0.0.1 or to a broadcast address. On Linux, a socket that is bound to one
address receives only datagrams to that address. Therefore the link opens three sockets. For any other explicit address,
the port is opened on all interfaces. Size and number of datagrams per link cycle are limited, so that excess traffic
cannot block the simulation.
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
LOOPBACK = ("127.0.0.1", "127.0.0.255", "127.255.255.255")
LONGEST = 2048  # Maximum length of a datagram [bytes]. Longer datagrams are rejected.
MOST_A_TURN = 500  # Maximum number of datagrams processed per cycle. Further datagrams are processed in the next cycle.


class Incoming(NamedTuple):
    """Datagram received from the network."""

    wall: float  # Arrival time [s]: value of `time.perf_counter`, or time since the opening of the link
    address: str
    data: bytes
    quiet: bool = False  # Whether the board must not report its state, because the next position follows shortly


def address_of(text: str, option: str = "--address") -> IPv4Address:
    """Return an IPv4 address from the command line. Raises `ScenarioError` for an invalid address."""
    try:
        return IPv4Address(text)
    except AddressValueError:
        raise ScenarioError(f"{option}: {text!r} is not an IPv4 address; use 127.0.0.1 for this computer") from None


class UdpSockets:
    """UDP sockets on the port of the boards, which send datagrams to one host."""

    def __init__(self, address: str = "127.0.0.1", board_port: int = BOARD_PORT, host_port: int = HOST_PORT) -> None:
        ip = address_of(address)
        self.target, self.port, self.lost = (address, host_port), board_port, 0
        self.sockets: list[socket.socket] = []
        for own in LOOPBACK if ip.is_loopback else ("0.0.0.0",):
            try:
                self.sockets.append(_bound_socket(own, board_port))
            except OSError as error:
                # only Linux accepts all of 127.0.0.0/8; other systems use only the first address
                if error.errno == errno.EADDRNOTAVAIL and self.sockets:
                    continue
                self.close()
                raise ScenarioError(_why(own, board_port, error)) from None

    @property
    def address(self) -> tuple[int, int, int, int]:
        """IPv4 address of this computer in the network of the host, or the loopback address if there is no route."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way, suppress(OSError):
            way.connect(self.target)  # a UDP connection sends nothing
            a, b, c, d = IPv4Address(way.getsockname()[0]).packed
            return a, b, c, d
        return 127, 0, 0, 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the sockets."""
        for each in self.sockets:
            each.close()

    def send(self, data: bytes, target: tuple[str, int] | None = None) -> None:
        """Send one datagram to the host or to `target`. Network errors increase the counter `lost`."""
        try:
            self.sockets[0].sendto(data, target or self.target)
        except OSError:
            self.lost += 1

    def receive(self, until: float, most: int = MOST_A_TURN) -> Iterator[Incoming]:
        """Yield waiting datagrams, and datagrams that arrive until the `time.perf_counter` value `until` [s]."""
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


def _bound_socket(address: str, port: int) -> socket.socket:
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
        return f"{address}:{port} is in use by another link or module; stop it, or choose another port with --port"
    if error.errno == errno.EACCES:
        return f"{address}:{port} cannot be opened without privileges; choose a port above 1023 with --port"
    return f"{address}:{port} cannot be opened: {error.strerror}"
