"""Processes that share a cold cache of kernels: each kernel is compiled by one of them, and read by the others.

Numba by itself compiles it in each, a minute of processor time.
"""

import fcntl
from contextlib import contextmanager
from functools import wraps
from hashlib import sha256

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from agrobot_mj.core.kernel_cache import CACHE

held = set()
"""Names of the kernels whose locks this process holds."""


@contextmanager
def turn_of(function):
    """Hold the lock of a kernel, which ends with the process at the latest.

    A kernel is compiled while those that call it are. No call goes round in a circle, so neither do those who wait.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    if name in held:
        yield
        return
    with (CACHE / f"{sha256(name.encode()).hexdigest()[:16]}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        held.add(name)
        try:
            yield
        finally:
            held.remove(name)


def take_turns():
    """Let this process wait for what another one compiles."""
    compiled = Dispatcher.compile

    @wraps(compiled)
    def compiled_in_turn(dispatcher, signature):
        if dispatcher.stats.cache_path is None:
            return compiled(dispatcher, signature)
        with global_compiler_lock, turn_of(dispatcher.py_func):
            return compiled(dispatcher, signature)

    if CACHE is not None:
        Dispatcher.compile = compiled_in_turn
