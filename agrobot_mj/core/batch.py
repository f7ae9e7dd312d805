"""The scalar laws of tyres and valves in Warp: a prototype for thousands of tractors at once; needs the extra `batch`.

Numba compiles the lines of a law for the tick; Warp compiles the same lines for its own kernels, so that a `passive`
callback of MuJoCo Warp can take them. Numbers have single precision there. Only laws come over, not what remembers: the
contact patch, a valve's delay and lag.

    law, force = as_struct(MagicLaw), as_function(MagicLaw.force, MagicLaw)
    slip, tyre_force = as_struct(Slip), as_struct(TyreForce)

    @warp.kernel
    def forces(law: law, slips: warp.array(dtype=slip), out: warp.array(dtype=tyre_force)):
        k = warp.tid()
        out[k] = force(law, slips[k])

    warp.launch(forces, n, [as_value(front), slips, out])
"""

import math
from collections.abc import Callable
from functools import cache
from math import sqrt
from types import FunctionType
from typing import Any, get_args, get_type_hints

from agrobot_mj.core.errors import required


def _warp() -> Any:
    return required("warp", "batch", "a law in Warp")


@cache
def as_struct(record: Any) -> Any:
    """Warp's struct with the fields of a named tuple of floats, or of such named tuples."""
    fields = {name: _as_type(kind) for name, kind in get_type_hints(record).items()}
    return _warp().struct(type(record.__name__, (), {"__annotations__": fields, "__module__": record.__module__}))


@cache
def as_function(law: Callable[..., object], record: type | None = None) -> Any:
    """Warp's function with the lines of a kernel, or of a method of the named tuple `record`, which it takes first.

    Kernels and named tuples that the lines name come with it.
    """
    plain: Any = getattr(law, "py_func", law)
    names = plain.__globals__ | {name: _as_name(plain.__globals__.get(name)) for name in plain.__code__.co_names}
    copied = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__)
    copied.__module__, copied.__qualname__ = plain.__module__, plain.__qualname__
    hints = ({} if record is None else {"self": record}) | get_type_hints(plain)
    copied.__annotations__ = {name: _as_type(kind) for name, kind in hints.items() if name != "return"}
    return _warp().func(copied)


def as_value(record: Any) -> Any:
    """The numbers of a named tuple as a value of its struct."""
    kind: Any = type(record)
    value = as_struct(kind)()
    for name, number in record._asdict().items():
        setattr(value, name, as_value(number) if hasattr(number, "_fields") else number)
    return value


def _as_type(kind: Any) -> Any:
    """Warp's type for that of a field or argument."""
    if hasattr(kind, "_fields"):
        return as_struct(kind)
    parts = get_args(kind)
    return tuple[tuple(map(_as_type, parts))] if parts else kind  # type: ignore[misc]


def _as_name(value: Any) -> Any:
    """What a law names in its lines, as Warp knows it."""
    if value is math.hypot:
        return as_function(_hypot)
    if getattr(value, "__module__", None) == "math":
        return getattr(_warp(), value.__name__)
    if isinstance(value, FunctionType) or hasattr(value, "py_func"):
        return as_function(value)
    return as_struct(value) if hasattr(value, "_fields") else value


def _hypot(x: float, y: float) -> float:
    return sqrt(x * x + y * y)
