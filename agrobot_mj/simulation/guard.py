"""Exclusive and atomic calls of a simulation.

Only one caller at a time can use the simulation. System signals, such as Ctrl-C, are delayed until the end of the call.
"""

from threading import Lock

from agrobot_mj.core.errors import CommandError
from agrobot_mj.core.interrupts import held_back

IN_USE = (
    "the simulation is in use by another thread or by an enclosing call; use a separate "
    "simulation in each thread (copy.deepcopy)"
)


class Guard:
    """Context manager for an uninterruptible, exclusive call of a simulation. Raises `CommandError` if another call is
    in progress."""

    def __init__(self) -> None:
        self._lock = Lock()

    def __enter__(self) -> None:
        block = held_back()
        block.__enter__()
        if not self._lock.acquire(blocking=False):
            block.__exit__()
            raise CommandError(IN_USE)
        self._block = block

    def __exit__(self, *_: object) -> None:
        block = self._block
        self._lock.release()
        block.__exit__()
