"""Handling of Ctrl-C and SIGTERM. Runs end as `aborted` with complete files; other commands are cancelled."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from agrobot_mj.core.interrupts import handled_by


class Stop:
    """Callable that a run calls in each tick. The run ends when the result is True."""

    def __init__(self) -> None:
        self.requested = self.running = False

    def __call__(self) -> bool:
        """Return whether a signal has requested the end of the run."""
        self.running = True
        return self.requested


@contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Yield a `Stop` that ends the run after the first signal. A second signal, or a signal before the first tick, for
    example during compilation, raises KeyboardInterrupt."""
    stop = Stop()

    def handle(_number: int, _frame: Any) -> None:
        again, stop.requested = stop.requested, True
        if again or not stop.running:
            raise KeyboardInterrupt

    with handled_by(handle):
        yield stop


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGTERM or Ctrl-C within the block.

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
