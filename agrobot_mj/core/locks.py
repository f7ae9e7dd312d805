"""Exclusive lock on a file or folder between processes."""

import os
import time
from pathlib import Path

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # pragma: no cover - Windows has no such locks; simultaneous processes are not detected
    flock = None  # type: ignore[assignment]


def acquire_lock(path: Path, patience: float) -> int | None:
    """Lock a file or folder and return its file descriptor. Return None if the system does not support locks.

    Closing the descriptor releases the lock. Raises TimeoutError if another process holds the lock for more than
    `patience` [s].
    """
    if flock is None:  # pragma: no cover
        return None
    handle, deadline = os.open(path, os.O_RDONLY), time.monotonic() + patience
    try:
        while True:
            try:
                flock(handle, LOCK_EX | LOCK_NB)
                return handle
            except BlockingIOError:
                if time.monotonic() >= deadline:
                    raise TimeoutError(f"{path} is locked by another process") from None
            time.sleep(0.1)
    except BaseException as error:
        os.close(handle)
        if isinstance(error, OSError) and not isinstance(error, TimeoutError):
            return None
        raise
