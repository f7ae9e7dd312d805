"""Identity of a run: digests of all that its numbers come from.

As text five parts of eight hex digits, "scenario-files-plugins-program-libraries", so that two texts show which part
differs. The last three are the code. Contents count, names of folders do not: what is moved keeps its identity.

Plugins are the files that `take_in` was given, and what these import from outside the libraries of Python: of a package
all its files. Data that they open by themselves elsewhere are not seen.
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
"""Libraries that compute numbers of a run."""
PARTS = (
    *("core", "machine", "terrain", "tyres", "plants", "sensors", "estimation", "paths", "control", "faults"),
    *("scenario", "metrics", "simulation"),
)
"""Parts of the package that the numbers of a run come from."""
PACKAGE = Path(__file__).parents[1]
NONE = "00000000"
"""Digest of nothing."""
_plugins: dict[Path, str] = {}
"""Digest of each file of plugins when it was loaded."""


class Identity(NamedTuple):
    """Digests by part."""

    scenario: str
    """What the scenario says, resolved: machine files and gains are in it."""
    files: str
    """Files that it names."""
    plugins: str
    program: str
    """Sources and models of the package."""
    libraries: str
    """Versions of libraries."""

    def __str__(self) -> str:
        return "-".join(self)

    @property
    def code(self) -> str:
        """The parts that say what code was run, as text."""
        return "-".join(self[2:])


def code() -> tuple[str, str, str]:
    """Digests of plugins, program and libraries, as this process has loaded them."""
    return joined(sorted(set(_plugins.values()))), PROGRAM, libraries()


def code_text() -> str:
    """`code` as text."""
    return "-".join(code())


def read_identity(text: object) -> Identity | None:
    """An identity from its text; None where it is none."""
    parts = text.split("-") if isinstance(text, str) else []
    return Identity(*parts) if len(parts) == len(Identity._fields) else None


def differing(text: object, other: str) -> list[str]:
    """Names of the parts in which the text of an identity, or of code, differs from another; [""] if it is none.

    The texts are compared from their ends: code has no scenario and no files.
    """
    names, one, two = Identity._fields[::-1], str(text).split("-")[::-1], other.split("-")[::-1]
    if len(one) < len(two):
        return [""]
    return [name for name, a, b in zip(names, one, two, strict=False) if a != b][::-1]


def digest(*contents: bytes, digits: int = len(NONE)) -> str:
    """Hex digits of some contents, in their order; zeros of none."""
    whole = hashlib.sha256(b"".join(hashlib.sha256(content).digest() for content in contents))
    return whole.hexdigest()[:digits] if contents else "0" * digits


def joined(digests: Iterable[str]) -> str:
    """The digest of some digests."""
    return digest(*map(str.encode, digests))


def file_digest(path: Path) -> str:
    """The digest of a file's present content; `NONE` where it cannot be read."""
    return _file_digest(path, stamp(str(path)))


@lru_cache(maxsize=4096)
def _file_digest(path: Path, _stamp: object) -> str:
    try:
        return digest(path.read_bytes())
    except OSError:
        return NONE


@cache
def libraries() -> str:
    """The digest of the versions of `LIBRARIES`."""
    return digest(*(f"{name} {_version(name)}".encode() for name in LIBRARIES))


def _version(name: str) -> str:
    """Version of an installed library; of its `metadata.version`, which takes milliseconds, only the line is read."""
    try:
        text = distribution(name).read_text("METADATA") or ""
    except PackageNotFoundError:
        return "absent"
    return next((line for line in text.splitlines() if line.startswith("Version:")), "unknown")


def program_digest(parts: Iterable[str] = PARTS) -> str:
    """The digest of the sources and models that make the numbers of a run, or of a result of further `parts`."""
    with_kinds = sorted(path.parent for path in PACKAGE.glob("extensions/*/kinds.py"))
    places = [*(PACKAGE / part for part in parts), *with_kinds]
    found = [path for place in places for path in sorted(place.rglob("*.py"))]
    return digest(*(path.read_bytes() for path in (*found, *sorted(MODELS.glob("*.xml")))))


PROGRAM = program_digest()
"""Digest of the sources as they were when this process began."""


def take_in(name: str, member: type | None = None) -> None:
    """Note the files of a module that is loaded, and of those that it imports, as part of the plugins' identity.

    Of a `member` that was typed in, say into a notebook, its compiled code.
    """
    if member and not _place(name):
        functions = (getattr(part, "__code__", None) for part in vars(member).values())
        codes = [marshal.dumps(function, 2) for function in functions if function]
        _plugins[Path(f"<{member.__qualname__}>")] = digest(*codes)
    _take_in(_files_of(name, True))


@contextmanager
def taking_in_imports() -> Iterator[None]:
    """Take in the modules that the block is the first to import, by whatever means."""
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
                todo += [file for each in _imported(content) for file in _files_of(each, False)]
                todo += _imported_beside(path, content)


def _files_of(name: str, installed: bool) -> list[Path]:
    """Files of a module: of one in a package, all files of the package.

    None of those that come with Python, of this package, and of `installed` ones unless these are asked for.
    """
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
    """The file of a module, without importing it."""
    if name in sys.modules:
        place = getattr(sys.modules[name], "__file__", None)
    else:
        try:
            spec = find_spec(name)
        except (ImportError, ValueError):
            return None
        place = spec.origin if spec and spec.has_location else None
    return Path(place).resolve() if place else None


def _imported(content: bytes) -> Iterator[str]:
    """Names of the modules that a source imports, wherever in it, without those relative to its own package."""
    for node in ast.walk(_tree(content)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _imported_beside(path: Path, content: bytes) -> Iterator[Path]:
    """Files of the modules that a source imports relative to its own package."""
    for node in ast.walk(_tree(content)):
        if isinstance(node, ast.ImportFrom) and node.level:
            module = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for place in (module, *(module / alias.name for alias in node.names)):
                yield from (file for file in (place.with_suffix(".py"), place / "__init__.py") if file.is_file())


@lru_cache(maxsize=1)
def _tree(content: bytes) -> ast.Module:
    try:
        return ast.parse(content)
    except (SyntaxError, ValueError):
        return ast.Module([], [])
