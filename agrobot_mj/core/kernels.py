"""Compilation of numerical functions (kernels) with numba, without Python's global lock (GIL) and with a disk cache.

With `NUMBA_DISABLE_JIT=1` kernels are plain Python functions.
"""

import copyreg
import os
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache, wraps
from types import UnionType
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numba import config, njit, typeof, types
from numba.extending import overload, overload_method, register_jitable
from numba.np.numpy_support import from_dtype

from agrobot_mj.core import geometry
from agrobot_mj.core.boxing import box_in_c
from agrobot_mj.core.held import ANY, KINDS, HeldType, Reference, holding, number_of, value_of
from agrobot_mj.core.kernel_cache import CACHE, PackageCache, is_ours
from agrobot_mj.core.machine_code import generate_on_request

F = TypeVar("F", bound=Callable[..., object])
T = TypeVar("T")
if "NUMBA_OPT" not in os.environ:
    config.OPT = type(config.OPT)(2)  # code as fast as from level 3, compiled in half the time
COMPILES = not config.DISABLE_JIT  # Whether kernels are compiled
box_in_c()
generate_on_request()


def shared(function: F) -> F:
    """Allow kernels to call the Python function `function`, and return the function unchanged."""
    return cast(F, register_jitable(function))


for _name in ("wrap", "to_heading", "from_heading", "along_arc", "to_level", "to_body"):
    shared(getattr(geometry, _name))


@shared
def copy_into(target: Any, source: Any) -> None:
    """Copy the elements of the array `source` to the array `target`. The shapes must be equal, and are not checked.

    This loop compiles faster than an assignment to a slice, whose error for different shapes takes 2 s to compile.
    """
    for k in range(source.size):
        target.flat[k] = source.flat[k]


def jit(function: F) -> F:
    """Return `function` as a numba function that is compiled on its first call."""
    return _compiled(function)


def kernel(function: F) -> F:
    """Return a function of the physics step, compiled on its first call. Division by zero gives infinity or NaN.

    The function must not create, store or return arrays. Numba then omits the reference counts of array arguments,
    whose updates take as long as the computation of a wheel. An array created in a kernel would never be freed;
    tests/core/test_kernels.py checks that kernels create no arrays. Kernels are inlined into their callers, because
    numba would otherwise pass records, such as the 200 numbers of a wheel, through memory.
    """
    return _compiled(function, _nrt=False, error_model="numpy", forceinline=True)


def bound(function: Any, *arguments: object) -> Callable[..., Any]:
    """Return the numba function `function`, compiled for the types of `arguments`. Calls bypass numba's type
    dispatch."""
    if config.DISABLE_JIT:
        return cast(Callable[..., Any], function)
    return _bound(function, kinds_of(arguments))


@cache
def _bound(function: Any, kinds: tuple[types.Type, ...]) -> Callable[..., Any]:
    entry, hint = _entry(function, *kinds), get_type_hints(function.py_func, include_extras=True)["return"]
    _check_references(function.__name__, hint, function.overloads[kinds].signature.return_type)
    return entry


def kinds_of(arguments: tuple[object, ...]) -> tuple[types.Type, ...]:
    """Return the numba types of `arguments`."""
    return tuple(HeldType(KINDS[number_of(a)]) if type(a) is Reference else typeof(a) for a in arguments)


def stage(function: F) -> F:
    """Return `function`, compiled on its first call for its annotated types. Calls bypass numba's type dispatch.

    `function` may be a `jit` function, which kernels can also call. Arguments are numbers, C-contiguous arrays
    (`Vector`, `Matrix`), tuples and named tuples of these types, and references to named tuples (`Held`).
    """
    if config.DISABLE_JIT:
        return function
    entries: list[Callable[..., object]] = []
    compiled: Any = function if hasattr(function, "py_func") else _compiled(function)
    hints = [hint for name, hint in function.__annotations__.items() if name != "return"]
    places = [k for k, hint in enumerate(hints) if get_origin(hint) is Annotated]

    @wraps(function)
    def call(*arguments: object) -> object:
        for k in places:
            if type(arguments[k]) is not Reference:  # compiled code would read any memory
                raise TypeError(
                    f"{function.__name__}: argument {k + 1} must be a reference from held(), got {arguments[k]!r:.80}"
                )
        if not entries:
            for given, kind in zip(arguments, _arguments_of(compiled), strict=True):
                if isinstance(kind, HeldType) and kind is not ANY and number_of(given) != kind.number:
                    raise TypeError(f"{function.__name__}: an argument must be a reference to {kind.types[0]}")
            entries.append(_checked_entry(compiled))
        return entries[0](*arguments)

    call.compiled = compiled  # type: ignore[attr-defined]
    return cast(F, call)


def code_of(function: Any, kinds: tuple[types.Type, ...] = ()) -> Any:
    """Return numba's compilation result of a `stage` function, or of a kernel for arguments of the types `kinds`."""
    if kinds:
        _entry(function, *kinds)
        return function.overloads[kinds]
    _checked_entry(function.compiled)
    return function.compiled.overloads[_arguments_of(function.compiled)]


def _arguments_of(compiled: Any) -> tuple[types.Type, ...]:
    hints = get_type_hints(compiled.py_func, include_extras=True)
    return tuple(numba_type_of(hint) for name, hint in hints.items() if name != "return")


def _checked_entry(compiled: Any) -> Callable[..., Any]:
    """Return a function compiled for its annotated arguments. Raises TypeError if its result contradicts the
    annotation."""
    kinds, function = _arguments_of(compiled), compiled.py_func
    entry = _entry(compiled, *kinds)
    hint = get_type_hints(function, include_extras=True)["return"]
    _check_references(function.__name__, hint, compiled.overloads[kinds].signature.return_type)
    return entry


def _entry(compiled: Any, *kinds: types.Type) -> Callable[..., Any]:
    """Return the function compiled for arguments of the types `kinds`. Calls bypass numba's type dispatch."""
    _KEPT.append(compiled)  # the machine code is freed with its dispatcher
    cached = isinstance(compiled._cache, PackageCache)
    with compiled._cache.compiling() if cached else nullcontext():
        return cast(Callable[..., Any], compiled.compile(kinds))


_KEPT: list[Any] = []


def _check_references(name: str, hint: Any, found: Any) -> None:
    """Raise TypeError unless the references in the result of a compiled function have the types of its annotation."""
    if get_origin(hint) is tuple:
        for part, kind in zip(get_args(hint), found, strict=True):
            _check_references(name, part, kind)
    elif get_origin(hint) is Annotated and numba_type_of(hint).number != found.number:
        raise TypeError(f"{name} must return a reference to {numba_type_of(hint).types[0]}, not to {found.types[0]}")


def numba_type_of(hint: Any) -> types.Type:
    """Return the numba type that corresponds to the type annotation of an argument of a `stage` function."""
    if isinstance(hint, UnionType):  # optional number: present in kernels
        hint = get_args(hint)[0]
    if hint in NUMBERS:
        return NUMBERS[hint]
    if get_origin(hint) is Annotated:
        return ANY if hint.__origin__ is Any else HeldType(numba_type_of(hint.__origin__))
    if get_origin(hint) is np.ndarray:
        shape, kind = get_args(hint)
        return types.Array(from_dtype(np.dtype(get_args(kind)[0])), len(get_args(shape)), "C")
    if get_origin(hint) is tuple:
        return types.BaseTuple.from_types([numba_type_of(part) for part in get_args(hint)])
    parts = get_type_hints(hint, include_extras=True).values()
    return types.BaseTuple.from_types([numba_type_of(part) for part in parts], hint)


def held(value: T, as_it_is: bool = False) -> T:
    """Return a reference to a copy of a named tuple, for arguments annotated `Held`. Arrays in the tuple are shared.

    The fields have the annotated types or, if `as_it_is`, the types of their values. References are returned unchanged.
    """
    if config.DISABLE_JIT or type(value) is Reference:
        return value
    return cast(T, _holder(typeof(value) if as_it_is else cast(Any, type(value)))(value))


def fetched(value: T) -> T:
    """Return the named tuple that a reference points to, and any other `value` unchanged. Kernels may call this
    function."""
    return cast(T, _fetcher(number_of(value))(value)) if type(value) is Reference else value


overload(fetched)(lambda value: (lambda value: value_of(value)) if isinstance(value, HeldType) else None)
overload(held)(lambda value, as_it_is=False: holding(value))


@cache
def _holder(kind: Any) -> Callable[..., object]:
    value = kind if isinstance(kind, types.Type) else numba_type_of(kind)
    HeldType(value)  # makes the type known to `fetched`
    return _entry(_compiled(_same), value)


@cache
def _fetcher(number: int) -> Callable[..., object]:
    return _entry(_compiled(_same_of), HeldType(KINDS[number]))


def _same(value: T) -> T:
    return held(value)


def _same_of(reference: T) -> T:
    return fetched(reference)


copyreg.pickle(Reference, lambda reference: (held, (fetched(reference),)))


NUMBERS = {float: types.float64, int: types.int64, bool: types.boolean, complex: types.complex128}
"""Numba type of each Python number type."""


@cache
def kernel_method(name: str) -> None:
    """Allow kernels to call the method `name` of named tuples, as in `record.name(...)`; no field may have this name.

    The method stays a plain Python function. A kernel with a record argument is compiled for the class of the record,
    so that the call is direct and the compiled code is cached on disk.
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
    """Return `function` in two versions, each compiled on its first call: the returned version is called from Python,
    and the other version from kernels.

    The version for kernels has no interface to Python. The interface converts named tuples with hundreds of numbers,
    and its compilation takes longer than the compilation of most functions.
    """
    compiled = _dispatcher(function, False, **options)

    @cache
    def inner() -> Any:
        return _dispatcher(function, True, no_cpython_wrapper=True, **options)

    compiled.get_call_template = lambda *found: inner().get_call_template(*found)
    compiled.get_overload = lambda kinds: inner().get_overload(kinds)
    return cast(F, compiled)


def _dispatcher(function: F, called_by_kernels: bool, **options: object) -> Any:
    compiled = njit(nogil=True, no_cfunc_wrapper=True, **options)(function)
    if CACHE is not None and not config.DISABLE_JIT and is_ours(function):
        compiled._cache = PackageCache(function, called_by_kernels)
    return compiled
