"""Identity of a run: digests of all inputs that affect its results.

The text of an identity consists of five parts with eight hex digits, "scenario-files-plugins-program-libraries". A
comparison of two texts shows the differing parts. The last three parts identify the code. Digests depend on file
contents, not on folder names, so that moved results keep their identity.

The plugins part covers the modules passed to `take_in`, and the files that they import from outside the installed
libraries. All files of an imported package are included. Data files that plugins open in other folders are not
included.
"""

import ast
import hashlib
import marshal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from agrobot_mj.core.resources import MODELS, stamp

LIBRARIES = ("mujoco", "numba", "llvmlite", "numpy", "scipy", "filterpy", "casadi")
"""Libraries that affect the results of a run."""
PARTS = (
    *("core", "machine", "terrain", "tyres", "plants", "sensors", "estimation", "paths", "control", "faults"),
    *("scenario", "metrics", "simulation"),
)
"""Folders of the package that affect the results of a run."""
PACKAGE = Path(__file__).parents[1]
NONE = "00000000"  # Digest of missing content, such as an unreadable file
_plugins: dict[Path, str] = {}  # Digest of each plugin file at the time when the plugin was loaded


class Identity(NamedTuple):
    """Digests of the five parts that identify a run."""

    scenario: str  # Digest of the resolved scenario, including machine files and gains
    files: str
    plugins: str
    program: str
    libraries: str

    def __str__(self) -> str:
        return "-".join(self)

    @property
    def code(self) -> str:
        """Digests of the plugins, the program and the libraries, joined by dashes."""
        return "-".join(self[2:])


def code() -> tuple[str, str, str]:
    """Return three digests: of the loaded plugins, of this package, and of the installed libraries."""
    return joint_digest(sorted(set(_plugins.values()))), PROGRAM, libraries()


def code_text() -> str:
    """Return the digests of plugins, program and libraries as one text separated by dashes, like `Identity.code`."""
    return "-".join(code())


def read_identity(text: object) -> Identity | None:
    """Return the run identity parsed from its text, or None unless the text has five parts."""
    parts = text.split("-") if isinstance(text, str) else []
    return Identity(*parts) if len(parts) == len(Identity._fields) else None


def differing(text: object, other: str) -> list[str]:
    """Return the names of the parts in which two identity texts differ, or [""] if `text` has fewer parts than
    `other`."""
    names, one, two = Identity._fields[::-1], str(text).split("-")[::-1], other.split("-")[::-1]
    if len(one) < len(two):
        return [""]
    return [name for name, a, b in zip(names, one, two, strict=False) if a != b][::-1]


def digest(*contents: bytes, digits: int = len(NONE)) -> str:
    """Return a hex digest of byte strings in the given order, with `digits` digits; zeros if there are no byte
    strings."""
    whole = hashlib.sha256(b"".join(hashlib.sha256(content).digest() for content in contents))
    return whole.hexdigest()[:digits] if contents else "0" * digits


def joint_digest(digests: Iterable[str]) -> str:
    """Return one digest that combines a sequence of digests."""
    return digest(*map(str.encode, digests))


def file_digest(path: Path) -> str:
    """Return the digest of the current content of a file, or `NONE` if the file cannot be read."""
    return _file_digest(path, stamp(str(path)))


@lru_cache(maxsize=4096)
def _file_digest(path: Path, _stamp: object) -> str:
    try:
        return digest(path.read_bytes())
    except OSError:
        return NONE


@cache
def libraries() -> str:
    """Return one digest of the installed versions of `LIBRARIES`."""
    return digest(*(f"{name} {_version(name)}".encode() for name in LIBRARIES))


def _version(name: str) -> str:
    try:
        text = distribution(name).read_text("METADATA") or ""
    except PackageNotFoundError:
        return "absent"
    return next((line for line in text.splitlines() if line.startswith("Version:")), "unknown")


def program_digest(parts: Iterable[str] = PARTS) -> str:
    """Return one digest of the MJCF models, of the source folders `parts`, and of the extensions that add model
    kinds."""
    with_kinds = sorted(path.parent for path in PACKAGE.glob("extensions/*/kinds.py"))
    places = [*(PACKAGE / part for part in parts), *with_kinds]
    found = [path for place in places for path in sorted(place.rglob("*.py"))]
    return digest(*(path.read_bytes() for path in (*found, *sorted(MODELS.glob("*.xml")))))


PROGRAM = program_digest()  # Digest of the sources at the start of this process


def take_in(name: str, member: type | None = None) -> None:
    """Add the files of a loaded module, and of the modules that it imports, to the plugins part of the run identity.

    For a class `member` defined interactively, for example in a notebook, the bytecode of its methods is added.
    """
    if member and not _place(name):
        functions = (getattr(part, "__code__", None) for part in vars(member).values())
        codes = [marshal.dumps(function, 2) for function in functions if function]
        _plugins[Path(f"<{member.__qualname__}>")] = digest(*codes)
    _take_in(_files_of(name, True))


@contextmanager
def taking_in_imports() -> Iterator[None]:
    """Add the modules that are first imported within the block to the plugins part of the run identity."""
    before = set(sys.modules)
    yield
    for name in sys.modules.keys() - before:
        _take_in(_files_of(name, False))


def _take_in(paths: Iterable[Path]) -> None:
    todo = list(paths)
    while todo:
        if (path := todo.pop()) not in _plugins:
            content = path.read_bytes()
            _plugins[path] = digest(content)
            if path.suffix == ".py":
                todo += _imported_files(path, content)


def _files_of(name: str, installed: bool) -> list[Path]:
    """Return the file of a module, or all files of its package; empty for modules of Python and of this package.
    Installed libraries are omitted unless `installed` is true."""
    parts = name.split(".")
    if parts[0] in sys.stdlib_module_names or parts[0] == PACKAGE.name:
        return []
    names = (".".join(parts[: k + 1]) for k in range(len(parts)))
    place = next((place for each in names if (place := _place(each))), None)
    if place is None or (not installed and {"site-packages", "dist-packages"} & set(place.parts)):
        return []
    if place.name != "__init__.py":
        return [place]
    return sorted(path for path in place.parent.rglob("*") if path.is_file() and path.suffix != ".pyc")


def _place(name: str) -> Path | None:
    if name in sys.modules:
        place = getattr(sys.modules[name], "__file__", None)
    else:
        try:
            spec = find_spec(name)
        except (ImportError, ValueError):
            return None
        place = spec.origin if spec and spec.has_location else None
    return Path(place).resolve() if place else None


def _imported_files(path: Path, content: bytes) -> Iterator[Path]:
    """Yield the files of the modules that a source file imports."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (file for alias in node.names for file in _files_of(alias.name, False))
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield from (file for alias in node.names for file in _files_of(f"{node.module}.{alias.name}", False))
        elif isinstance(node, ast.ImportFrom):
            module = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for place in (module, *(module / alias.name for alias in node.names)):
                yield from (file for file in (place.with_suffix(".py"), place / "__init__.py") if file.is_file())
