"""Files of a user-defined body, checked before MuJoCo opens them.

A body is an MJCF file with its included files, attached models, and their meshes and textures, in one folder. A run
copies them next to its `scenario.toml`.
"""

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

from agrobot_mj.core.resources import checked, refuse

MOST_BYTES, MOST_ASSET_BYTES, MOST_FILES = 5_000_000, 50_000_000, 500
"""Maximum size of an MJCF file and of an asset [bytes], and maximum number of files."""
MOST_ELEMENTS = 20_000
"""Maximum number of elements of a body after its replicates and attached models are expanded [-]."""
LARGEST = 5_000
"""Maximum value of an attribute by which MuJoCo allocates memory [-]."""
SIZES = {"count", "height", "ncol", "nkey", "nrow", "width"}
"""Names of size attributes, in addition to those that begin with `nuser_`."""
FOLDERS = {"assetdir", "meshdir", "texturedir"}
"""Attributes of `compiler` that name folders of assets."""
NOT_OURS = {"plugin", "extension", "flexcomp", "flex", "composite", "skin", "deformable"}
"""Elements that a body must not contain: plugins and elements that are not rigid."""


class OwnFiles(NamedTuple):
    """Files of a body."""

    main: Path
    """The MJCF file."""
    others: tuple[Path, ...]
    """Included and named files, each once, resolved."""


def own_files(name: str) -> OwnFiles:
    """Return the files of the body `name`. Raises ValueError, a line for each fault of the files."""
    main = checked(name, (".xml", ".mjcf"), MOST_BYTES)
    reader = _Reader(main)
    if reader.model(main) > MOST_ELEMENTS:
        reader.faults.append(f"has more than {MOST_ELEMENTS} elements with its replicates and attached models expanded")
    if reader.faults:
        raise ValueError("\n".join(f"{main.name}: {fault}" for fault in dict.fromkeys(reader.faults)))
    return OwnFiles(main, tuple(reader.others))


class _Element(NamedTuple):
    """An element of an XML file, by the names that MuJoCo sees: it knows no namespaces."""

    tag: str
    given: dict[str, str]
    copies: int
    """Product of the counts of the replicates around the element."""


class _Size:
    """Size of a model with its includes."""

    def __init__(self) -> None:
        self.elements, self.attached, self.largest = 0, 0, 0

    @property
    def expanded(self) -> int:
        """Number of elements, each attached model counted as the maximum one."""
        return self.elements + self.attached * self.largest


class _Reader:
    """Reader of a model, its included files, and its attached models."""

    def __init__(self, main: Path) -> None:
        self.main = main
        self.others: dict[Path, None] = {}
        self.faults: list[str] = []
        self._open: list[Path] = []
        self._sizes: dict[Path, int] = {}

    def model(self, path: Path) -> int:
        """Take in the file of a model; returns its number of elements, expanded."""
        if path not in self._sizes:
            size = _Size()
            self._read(path, size)
            self._sizes[path] = size.expanded
        return self._sizes[path]

    def _read(self, path: Path, size: _Size) -> None:
        """Take in one MJCF file, which is a regular one of sensible size."""
        self._open.append(path)
        for tag, given, copies in _elements(path):
            self.faults += _faults(tag, given)
            size.elements += copies
            size.attached += copies * (tag == "attach")
            for key in (key for key in given if key.startswith("file")):
                named = self._take(given[key], MOST_BYTES if tag in ("include", "model") else MOST_ASSET_BYTES)
                if named and tag == "include":
                    self._read(named, size)
                elif named and tag == "model":
                    size.largest = max(size.largest, self.model(named))
        self._open.pop()

    def _take(self, name: str, most_bytes: int) -> Path | None:
        """Return a file in the folder of the body; None, and an error message, if its name is a path."""
        if "/" in name or "\\" in name or name in ("", ".", ".."):
            self.faults.append(f"{name!r}: must lie in the folder of the body, and be named without a path")
            return None
        path = checked(str(self.main.parent / name), (), most_bytes)
        if path in self._open:
            refuse(path, "includes or attaches itself; take that out")
        self.others[path] = None
        if len(self.others) > MOST_FILES:
            refuse(self.main, f"names more than {MOST_FILES} files; join some of them")
        return path


def _faults(tag: str, given: dict[str, str]) -> Iterator[str]:
    """Yield messages about attributes that an element of a body must not have."""
    if tag in NOT_OURS:
        yield f"<{tag}>: a body is of rigid parts and needs no plugins; take it out"
    for key, text in given.items():
        numbers = _numbers(text) if key not in ("name", "class") else []
        if not all(map(isfinite, numbers)):
            yield f"<{tag} {key}>: must be finite numbers"
        elif (key in SIZES or key.startswith("nuser_")) and any(number > LARGEST for number in numbers):
            yield f"<{tag} {key}>: must be at most {LARGEST}"
    if tag == "compiler":
        yield from (f"<compiler {key}>: all files lie beside the body; leave it out" for key in FOLDERS & set(given))
        if "settotalmass" in given:
            yield "<compiler settotalmass>: give the bodies' own masses instead"


def _elements(path: Path) -> list[_Element]:
    """Return every element of an XML file. Raises ValueError for a file that is not MJCF."""
    found, replicates = list[_Element](), list[int]()

    def begin(tag: str, given: dict[str, str]) -> None:
        if not found and tag not in ("mujoco", "mujocoinclude"):
            refuse(path, f"begins with <{tag[:40]}>; an MJCF file begins with <mujoco>")
        copies = replicates[-1] if replicates else 1
        found.append(_Element(tag, given, copies))
        if tag == "replicate":
            numbers = [number for number in _numbers(given.get("count", "")) if isfinite(number)]
            replicates.append(min(MOST_ELEMENTS + 1, copies * max(1, *map(int, numbers), 1)))

    def end(tag: str) -> None:
        if tag == "replicate":
            replicates.pop()

    def document_type(*_: Any) -> None:
        refuse(path, "has a document type of its own; MJCF has none, take it out")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        refuse(path, f"is not XML: {error}")
    return found


def _numbers(text: str) -> list[float]:
    """Return the numbers of an attribute; empty for a text."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []
