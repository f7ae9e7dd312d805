"""How scalar kernels are compiled: without the GIL, and cached on disk; plain Python under `NUMBA_DISABLE_JIT=1`."""

import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import config, njit, typeof, types
from numba.core.codegen import JITCodeLibrary
from numba.extending import overload_method

from agrobot_mj.core.boxing import box_in_c
from agrobot_mj.core.interrupts import until_the_end
from agrobot_mj.core.kernel_cache import CACHE, PackageCache, is_ours

F = TypeVar("F", bound=Callable[..., object])
if "NUMBA_OPT" not in os.environ:
    config.OPT = type(config.OPT)(2)  # as fast as level 3, which takes twice as long to compile: it copies whole loops
box_in_c()


def _hold_signals_back(finalize: Callable[[JITCodeLibrary], None]) -> Callable[[JITCodeLibrary], None]:
    """The step in which LLVM makes or loads machine code, and loses what a signal's handler raises in its callbacks."""

    def finalize_whole(library: JITCodeLibrary) -> None:
        with until_the_end():
            finalize(library)

    return finalize_whole


JITCodeLibrary._finalize_specific = _hold_signals_back(JITCodeLibrary._finalize_specific)


def jit(function: F) -> F:
    """Compile `function` on its first call."""
    return _compiled(function)


def kernel(function: F) -> F:
    """Compile what runs in every physics step: it makes, keeps and returns no array, and divides as numpy does.

    Then numba need not count references to the arrays in its arguments, which takes as long as all the arithmetic of a
    wheel. An array that it did make would never be freed; tests/core/test_kernels.py checks that there is none. Kernels
    become part of those that call them: numba would pass records through memory, to a wheel's some 200 numbers.
    """
    return _compiled(function, _nrt=False, error_model="numpy", forceinline=True)


def bound(function: Any, *arguments: object) -> Callable[..., Any]:
    """Specialise `function` for the types of these arguments and skip numba's type dispatch.

    The dispatch costs about a microsecond per named tuple.
    """
    if config.DISABLE_JIT:
        return cast(Callable[..., Any], function)
    return cast(Callable[..., Any], function.compile(tuple(typeof(argument) for argument in arguments)))


def kernel_method(name: str) -> None:
    """Let kernels call the method `name` of any named tuple: `record.name(...)`, each class with its own.

    The method stays a plain Python function. A kernel that is given a record is compiled for the record's class, so
    that the call is a direct one, and the result is cached on disk like that of any other kernel.
    """
    if config.DISABLE_JIT:
        return
    compiled: dict[type, Callable[..., object]] = {}

    def method(record: Any, *arguments: object) -> Callable[..., object] | None:
        cls = record.instance_class
        if not hasattr(cls, name):
            return None
        if cls not in compiled:
            compiled[cls] = kernel(getattr(cls, name))
        function = compiled[cls]
        return lambda record, *arguments: function(record, *arguments)

    for shape in (types.NamedTuple, types.NamedUniTuple):
        overload_method(shape, name, strict=False)(method)


def _compiled(function: F, **options: object) -> F:
    compiled = njit(nogil=True, **options)(function)
    if CACHE is not None and not config.DISABLE_JIT and is_ours(function):
        compiled._cache = PackageCache(function)
    return cast(F, compiled)
