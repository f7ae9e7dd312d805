"""The files of a machine's own body, looked at before MuJoCo opens them.

A body is an MJCF file with what it includes and the meshes and textures that it names, all in one folder: a run copies
them beside its `scenario.toml`.
"""

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from agrobot_mj.core.resources import checked, refuse

MOST_BYTES, MOST_ASSET_BYTES, MOST_FILES = 5_000_000, 50_000_000, 500
"""Largest MJCF file and asset [bytes], and most files in all."""
FOLDERS = {"assetdir", "meshdir", "texturedir"}
"""Attributes of `compiler` that name folders of assets."""
NOT_OURS = {"plugin", "extension", "flexcomp", "flex", "composite", "skin", "deformable"}
"""Elements that a body may not have: other programs' code, and what is not rigid."""


class OwnFiles(NamedTuple):
    """Files of a body."""

    main: Path
    """The MJCF file."""
    others: tuple[Path, ...]
    """What it includes and names, each once, resolved."""


def own_files(name: str) -> OwnFiles:
    """The files of the body `name`. Raises ValueError, a line for each fault of the files."""
    main = checked(name, (".xml", ".mjcf"), MOST_BYTES)
    reader = _Reader(main)
    reader.read(main)
    if reader.faults:
        raise ValueError("\n".join(f"{main.name}: {fault}" for fault in dict.fromkeys(reader.faults)))
    return OwnFiles(main, tuple(reader.others))


class _Reader:
    """Goes through a file and what it includes."""

    def __init__(self, main: Path) -> None:
        self.main = main
        self.others: dict[Path, None] = {}
        self.faults: list[str] = []

    def read(self, path: Path) -> None:
        """Take in one MJCF file, which is a regular one of sensible size."""
        for element in _elements(path):
            tag, given = element.tag, element.attrib
            if tag in NOT_OURS:
                self.faults.append(f"<{tag}>: a body is of rigid parts and needs no plugins; take it out")
            self.faults += [f"<{tag} {key}>: must be finite numbers" for key in _not_finite(given)]
            if tag == "compiler":
                self.faults += [
                    f"<compiler {key}>: all files lie beside the body; leave it out" for key in FOLDERS & set(given)
                ]
                if "settotalmass" in given:
                    self.faults.append("<compiler settotalmass>: give the bodies' own masses instead")
            for key in (key for key in given if key.startswith("file")):
                included = self._take(given[key], MOST_BYTES if tag == "include" else MOST_ASSET_BYTES)
                if included and tag == "include":
                    self.read(included)

    def _take(self, name: str, most_bytes: int) -> Path | None:
        """A file beside the body; None, and a fault, where there is none, and for one that is known."""
        if "/" in name or "\\" in name or name in ("", ".", ".."):
            self.faults.append(f"{name!r}: must lie in the folder of the body, and be named without a path")
            return None
        path = checked(str(self.main.parent / name), (), most_bytes)
        if path in self.others:
            return None
        self.others[path] = None
        if len(self.others) > MOST_FILES:
            refuse(self.main, f"names more than {MOST_FILES} files; join some of them")
        return path


def _elements(path: Path) -> Iterator[ElementTree.Element]:
    """Every element of an XML file. Raises ValueError where it is none of MuJoCo's."""
    data = path.read_bytes()
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        refuse(path, "has a document type of its own; MJCF has none, take it out")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        refuse(path, f"is not XML: {error}")
    if root.tag not in ("mujoco", "mujocoinclude"):
        refuse(path, f"begins with <{root.tag[:40]}>; an MJCF file begins with <mujoco>")
    yield from root.iter()


def _not_finite(given: dict[str, str]) -> Iterator[str]:
    """Names of attributes that hold numbers, some of them not finite."""
    for key, text in given.items():
        try:
            values = [float(word) for word in text.split()] if key not in ("name", "class") else []
        except ValueError:
            continue
        if not all(isfinite(value) for value in values):
            yield key
