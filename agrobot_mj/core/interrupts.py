"""Delay of signals during atomic work, and temporary handlers for SIGINT and SIGTERM.

Python runs signal handlers between two instructions of the main thread. A handler that raises an exception, such as
KeyboardInterrupt, aborts the work at this point. `held_back` delays handlers until the end of a block. `deferring` runs
handlers only when the block calls `deliver`. Signals without a handler keep their default action. Other threads run no
handlers.
"""

import _signal  # type: ignore[import-not-found]  # `signal.signal` without enums: 0.3 us in place of 5 us
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

NUMBERS = (signal.SIGINT, signal.SIGTERM)  # Signals that request the end of the process
HELD = tuple(
    int(getattr(signal, name))
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGBREAK")
    if hasattr(signal, name)
)
"""Signals whose handlers are delayed, because their handlers commonly raise exceptions."""
PATIENCE_S = 5.0
"""Time after which a signal interrupts a hanging block of code [s]. Blocks from `until_the_end` are never
interrupted."""


@contextmanager
def handled_by(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle SIGINT and SIGTERM with `handler` within the block."""
    before: dict[int, Any] = {}
    try:
        for asks in NUMBERS:
            before[asks] = signal.getsignal(asks)
            signal.signal(asks, handler)
        yield
    finally:
        for number, old in before.items():
            if old is not None:  # a handler installed outside Python cannot be restored
                signal.signal(number, old)


MOST_HELD = 2  # Maximum number of delayed signals per signal number: a second signal may request more than the first


class _State:
    """Data shared by all open blocks of the main thread that delay signals."""

    def __init__(self) -> None:
        self.blocks = self.indivisible = self.patient = 0
        self.aside: dict[int, Any] = {}
        """Original handlers by signal number, kept permanently because other code may reinstall `_keep` later."""
        self.replaced: list[int] = []
        """Signals whose current handler is `_keep`."""
        self.received: list[int] = []
        self.since = 0.0
        """Time at which the outermost block started, or time of the last call of `deliver` [s]."""
        self.raised: BaseException | None = None
        """Last exception raised by a handler in `deliver`."""


_STATE = _State()


class Block:
    """Context manager that delays signal handlers, created by `held_back`, `until_the_end` and `deferring`."""

    __slots__ = ("counted", "indivisible", "patient")

    def __init__(self, indivisible: bool, patient: bool = False) -> None:
        self.indivisible, self.patient = indivisible, patient

    def __enter__(self) -> None:
        self.counted = _in_main_thread()
        if not self.counted:
            return
        if not _STATE.blocks:
            _set_aside()
        _STATE.blocks += 1
        _STATE.indivisible += self.indivisible
        _STATE.patient += self.patient

    def __exit__(self, *_: object) -> None:
        if not self.counted:
            return
        _STATE.blocks -= 1
        _STATE.indivisible -= self.indivisible
        _STATE.patient -= self.patient
        if not _STATE.blocks:
            _put_back()
        elif self.patient and not _STATE.patient and (_hangs() or not _STATE.indivisible):
            _run_delayed()


def held_back() -> Block:
    """Delay signals until the end of the outermost `with` block, for uninterruptible work that takes milliseconds.

    A signal interrupts a block that has been open for longer than `PATIENCE_S`.
    """
    return Block(True)


def until_the_end() -> Block:
    """Delay signals until the end of the block, without time limit, for C code that discards exceptions of callbacks.

    Within `held_back`, handlers run at the end of the outermost block or, if this block has been open for longer than
    `PATIENCE_S`, at the end of the inner block.
    """
    return Block(True, patient=True)


def deferring() -> Block:
    """Delay signals until the next call of `deliver` or the end of the block, for work of seconds or minutes.

    A signal interrupts a block that has not called `deliver` for longer than `PATIENCE_S`.
    """
    return Block(False)


def deliver() -> None:
    """Run the handlers of signals delayed by `deferring`. Has no effect within `held_back` and `until_the_end`."""
    if not _STATE.blocks or _STATE.indivisible or not _in_main_thread():
        return
    _STATE.since = monotonic()
    _run_delayed()


def _run_delayed() -> None:
    """Run the handlers of the delayed signals now, and continue to delay later signals."""
    if _STATE.received:
        try:
            _put_back()
        except BaseException as error:
            _STATE.raised = error
            raise
        finally:
            _set_aside()


def _hangs() -> bool:
    """Return whether `PATIENCE_S` has passed since the outermost block started or `deliver` was last called."""
    return monotonic() - _STATE.since > PATIENCE_S


def raised_by_handler(error: BaseException) -> bool:
    """Return whether `error` is the last exception that a signal handler raised in `deliver`."""
    return error is _STATE.raised


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _keep(number: int, frame: Any) -> None:
    """Record a signal for later. Call its original handler at once if the block hangs or no block is open."""
    if (_hangs() and not _STATE.patient) or not _STATE.replaced:
        _STATE.received = [other for other in _STATE.received if other != number]
        _STATE.aside[number](number, frame)
    elif _STATE.received.count(number) < MOST_HELD:
        _STATE.received.append(number)


def _set_aside() -> None:
    """Replace the Python handlers of the `HELD` signals by `_keep`. Restore the original handlers if an exception
    occurs."""
    _STATE.since = monotonic()
    try:
        for number in HELD:
            old = _signal.getsignal(number)
            if callable(old):
                if old is not _keep:
                    _STATE.aside[number] = old
                _STATE.replaced.append(number)
                _signal.signal(number, _keep)
    except BaseException:
        _put_back()
        raise


def _put_back() -> None:
    """Restore the original handlers that `_keep` still replaces, and run the handlers of the delayed signals."""
    failed: BaseException | None = None
    while _STATE.replaced:
        number = _STATE.replaced[-1]
        try:
            if _signal.getsignal(number) is _keep:
                _signal.signal(number, _STATE.aside[number])
            _STATE.replaced.pop()
        except BaseException as error:  # raised by a handler that is already restored
            failed = error
    received, _STATE.received = _STATE.received, []
    try:
        _raise_signals(received)
    finally:
        if failed is not None:
            raise failed


def _raise_signals(numbers: list[int]) -> None:
    if numbers:
        try:
            signal.raise_signal(numbers[0])
        finally:
            _raise_signals(numbers[1:])
