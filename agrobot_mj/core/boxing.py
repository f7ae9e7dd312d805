"""Conversion of kernel results to Python objects in C, without Python code that a signal handler could interrupt.

By default, numba runs Python code to find the class of a named tuple and the type of an array, and to create a named
tuple. A signal handler that raises KeyboardInterrupt in this code causes a segmentation fault. This module therefore
stores the classes as constants of the kernel and creates the tuples with `tuple.__new__`. Only the first conversion of
an array type runs Python code.
"""

from functools import lru_cache
from typing import Any

from numba.core import pythonapi, serialize
from numba.core.boxing import box_tuple
from numba.core.types import containers


def box_in_c() -> None:
    """Enable the conversion of kernel results to Python objects in C, for all kernels of this process."""
    for kind in (containers.NamedTuple, containers.NamedUniTuple):
        pythonapi._boxers.functions[kind] = _box_record
    serialize._numba_unpickle = lru_cache(maxsize=None)(serialize._numba_unpickle)


def _box_record(kind: Any, value: Any, c: Any) -> Any:
    """Convert a native `value` to a Python named tuple of the numba type `kind`; `c` is numba's conversion context."""
    constants = c.env_manager  # the references to the constants of the kernel are borrowed
    new, cls = (constants.read_const(constants.add_const(part)) for part in (tuple.__new__, kind.instance_class))
    values = box_tuple(kind, value, c)
    arguments = c.pyapi.tuple_pack([cls, values])
    made = c.pyapi.call(new, arguments)
    c.pyapi.decref(arguments)
    c.pyapi.decref(values)
    return made
