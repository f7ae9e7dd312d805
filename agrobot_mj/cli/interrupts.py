"""Handling of Ctrl-C and SIGTERM. Runs end as `aborted` with complete files; other work is cancelled and cleaned up."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from agrobot_mj.core.interrupts import handled_by


@contextmanager
def stop_on_signals() -> Iterator[list[int]]:
    """Yield a list that receives the first signal, which ends a run early. A second signal raises KeyboardInterrupt."""
    received: list[int] = []

    def handle(number: int, _frame: Any) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    with handled_by(handle):
        yield received


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt in the block on SIGTERM, as on Ctrl-C.

    KeyboardInterrupt is raised even if an extension module converts the exception in a callback, or if the interpreter
    drops the exception in a finaliser.
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
