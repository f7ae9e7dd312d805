"""Frames of the AgOpenGPS family: bytes to messages and back, pure.

A frame is `80 81 | source | number | length | data | check`, where check is the low byte of the sum from the source to
the last data byte; 16-bit values are little-endian; one frame a datagram. `decode` never raises: what cannot be read
comes back as `Rejected`, what is not for us as `Unknown`.

Some senders put a constant into the check byte of hello and scan frames; there any value is accepted.
"""

from typing import NamedTuple

from agrobot_mj.core.agopengps.layouts import CODECS, NUMBERS
from agrobot_mj.core.agopengps.messages import HelloReply, Message

PREAMBLE = b"\x80\x81"
OVERHEAD = 6
"""Bytes of a frame beside its data [bytes]."""
UNCHECKED = frozenset({200, 201, 202})
"""Numbers of frames whose check byte some senders leave wrong: hello, change of the subnet, scan."""


class Rejected(NamedTuple):
    """A datagram that is no valid frame."""

    reason: str
    """`preamble`, `length`, `checksum`, `source` or `data`."""


class Unknown(NamedTuple):
    """A valid frame that the boards of a tractor have no use for."""

    source: int
    """Number of the sender's module."""
    number: int
    """Number of the message (PGN)."""


def check(body: bytes) -> int:
    """Check byte of a frame from its source to its last data byte."""
    return sum(body) & 0xFF


def frame(source: int, number: int, data: bytes) -> bytes:
    """A whole frame around `data`, at most 255 bytes."""
    body = bytes((source, number, len(data))) + data
    return PREAMBLE + body + bytes((check(body),))


def encode(message: Message) -> bytes:
    """The frame of a message; values beyond the range of their field saturate."""
    number = message.module if isinstance(message, HelloReply) else NUMBERS[type(message)]
    codec = CODECS[number]
    return frame(codec.source, number, codec.pack(message))


def decode(datagram: bytes) -> Message | Unknown | Rejected:
    """What a datagram says."""
    if datagram[:2] != PREAMBLE:
        return Rejected("preamble")
    if len(datagram) < OVERHEAD or len(datagram) != OVERHEAD + datagram[4]:
        return Rejected("length")
    source, number, data = datagram[2], datagram[3], datagram[5:-1]
    if number not in UNCHECKED and datagram[-1] != check(datagram[2:-1]):
        return Rejected("checksum")
    codec = CODECS.get(number)
    if codec is None:
        return Unknown(source, number)
    if source != codec.source:
        return Rejected("source")
    return codec.unpack(data) if len(data) >= codec.least else Rejected("data")
