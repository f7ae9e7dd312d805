"""Handling of signals that interrupt a process: by a handler within a block, or delayed until atomic work is complete.

Python runs a signal handler between two instructions of the main thread, and a handler that raises (KeyboardInterrupt)
ends the work there. `held_back` prevents handlers from running within a block; `deferring` allows them only when the
block calls `deliver`. Default actions stay (SIGTERM kills). In other threads, where no handler runs, both have no
effect.
"""

import _signal  # type: ignore[import-not-found]  # `signal.signal` without enums: 0.3 us in place of 5 us
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

NUMBERS = (signal.SIGINT, signal.SIGTERM)
"""Signals that request the end of a process."""
HELD = tuple(
    int(getattr(signal, name))
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGBREAK")
    if hasattr(signal, name)
)
"""Signals whose handlers are delayed: those from which programs raise exceptions."""
PATIENCE_S = 5.0
"""Age of a block after which handlers run at once, so that a hanging block can be interrupted [s]. A tick takes
milliseconds."""


@contextmanager
def handled_by(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle SIGINT and SIGTERM by `handler` within the block."""
    before: dict[int, Any] = {}
    try:
        for asks in NUMBERS:
            before[asks] = signal.getsignal(asks)
            signal.signal(asks, handler)
        yield
    finally:
        for number, old in before.items():
            if old is not None:  # one that Python has not set cannot be set again
                signal.signal(number, old)


MOST_HELD = 2
"""Number of signals of one kind that a block delays: a second signal may request more than the first."""


class _State:
    """State of the open blocks of the main thread."""

    def __init__(self) -> None:
        self.blocks = self.indivisible = self.patient = 0
        self.aside: dict[int, Any] = {}
        """Replaced handlers by signal; kept for code that has saved `_keep` and sets it again."""
        self.replaced: list[int] = []
        """Signals whose present handler is `_keep`."""
        self.received: list[int] = []
        """Delayed signals."""
        self.since = 0.0
        """Start of the outermost block, or the last `deliver` in it [s]."""
        self.raised: BaseException | None = None
        """Last exception that a handler has raised in `deliver`."""


_STATE = _State()


class Block:
    """Block in which handlers do not run, see `held_back`, `until_the_end` and `deferring`."""

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


def held_back() -> Block:
    """Delay signals until the end of the block; for atomic work of milliseconds.

    Handlers of all signals run at the end of the outermost block. A block open for longer than `PATIENCE_S` is
    interrupted at once.
    """
    return Block(True)


def until_the_end() -> Block:
    """Delay signals for the whole duration of the block; for C code that loses exceptions of its callbacks."""
    return Block(True, patient=True)


def deferring() -> Block:
    """Run handlers only in `deliver` and at the end of the block; for runs and tasks of seconds or minutes."""
    return Block(False)


def deliver() -> None:
    """Run the handlers of the signals that a `deferring` block has delayed; no effect within `held_back`."""
    if not _STATE.blocks or _STATE.indivisible or not _in_main_thread():
        return
    _STATE.since = monotonic()
    if _STATE.received:
        try:
            _put_back()
        except BaseException as error:
            _STATE.raised = error
            raise
        finally:
            _set_aside()


def raised_by_handler(error: BaseException) -> bool:
    """Return whether a signal handler has raised this exception in `deliver`."""
    return error is _STATE.raised


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _keep(number: int, frame: Any) -> None:
    """Record a signal within a block; call its handler if the block hangs, and outside of blocks."""
    hangs = not _STATE.patient and monotonic() - _STATE.since > PATIENCE_S
    if hangs or not _STATE.replaced:
        _STATE.received = [other for other in _STATE.received if other != number]
        _STATE.aside[number](number, frame)
    elif _STATE.received.count(number) < MOST_HELD:
        _STATE.received.append(number)


def _set_aside() -> None:
    """Replace all handlers by `_keep`; replace none if an exception occurs."""
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
    """Restore the handlers, unless the block has set others, and run those of the delayed signals."""
    failed: BaseException | None = None
    while _STATE.replaced:
        number = _STATE.replaced[-1]
        try:
            if _signal.getsignal(number) is _keep:
                _signal.signal(number, _STATE.aside[number])
            _STATE.replaced.pop()
        except BaseException as error:  # of a handler that is back already
            failed = error
    received, _STATE.received = _STATE.received, []
    try:
        _raise_signals(received)
    finally:
        if failed is not None:
            raise failed


def _raise_signals(numbers: list[int]) -> None:
    """Send these signals to this process, all of them even if a handler raises."""
    if numbers:
        try:
            signal.raise_signal(numbers[0])
        finally:
            _raise_signals(numbers[1:])
