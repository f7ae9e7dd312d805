"""How scalar kernels are compiled: without the GIL, and cached on disk; plain Python under `NUMBA_DISABLE_JIT=1`.

Numba checks only the file of a cached function for changes, not those of the functions it calls. So the cache lies in a
folder named after the content of every part of the package that kernels come from, where a stale one cannot be found,
and what is compiled from code outside the package is not kept.
"""

import hashlib
import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config, njit, typeof, types
from numba.core.caching import FunctionCache
from numba.extending import overload_method
from platformdirs import user_cache_path

F = TypeVar("F", bound=Callable[..., object])
KEPT = 8
"""Number of versions of the package whose caches stay on disk."""
PARTS = ("core", "machine", "terrain", "tyres", "plants", "control")
"""Parts of the package with kernels, and what kernels take constants from."""
MAKES_KERNELS = b"agrobot_mj.core.kernels import"
"""What stands in a file of another part that compiles something; the rest of that part is left out."""


def _content() -> str:
    """Hex digest of the sources from which kernels are made."""
    digest, package = hashlib.sha256(), Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        text = path.read_bytes()
        if path.relative_to(package).parts[0] in PARTS or MAKES_KERNELS in text:
            digest.update(text)
    return digest.hexdigest()[:16]


def _cache() -> Path | None:
    """The folder for compiled kernels, or None where nothing can be written."""
    home = user_cache_path("agrobot_mj") / "kernels"
    folder = home / _content()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = sorted(home.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    except OSError:
        return None
    for old in others[KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


CACHE = None if config.DISABLE_JIT else _cache()
if "NUMBA_OPT" not in os.environ:
    config.OPT = type(config.OPT)(2)  # as fast as level 3, which takes twice as long to compile: it copies whole loops


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


class _PackageCache(FunctionCache):  # type: ignore[misc]
    """Keeps no code for records of classes from outside, which may change, and which other processes do not have."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return None if _outside(sig) else super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        if not _outside(sig):
            super().save_overload(sig, data)


def _outside(parts: Iterable[Any]) -> bool:
    """Whether among these types is, at any depth, a named tuple of a class from outside the package."""
    classes = (getattr(part, "instance_class", _PackageCache) for part in parts)
    return not all(map(_is_ours, classes)) or any(_outside(getattr(part, "types", ())) for part in parts)


def _is_ours(code: Any) -> bool:
    return str(code.__module__).startswith("agrobot_mj.")


def _compiled(function: F, **options: object) -> F:
    compiled = njit(nogil=True, **options)(function)
    before = config.CACHE_DIR
    if CACHE is not None and not config.DISABLE_JIT and _is_ours(function):
        try:
            config.CACHE_DIR = str(CACHE)
            compiled._cache = _PackageCache(function)
        finally:
            config.CACHE_DIR = before
    return cast(F, compiled)
