"""Calls by address between separately compiled functions.

By default, numba includes the code of a called function in its caller. A caller of all stages of a tick would therefore
be compiled again for each combination of stages. With calls by address, each stage is compiled once, and one caller
serves all combinations. Stages with different states have the same signature, because references to states (`Held`) of
all types are alike in compiled code.
"""

from collections.abc import Callable
from functools import cache
from math import nan
from typing import Any, NamedTuple, cast, get_type_hints

from llvmlite.ir import FunctionType, VoidType
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_new_ref
from numba.extending import intrinsic

from agrobot_mj.core.held import Held, HeldType
from agrobot_mj.core.kernels import COMPILES, code_of, kinds_of, numba_type_of


class Linked(NamedTuple):
    """Compiled function that other compiled code calls by address."""

    function: Any  # Compiled function of a tick, a `stage` or the result of `bound`
    law: Held[Any]  # Parameters of the stage
    state: Held[Any]  # Current state of the stage
    inputs: Any = None  # Additional parameters of an estimator, or last result (`Followed`) of a path-following law
    preview_s: float = nan  # Preview time of a guidance law for `Situated.preview` [s], or NaN


def caller_of(form: Any) -> Callable[..., Any]:
    """Return a kernel function `call(address, arguments)`, which calls the compiled function at an address.

    The called function must have the annotations of the function `form`, and the arguments are a tuple of the annotated
    types. A reference to any state matches `Held[Any]`. The call returns whether the function succeeded, and the result
    of the function, which is zero after an error. Without compilation, the address is the function itself.
    """
    if not COMPILES:
        return lambda function, arguments: (True, function(*arguments))
    hints = {name: numba_type_of(hint) for name, hint in get_type_hints(form, include_extras=True).items()}
    result, kinds = hints.pop("return"), tuple(hints.values())

    @intrinsic  # type: ignore[misc, unused-ignore]
    def call(_: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function = builder.inttoptr(values[0], context.call_conv.get_function_type(result, kinds).as_pointer())
            given = cgutils.unpack_tuple(builder, values[1])
            status, value = context.call_conv.call_function(builder, function, result, kinds, given)
            both = context.make_tuple(builder, signature.return_type, (builder.not_(status.is_error), value))
            return impl_ret_new_ref(context, builder, signature.return_type, both)

        for kind, given in zip(kinds, arguments, strict=True):
            if kind != given and not isinstance(kind, HeldType):
                raise TypeError(f"{form.__name__} takes {kind}, got {given}")
        return types.Tuple((types.boolean, result))(address, arguments), generate

    return cast(Callable[..., Any], call)


@intrinsic  # type: ignore[misc, unused-ignore]
def call_back(_: Any, address: Any) -> Any:
    """Call the C function without arguments and result at `address`, which may be a Python function in `ctypes`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.call(builder.inttoptr(values[0], FunctionType(VoidType(), []).as_pointer()), [])
        return context.get_dummy_value()

    return types.void(address), generate


def address_of(function: Any, form: Any, *arguments: object) -> Any:
    """Return the machine-code address of a `stage` function or, with `arguments`, of a kernel compiled for their types.

    Without compilation, return the function.
    Raises TypeError if the argument or result types differ from the annotations of `form`, except in the types of
    states.
    """
    return _address(function, form, kinds_of(arguments)) if COMPILES else function


@cache
def _address(function: Any, form: Any, kinds: tuple[types.Type, ...]) -> int:
    code = code_of(function, kinds)
    hints = [numba_type_of(hint) for hint in get_type_hints(form, include_extras=True).values()]
    found = [*code.signature.args, code.signature.return_type]
    for wanted, kind in zip(hints, found, strict=True):
        if not _alike(wanted, kind):
            raise TypeError(f"{code.fndesc.qualname} has {kind}, but {form.__name__} has {wanted}")
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_func_name))


def _alike(wanted: Any, kind: Any) -> bool:
    if isinstance(wanted, HeldType):
        return isinstance(kind, HeldType)
    if isinstance(wanted, types.BaseTuple) and isinstance(kind, types.BaseTuple):
        same = getattr(wanted, "instance_class", None) is getattr(kind, "instance_class", None)
        return same and len(wanted) == len(kind) and all(map(_alike, wanted, kind))
    return bool(wanted == kind)
