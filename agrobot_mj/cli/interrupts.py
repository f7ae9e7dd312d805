"""Ctrl-C and SIGTERM: a run ends cleanly as aborted, other work is broken off and cleared away."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from agrobot_mj.core.interrupts import handled_by


@contextmanager
def stop_on_signals() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM in the list given, so that a run can end cleanly; a second one kills."""
    received: list[int] = []

    def handle(number: int, _frame: Any) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    with handled_by(handle):
        yield received


@contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM ends the block as Ctrl-C does, so that what it has started is cleared away.

    Extension modules turn a KeyboardInterrupt in their callbacks into other errors, and the interpreter swallows one in
    a finaliser: after any of them the block raises KeyboardInterrupt.
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
