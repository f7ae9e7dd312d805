"""Disk cache of compiled kernels.

Numba checks only the file of a cached function for changes, not the files of called functions. Therefore the name of
the cache folder is a digest of all package files with kernels, so that outdated code is never loaded. Code compiled for
classes outside the package is not cached. Each cache file ends with a checksum of its name and content. A damaged file
is deleted with a message, and its kernel is compiled again.
"""

import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import config
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime import rtsys
from platformdirs import user_cache_path

from agrobot_mj.core.locks import acquire_lock

KEPT = 8  # Maximum number of package versions whose caches are kept on disk
PARTS = ("core", "machine", "terrain", "tyres", "plants", "control", "estimation", "paths")
"""Package folders with kernels, or with constants used by kernels."""
MAKES_KERNELS = b"agrobot_mj.core.kernels import"  # Text that identifies files with kernels outside `PARTS`
PATIENCE_S = 120.0  # Maximum time to wait for another process that compiles the same function [s]
CHECKSUM = 4  # Length of the checksum [bytes]


def _content() -> str:
    digest, package = hashlib.sha256(), Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        text = path.read_bytes()
        if path.relative_to(package).parts[0] in PARTS or MAKES_KERNELS in text:
            digest.update(text)
    return digest.hexdigest()[:16]


def _cache() -> Path | None:
    """Return the cache folder of this package version, created if missing; None on a file error. Delete old caches."""
    home = _home()
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


def _home() -> Path:
    """Return the parent folder of all caches, in the user's cache folder or, without a home, in a temporary folder."""
    try:
        return user_cache_path("agrobot_mj") / "kernels"
    except (RuntimeError, KeyError):  # no HOME and no entry in the password file
        return _private(Path(tempfile.gettempdir()) / f"agrobot_mj-{os.getuid()}") / "kernels"


def _private(folder: Path) -> Path:
    """Return a folder, created if missing, or the null device if the folder is owned or accessible by other users."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return folder
    ours = status.st_uid == os.getuid() and not status.st_mode & 0o077 and stat.S_ISDIR(status.st_mode)
    return folder if ours else Path(os.devnull)


CACHE = None if config.DISABLE_JIT else _cache()


class _DamagedError(Exception):
    """Error for a cache file with a wrong checksum."""


class _CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """Cache files of a function (index and compiled code), each with a checksum."""

    def _dump(self, value: object) -> bytes:
        return bytes(super()._dump(value))

    def _load_index(self) -> Any:
        content = self._content(self._index_path)
        if content is None:
            return {}
        version, stamp, overloads = pickle.loads(content)
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        content = self._content(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, value: object) -> None:
        content = self._dump(value)
        with self._open_for_write(path) as file:
            file.write(content + _checksum(path, content))

    def _content(self, path: str) -> bytes | None:
        """Return the content of a file without its checksum, or None for a missing file. Raises `_DamagedError` for a
        wrong checksum."""
        try:
            found = Path(path).read_bytes()
        except FileNotFoundError:
            return None
        content, written = found[:-CHECKSUM], found[-CHECKSUM:]
        if written != _checksum(path, content):
            raise _DamagedError(path)
        return content


def _checksum(path: str, content: bytes) -> bytes:
    return zlib.crc32(content, zlib.crc32(Path(path).name.encode())).to_bytes(CHECKSUM, "little")


class PackageCache(FunctionCache):  # type: ignore[misc]
    """Kernel cache that excludes code compiled for classes outside the package, because these classes may change."""

    def __init__(self, function: Any, called_by_kernels: bool = False) -> None:
        before = config.CACHE_DIR
        try:
            config.CACHE_DIR = str(CACHE)
            super().__init__(function)
        finally:
            config.CACHE_DIR = before
        file: Any = self._cache_file
        base = file._index_name.removesuffix(".nbi") + ".inner" * called_by_kernels
        self._called_by_kernels = called_by_kernels
        self._cache_file: Any = _CheckedFile(file._cache_path, base, file._source_stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for the argument types `sig`, or None if the cache does not contain the code.

        Unlike numba's method, this method does not import numba's registries; their import takes 0.2 s.
        """
        rtsys.initialize(target_context)
        load = self._load_overload
        return None if _outside(sig) else self._intact(lambda: load(sig, target_context))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled code for the argument types `sig`, unless they include classes outside the package."""
        save = super().save_overload
        if not _outside(sig):
            if not self._called_by_kernels:
                data.library.discard_llvm_code()
            self._intact(lambda: save(sig, data))

    def _intact(self, work: Callable[[], Any]) -> Any:
        """Return the result of a cache access, or None on a disk error. Damaged files are deleted before a second
        access."""
        try:
            return work()
        except _DamagedError:
            self._discard()
            return work()
        except OSError:
            return None

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Lock an uncached function while it is compiled, so that other processes wait for the compiled code."""
        handle, index = None, Path(self._cache_file._index_path)
        if not index.exists():
            with suppress(OSError):
                (lock := index.with_suffix(".lock")).touch()
                handle = acquire_lock(lock, PATIENCE_S)
        try:
            yield
        finally:
            if handle is not None:
                os.close(handle)

    def _discard(self) -> None:
        for file in Path(self._cache_path).glob(f"{self._impl.filename_base}.*nb[ic]"):
            file.unlink(missing_ok=True)
        _tell()


@cache
def _tell() -> None:
    print(f"{CACHE}: damaged compiled kernels are discarded and compiled again", file=sys.stderr)


def _outside(parts: Iterable[Any]) -> bool:
    """Return whether the numba types `parts` contain, at any depth, a named tuple class defined outside the package."""
    classes = (getattr(part, "instance_class", PackageCache) for part in parts)
    return not all(map(is_ours, classes)) or any(_outside(getattr(part, "types", ())) for part in parts)


def is_ours(code: Any) -> bool:
    """Return whether a class or function is defined in this package."""
    return str(code.__module__).startswith("agrobot_mj.")
