"""Frames of the AgOpenGPS family: conversion of bytes to messages and back.

A frame is `80 81 | source | number | length | data | check`. The check byte is the low byte of the sum from the source
to the last data byte. 16-bit values are little-endian, and each datagram contains one frame. `decode` raises no errors:
it returns `Rejected` for an invalid datagram and `Unknown` for an unsupported message.

The check byte of hello and scan frames is ignored, because some senders use a constant value.
"""

from typing import NamedTuple

from agrobot_mj.core.agopengps.layouts import CODECS, NUMBERS
from agrobot_mj.core.agopengps.messages import HelloReply, Message

PREAMBLE = b"\x80\x81"
OVERHEAD = 6  # Length of a frame without its data [bytes]
UNCHECKED = frozenset({200, 201, 202})
"""Numbers of the messages whose check byte is ignored: hello (200), subnet change (201) and scan (202)."""


class Rejected(NamedTuple):
    """Datagram that is not a valid frame."""

    reason: str  # Reason for the rejection: `preamble`, `length`, `checksum`, `source` or `data`


class Unknown(NamedTuple):
    """Valid frame with a message number that the package does not support."""

    source: int
    number: int


def check(body: bytes) -> int:
    """Return the check byte of a frame for `body`, the bytes of the frame from the source to the last data byte."""
    return sum(body) & 0xFF


def frame(source: int, number: int, data: bytes) -> bytes:
    """Return the bytes of the frame of a message with at most 255 bytes of `data`."""
    body = bytes((source, number, len(data))) + data
    return PREAMBLE + body + bytes((check(body),))


def encode(message: Message) -> bytes:
    """Return the frame of a message. Speeds, angles and cross-track errors outside the range of their field
    saturate."""
    number = message.module if isinstance(message, HelloReply) else NUMBERS[type(message)]
    codec = CODECS[number]
    return frame(codec.source, number, codec.pack(message))


def decode(datagram: bytes) -> Message | Unknown | Rejected:
    """Return the message in a datagram, `Unknown` for an unsupported message number, or `Rejected` for an invalid
    frame."""
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
