"""Signals that interrupt a process: handled within a block, or held back while work that belongs together is done.

Python runs the handler of a signal between two instructions of the main thread, and a handler that raises
(KeyboardInterrupt) ends the work there. `held_back` keeps handlers from running within a block; `deferring` lets them
run only where the block calls `deliver`. Default actions stay (SIGTERM kills). In other threads, which no handler
interrupts, both do nothing.
"""

import _signal  # type: ignore[import-not-found]  # `signal.signal` without enums: 0.3 us in place of 5 us
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

NUMBERS = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a process to end."""
HELD = tuple(
    int(getattr(signal, name))
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGBREAK")
    if hasattr(signal, name)
)
"""Signals whose handlers are held back: those that programs raise exceptions from."""
PATIENCE_S = 5.0
"""Age of a block from which handlers run at once, so that code that hangs can be interrupted [s]. A tick takes
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
"""Number of signals of one kind that a block holds back: a second one may ask for more than the first."""


class _State:
    """Open blocks of the main thread."""

    def __init__(self) -> None:
        self.blocks = self.indivisible = self.patient = 0
        self.aside: dict[int, Any] = {}
        """Handlers set aside, by signal; kept afterwards for code that has saved `_keep` and sets it again."""
        self.replaced: list[int] = []
        """Signals whose handler is `_keep` at present."""
        self.received: list[int] = []
        """Signals held back."""
        self.since = 0.0
        """Start of the outermost block, or the last `deliver` in it [s]."""
        self.raised: BaseException | None = None
        """Last exception that a handler has raised in `deliver`."""


_STATE = _State()


class Block:
    """A block in which handlers do not run, see `held_back`, `until_the_end` and `deferring`."""

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
    """Hold signals back until the end of the block; for work of milliseconds that belongs together.

    Handlers run at the end of the outermost block, also those of several signals. A block open for longer than
    `PATIENCE_S` is interrupted at once.
    """
    return Block(True)


def until_the_end() -> Block:
    """Hold signals back however long the block takes; for C code that loses what its callbacks raise."""
    return Block(True, patient=True)


def deferring() -> Block:
    """Let handlers run only in `deliver` and at the end of the block; for runs and tasks, of seconds or minutes."""
    return Block(False)


def deliver() -> None:
    """Run the handlers of the signals that a `deferring` block has held back; nothing within `held_back`."""
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
    """Return whether a signal's handler has raised this exception in `deliver`."""
    return error is _STATE.raised


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _keep(number: int, frame: Any) -> None:
    """Handler of a block: note the signal; pass it on where the block hangs, and outside of any block."""
    hangs = not _STATE.patient and monotonic() - _STATE.since > PATIENCE_S
    if hangs or not _STATE.replaced:
        _STATE.received = [other for other in _STATE.received if other != number]
        _STATE.aside[number](number, frame)
    elif _STATE.received.count(number) < MOST_HELD:
        _STATE.received.append(number)


def _set_aside() -> None:
    """Replace the handlers by `_keep`; none is replaced if another one raises meanwhile."""
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
    """Put the handlers back, unless the block has set others, and run those of the signals held back."""
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
    """Send these signals to this process, all of them also where a handler raises."""
    if numbers:
        try:
            signal.raise_signal(numbers[0])
        finally:
            _raise_signals(numbers[1:])
