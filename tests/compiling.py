"""Shared compilation of kernels by several processes with an empty cache: one compiles a kernel, the others read it.

Numba alone would compile each kernel in each process, which takes a minute of processor time.
"""

import fcntl
from contextlib import contextmanager
from functools import wraps
from hashlib import sha256

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from agrobot_mj.core.kernel_cache import CACHE

held = set()  # Names of the kernels that this process has locked


@contextmanager
def turn_of(function):
    """Hold the lock of a kernel while the kernel is compiled. The lock is released at the latest when the process ends.

    A kernel is compiled within the compilation of its callers. Calls are not circular, so that there is no deadlock.
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
    """Make this process wait for kernels that another process is compiling."""
    compiled = Dispatcher.compile

    @wraps(compiled)
    def compiled_in_turn(dispatcher, signature):
        if dispatcher.stats.cache_path is None:
            return compiled(dispatcher, signature)
        with global_compiler_lock, turn_of(dispatcher.py_func):
            return compiled(dispatcher, signature)

    if CACHE is not None:
        Dispatcher.compile = compiled_in_turn
