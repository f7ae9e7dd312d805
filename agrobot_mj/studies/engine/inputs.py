"""Copies of scenario input files in the results folder. Runs read the copies.

A copy is stored with its related files in a folder named after their content, so that it is never overwritten. Changes
of the original files during a study have no effect.
"""

from collections.abc import Callable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from agrobot_mj.core.identity import digest, file_digest
from agrobot_mj.core.resources import library_file, machine_files
from agrobot_mj.scenario.overrides import beside, machine_data, naming_files

INPUTS = "inputs"


class Held(NamedTuple):
    """Scenario data with the paths and digests of its copied files."""

    driven: dict[str, Any]
    """Data with paths of the copies."""
    said: dict[str, Any]
    """Data with file names only."""
    files: tuple[str, ...]
    """Digests of the files."""


class InputCopies:
    """Input copies of one results folder. Each file is read once."""

    def __init__(self, folder: Path, write: Callable[[Path, bytes], None]) -> None:
        self.folder, self.write = folder.absolute(), write
        self._copies: dict[tuple[str, Path], Path] = {}

    def held(self, data: Mapping[str, Any]) -> Held:
        """Return plain data with paths of copies. An unreadable file keeps its path; the run reports the error."""
        driven, said, found = deepcopy(dict(data)), deepcopy(dict(data)), list[str]()
        for (table, key), (other, _) in zip(list(naming_files(driven)), list(naming_files(said)), strict=True):
            try:
                copy = self._copy(key, library_file(table[key]))
            except OSError:
                continue
            table[key], other[key] = str(copy), copy.name
            found.append(copy.parent.name)
        if shipped := machine_files().get(str(data["machine"])) if "machine" in data else None:
            found.append(file_digest(shipped))
        return Held(driven, said, tuple(found))

    def _copy(self, key: str, path: Path) -> Path:
        if (key, path) not in self._copies:
            contents = {path.name: self._content(key, path)}
            if key != "machine":  # the files of a machine are copied separately
                contents |= {other.name: other.read_bytes() for other in beside(key, path)}
            parts = (part for name in sorted(contents) for part in (name.encode(), contents[name]))
            place = Path(INPUTS, digest(*parts))
            for name, content in contents.items():
                file = self.folder / place / name
                if not file.is_file() or file.read_bytes() != content:
                    self.write(place / name, content)
            self._copies[key, path] = self.folder / place / path.name
        return self._copies[key, path]

    def _content(self, key: str, path: Path) -> bytes:
        """Return the content of a file; in a machine file, paths are replaced by paths of copies."""
        if key != "machine":
            return path.read_bytes()
        held = self.held(machine_data(path))
        if not held.files:
            return path.read_bytes()
        for table, each in naming_files(held.driven):
            copy = Path(table[each])
            table[each] = f"../{copy.parent.name}/{copy.name}"
        return tomli_w.dumps(held.driven).encode()
