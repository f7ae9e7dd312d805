"""States of compiled stages that stay in compiled memory: Python passes only a reference to them.

A stage with an argument or a result annotated `Held[State]` takes and returns references. Converting a state of 300
numbers to Python objects takes longer than most stages. A held state is immutable like the named tuple that it stands
for, and is converted by `fetched`. Without compilation the reference is the named tuple itself.
"""

import ctypes
from collections.abc import Callable
from hashlib import blake2b
from typing import Annotated, Any, TypeVar

from numba import types
from numba.core import cgutils
from numba.core.runtime import nrt
from numba.experimental import structref
from numba.extending import NativeValue, box, unbox

T = TypeVar("T")
Held = Annotated[T, "held"]  # Annotation of a named tuple that a stage takes or returns as a reference
Reference: type = nrt.MemInfo  # Class of the references
KINDS: dict[int, Any] = {}  # Types of the held states, by their number


@structref.register
class HeldType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a reference to a named tuple; `kind` identifies its class in every process."""

    def __init__(self, value: types.Type) -> None:
        """Create the type of references to values of this type."""
        super().__init__((("kind", types.int64), ("value", value)))
        self.types = (value,)
        self.number = int.from_bytes(blake2b(str(value).encode(), digest_size=7).digest(), "little")
        KINDS[self.number] = value


@unbox(HeldType)
def _taken(kind: Any, reference: Any, c: Any) -> Any:
    """Return the native reference of a Python reference."""
    native = cgutils.create_struct_proxy(kind)(c.context, c.builder)
    native.meminfo = c.pyapi.nrt_meminfo_from_pyobject(reference)
    return NativeValue(native._getvalue())


@box(HeldType)
def _given(kind: Any, value: Any, c: Any) -> Any:
    """Return the Python reference of a native reference."""
    return c.pyapi.nrt_meminfo_as_pyobject(cgutils.create_struct_proxy(kind)(c.context, c.builder, value=value).meminfo)


def number_of(reference: Any) -> int:
    """Return the index of the type of a held state."""
    return ctypes.c_int64.from_address(reference.data).value


def with_references(function: Any, arguments: dict[str, types.Type], results: Any) -> Callable[..., Any]:
    """Return a function for compilation that takes and returns references for each `HeldType`.

    `results` is the type of the result, or a tuple with the types of its elements. Types without a reference are None.
    """
    taken = ", ".join(f"{name}.value" if isinstance(kind, HeldType) else name for name, kind in arguments.items())
    several = isinstance(results, tuple)
    kinds = results if several else (results,)
    lines = [f"def {function.__name__}({', '.join(arguments)}):", f"    found = function({taken})"]
    found = [f"found[{k}]" if several else "found" for k in range(len(kinds))]
    for k, kind in enumerate(kinds):
        if isinstance(kind, HeldType):
            lines += [f"    r{k} = new(kind{k})", f"    r{k}.kind, r{k}.value = {kind.number}, {found[k]}"]
            found[k] = f"r{k}"
    lines.append(f"    return {', '.join(found)}")
    code = function.py_func.__code__
    scope = {"function": function, "new": structref.new, **{f"kind{k}": kind for k, kind in enumerate(kinds)}}
    exec(compile("\n" * (code.co_firstlineno - 1) + "\n".join(lines), code.co_filename, "exec"), scope)
    made: Callable[..., Any] = scope[function.__name__]
    made.__module__, made.__qualname__ = function.py_func.__module__, f"{function.__name__}.held"
    return made
