"""Files of a user-defined body, checked before MuJoCo reads them.

A body is an MJCF file with its included files, attached models, meshes and textures in one folder. A run copies these
files to the folder of its `scenario.toml`.
"""

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

from agrobot_mj.core.resources import checked_path, refuse

MOST_BYTES, MOST_ASSET_BYTES, MOST_FILES = 5_000_000, 50_000_000, 500
"""Maximum size of an MJCF file [bytes], maximum size of an asset [bytes], and maximum number of files."""
MOST_ELEMENTS = 20_000  # Maximum number of elements of a body after expanding replicates and attached models [-]
LARGEST = 5_000  # Maximum value of an attribute that determines memory allocated by MuJoCo [-]
SIZES = {"count", "height", "ncol", "nkey", "nrow", "width"}
"""Attributes that determine the memory allocated by MuJoCo, in addition to attributes with the prefix `nuser_`."""
FOLDERS = {"assetdir", "meshdir", "texturedir"}  # Attributes of `compiler` that contain names of asset folders
NOT_OURS = {"plugin", "extension", "flexcomp", "flex", "composite", "skin", "deformable"}
"""MJCF elements that a body must not contain: plugins and deformable bodies."""


class OwnFiles(NamedTuple):
    """Files of a user-defined body."""

    main: Path
    others: tuple[Path, ...]  # Resolved paths of all included and referenced files, without duplicates


def own_files(name: str) -> OwnFiles:
    """Return the files of the user-defined body `name`. Raises ValueError with one line per error."""
    main = checked_path(name, (".xml", ".mjcf"), MOST_BYTES)
    reader = _Reader(main)
    if reader.model(main) > MOST_ELEMENTS:
        reader.faults.append(f"there are more than {MOST_ELEMENTS} elements with replicates and attached models")
    if reader.faults:
        raise ValueError("\n".join(f"{main.name}: {fault}" for fault in dict.fromkeys(reader.faults)))
    return OwnFiles(main, tuple(reader.others))


class _Element(NamedTuple):
    """XML element with tag and attributes, without namespaces (MuJoCo ignores namespaces)."""

    tag: str
    given: dict[str, str]
    copies: int  # Number of copies of the element: product of the counts of the enclosing `replicate` elements


class _Size:
    """Number of elements of a model with its included files, number of attached models, and size of the largest
    model."""

    def __init__(self) -> None:
        self.elements, self.attached, self.largest = 0, 0, 0

    @property
    def expanded(self) -> int:
        """Upper limit of the number of elements, assuming that all attached models are as large as the largest attached
        model."""
        return self.elements + self.attached * self.largest


class _Reader:
    """Reader that checks an MJCF model with its included files and attached models."""

    def __init__(self, main: Path) -> None:
        self.main = main
        self.others: dict[Path, None] = {}
        self.faults: list[str] = []
        self._open: list[Path] = []
        self._sizes: dict[Path, int] = {}

    def model(self, path: Path) -> int:
        """Read a model file, record its errors and files, and return the number of its elements after expansion."""
        if path not in self._sizes:
            size = _Size()
            self._read(path, size)
            self._sizes[path] = size.expanded
        return self._sizes[path]

    def _read(self, path: Path, size: _Size) -> None:
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
        if "/" in name or "\\" in name or name in ("", ".", ".."):
            self.faults.append(f"{name!r}: must be in the folder of the body and named without a path")
            return None
        path = checked_path(str(self.main.parent / name), (), most_bytes)
        if path in self._open:
            refuse(path, "the file includes or attaches itself; remove the reference")
        self.others[path] = None
        if len(self.others) > MOST_FILES:
            refuse(self.main, f"the body uses more than {MOST_FILES} files; merge some of them")
        return path


def _faults(tag: str, given: dict[str, str]) -> Iterator[str]:
    if tag in NOT_OURS:
        yield f"<{tag}>: plugins are not supported in a body; remove the element"
    for key, text in given.items():
        numbers = _numbers(text) if key not in ("name", "class") else []
        if not all(map(isfinite, numbers)):
            yield f"<{tag} {key}>: must be finite numbers"
        elif (key in SIZES or key.startswith("nuser_")) and any(number > LARGEST for number in numbers):
            yield f"<{tag} {key}>: must be at most {LARGEST}"
    if tag == "compiler":
        yield from (f"<compiler {key}>: all files must be next to the body; omit it" for key in FOLDERS & set(given))
        if "settotalmass" in given:
            yield "<compiler settotalmass>: not supported; set the masses of the bodies instead"


def _elements(path: Path) -> list[_Element]:
    found, replicates = list[_Element](), list[int]()

    def begin(tag: str, given: dict[str, str]) -> None:
        if not found and tag not in ("mujoco", "mujocoinclude"):
            refuse(path, f"the file begins with <{tag[:40]}>, but an MJCF file begins with <mujoco>")
        copies = replicates[-1] if replicates else 1
        found.append(_Element(tag, given, copies))
        if tag == "replicate":
            numbers = [number for number in _numbers(given.get("count", "")) if isfinite(number)]
            replicates.append(min(MOST_ELEMENTS + 1, copies * max(1, *map(int, numbers), 1)))

    def end(tag: str) -> None:
        if tag == "replicate":
            replicates.pop()

    def document_type(*_: Any) -> None:
        refuse(path, "the file declares a document type, which MJCF does not use; remove the declaration")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        refuse(path, f"the file is not valid XML: {error}")
    return found


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []
