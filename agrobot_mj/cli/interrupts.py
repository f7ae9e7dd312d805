"""Ctrl-C and SIGTERM: a run ends as aborted with complete files; other work is cancelled and cleaned up."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from agrobot_mj.core.interrupts import handled_by


@contextmanager
def stop_on_signals() -> Iterator[list[int]]:
    """Append SIGINT and SIGTERM to the given list, so that a run can end with complete files; a second signal kills."""
    received: list[int] = []

    def handle(number: int, _frame: Any) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    with handled_by(handle):
        yield received


@contextmanager
def interruptible() -> Iterator[None]:
    """End the block on SIGTERM as on Ctrl-C, so that started work is cleaned up.

    Extension modules convert a KeyboardInterrupt in their callbacks to other errors, and the interpreter drops one in a
    finaliser: in both cases the block raises KeyboardInterrupt.
    """
    received: list[int] = []

    def interrupt(number: int, _frame: Any) -> NoReturn:
        received.append(number)
        raise KeyboardInterrupt

    try:
        with handled_by(interrupt):
            yield
    except Exception as error:
        if received:
            raise KeyboardInterrupt from error
        raise
    if received:
        raise KeyboardInterrupt
