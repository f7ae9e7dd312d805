"""References to states that remain in the memory of compiled code.

A `kernels.stage` function with an argument or a result annotated `Held[State]` takes or returns a reference.
`kernels.held` creates a reference to a named tuple, and `kernels.fetched` returns the named tuple. References save
time: converting a state of 300 numbers to Python objects takes longer than most such functions. A held state is
immutable, like its named tuple. Without compilation the reference is the named tuple itself.
"""

import ctypes
from collections.abc import Callable
from hashlib import blake2b
from typing import Annotated, Any, TypeVar

from llvmlite.ir import IntType
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.runtime import nrt
from numba.experimental import structref
from numba.extending import NativeValue, box, intrinsic, unbox

T = TypeVar("T")
Held = Annotated[T, "held"]  # Annotation of a named tuple that a stage takes or returns as a reference
Reference: type = nrt.MemInfo  # Class of the references
KINDS: dict[int, Any] = {}  # Numba types of the held states, by the number from `HeldType`


@structref.register
class HeldType(types.StructRef):  # type: ignore[misc]
    """Numba type of a reference to a named tuple. The number `kind` identifies the tuple class in every process."""

    def __init__(self, value: types.Type) -> None:
        """Create the type of references to values of the numba type `value`."""
        super().__init__((("kind", types.int64), ("value", value)))
        self.types = (value,)
        self.number = int.from_bytes(blake2b(str(value).encode(), digest_size=7).digest(), "little")
        KINDS[self.number] = value


ANY = HeldType(types.none)  # Type of a reference to a state of any type, annotated `Held[Any]`


@unbox(HeldType)
def _to_native(kind: Any, reference: Any, c: Any) -> Any:
    """Convert a Python reference to a native reference. The reference count increases only in kernels with reference
    counting."""
    native = cgutils.create_struct_proxy(kind)(c.context, c.builder)
    native.meminfo = _word(c.builder, reference, 2)  # after the header of a Python object
    if c.context.enable_nrt:
        c.context.nrt.incref(c.builder, kind, native._getvalue())
    return NativeValue(native._getvalue())


def _word(builder: Any, pointer: Any, k: int) -> Any:
    """Load the pointer stored `k` machine words after `pointer`."""
    byte = IntType(8).as_pointer()
    return builder.load(builder.gep(builder.bitcast(pointer, byte.as_pointer()), [IntType(32)(k)]))


@intrinsic  # type: ignore[misc, unused-ignore]
def value_of(_: Any, reference: Any) -> Any:
    """Return the named tuple that a native reference points to, also in kernels without reference counting."""

    def read(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        native = cgutils.create_struct_proxy(reference)(context, builder, value=arguments[0])
        data, stored = _word(builder, native.meminfo, 3), reference.get_data_type()
        place = builder.bitcast(data, context.get_value_type(stored).as_pointer())
        value = cgutils.create_struct_proxy(stored)(context, builder, ref=place).value
        return impl_ret_borrowed(context, builder, signature.return_type, value)

    return reference.field_dict["value"](reference), read


@box(HeldType)
def _to_python(kind: Any, value: Any, c: Any) -> Any:
    """Convert a native reference to a Python reference."""
    return c.pyapi.nrt_meminfo_as_pyobject(cgutils.create_struct_proxy(kind)(c.context, c.builder, value=value).meminfo)


def number_of(reference: Any) -> int:
    """Return the number that identifies the type of the state behind a reference. The number is a key of `KINDS`."""
    return ctypes.c_int64.from_address(reference.data).value


def holding(value: Any) -> Callable[..., Any]:
    """Return a kernel function that copies a named tuple of the numba type `value` and returns a reference to it."""
    kind = HeldType(value)
    number = kind.number

    def hold(value, as_it_is=False):  # type: ignore[no-untyped-def]
        reference = structref.new(kind)
        reference.kind, reference.value = number, value
        return reference

    return hold
