"""Conversion of kernel results to Python objects in C, so that no signal handler runs during the conversion.

Numba looks up the class of a named tuple or the type of an array by a Python function, and creates a named tuple by its
`__new__`, also in Python. A handler that raises there (KeyboardInterrupt) leaves a null pointer, which numba
dereferences: a segmentation fault. Here classes are constants of the kernel, `tuple.__new__` creates the tuples, and
the Python function runs once per array type.
"""

from functools import lru_cache
from typing import Any

from numba.core import pythonapi, serialize
from numba.core.boxing import box_tuple
from numba.core.types import containers


def box_in_c() -> None:
    """Convert the results of all kernels of this process in C."""
    for kind in (containers.NamedTuple, containers.NamedUniTuple):
        pythonapi._boxers.functions[kind] = _box_record
    serialize._numba_unpickle = lru_cache(maxsize=None)(serialize._numba_unpickle)


def _box_record(kind: Any, value: Any, c: Any) -> Any:
    """Return the named tuple of a native value; `c` is numba's context."""
    new, cls = (_constant(c, part) for part in (tuple.__new__, kind.instance_class))
    values = box_tuple(kind, value, c)
    arguments = c.pyapi.tuple_pack([cls, values])
    made = c.pyapi.call(new, arguments)
    c.pyapi.decref(arguments)
    c.pyapi.decref(values)
    return made


def _constant(c: Any, value: object) -> Any:
    """Return a borrowed reference to an object that the kernel keeps."""
    return c.env_manager.read_const(c.env_manager.add_const(value))
