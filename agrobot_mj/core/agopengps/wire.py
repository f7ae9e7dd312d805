"""Frames of the AgOpenGPS family: conversion of bytes to messages and back.

A frame is `80 81 | source | number | length | data | check`; check is the low byte of the sum from the source to the
last data byte. 16-bit values are little-endian, with one frame per datagram. `decode` never raises: invalid datagrams
become `Rejected`, messages for other modules `Unknown`.

Some senders put a constant into the check byte of hello and scan frames; every value is accepted there.
"""

from typing import NamedTuple

from agrobot_mj.core.agopengps.layouts import CODECS, NUMBERS
from agrobot_mj.core.agopengps.messages import HelloReply, Message

PREAMBLE = b"\x80\x81"
OVERHEAD = 6
"""Number of bytes of a frame in addition to its data [bytes]."""
UNCHECKED = frozenset({200, 201, 202})
"""Numbers of frames with an invalid check byte from some senders: hello, change of the subnet, scan."""


class Rejected(NamedTuple):
    """Datagram that is not a valid frame."""

    reason: str
    """Reason: `preamble`, `length`, `checksum`, `source` or `data`."""


class Unknown(NamedTuple):
    """Valid frame for other modules."""

    source: int
    """Number of the sending module."""
    number: int
    """Number of the message (PGN)."""


def check(body: bytes) -> int:
    """Return the check byte of a frame from its source to its last data byte."""
    return sum(body) & 0xFF


def frame(source: int, number: int, data: bytes) -> bytes:
    """Return the complete frame with `data`, at most 255 bytes."""
    body = bytes((source, number, len(data))) + data
    return PREAMBLE + body + bytes((check(body),))


def encode(message: Message) -> bytes:
    """Return the frame of a message; values outside the range of their field saturate."""
    number = message.module if isinstance(message, HelloReply) else NUMBERS[type(message)]
    codec = CODECS[number]
    return frame(codec.source, number, codec.pack(message))


def decode(datagram: bytes) -> Message | Unknown | Rejected:
    """Return the content of a datagram."""
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
