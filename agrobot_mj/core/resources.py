"""Paths of the data files of the package, and checks of files named in a scenario before they are opened.

The folders `models/` and `scenarios/` are inside the package in an installed wheel, otherwise next to the package.
"""

import zipfile
import zlib
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import EntryPoint, entry_points
from lzma import LZMAError
from pathlib import Path
from typing import Literal, NoReturn

_PACKAGE = Path(__file__).parents[1]


def resource_dir(name: str) -> Path:
    """Return the path of the data folder `name` of the package ("models" or "scenarios")."""
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


MODELS = resource_dir("models")
SCENARIOS = resource_dir("scenarios")


def is_file(path: Path) -> bool:
    """Return whether a path is an existing file; False for invalid names, for example names that are too long."""
    try:
        return path.is_file()
    except OSError:
        return False


def library_file(name: str) -> Path:
    """Return the path of a data file named in a scenario. A file of this name shipped with the package takes
    precedence."""
    given, shipped = Path(name), SCENARIOS / name
    return shipped if not given.is_absolute() and is_file(shipped) else given


def scenario_files() -> dict[str, Path]:
    """Return the paths of the scenario files shipped with the package, by scenario name."""
    return {path.stem: path for path in sorted(SCENARIOS.glob("*.toml"))}


def sweep_files() -> dict[str, Path]:
    """Return the paths of the sweep files shipped with the package, by sweep name, including the sweeps of
    extensions."""
    files = [*(SCENARIOS / "sweeps").glob("*.toml"), *(_PACKAGE / "extensions").glob("*/sweeps/*.toml")]
    return {path.stem: path for path in sorted(files, key=lambda path: path.stem)}


def machine_files() -> dict[str, Path]:
    """Return the paths of the machine files shipped with the package, by machine name."""
    return {path.stem: path for path in sorted((SCENARIOS / "machines").glob("*.toml"))}


def entry_points_of(group: Literal["plugins", "commands", "reports"]) -> list[EntryPoint]:
    """Return the entry points of extensions and installed packages that add model kinds, commands, or report pages.

    Extensions come first. Extensions whose folder was removed are omitted.
    """
    ours, theirs = list[EntryPoint](), list[EntryPoint]()
    for entry in entry_points(group=f"agrobot_mj.{group}"):
        if not entry.module.startswith("agrobot_mj.extensions."):
            theirs.append(entry)
        elif (_PACKAGE / "extensions" / entry.module.split(".")[2]).is_dir():
            ours.append(entry)
    return ours + theirs


LONGEST_NAME = 80  # Maximum number of characters of a file name in a message

Stamp = tuple[str, int, int, int]
"""Path, modification time [ns], status-change time [ns] and size [bytes] of a file. Equal stamps mean equal content."""


def stamp(name: str) -> Stamp | None:
    """Return the stamp (path, change times and size) that identifies the content of a file, or None if the file does
    not exist."""
    path = library_file(name)
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return str(path), status.st_mtime_ns, status.st_ctime_ns, status.st_size


def stamp_of(name: str, kinds: Sequence[str], most_bytes: int) -> Stamp:
    """Check the file `name` as `checked_path` does, and return its stamp (path, change times and size). Raise
    ValueError if a check fails."""
    path = checked_path(name, kinds, most_bytes)
    return stamp(name) or refuse(path, "the file no longer exists; create the file again")


def absence(path: Path, fix: str = "specify an existing file") -> str:
    """Return the reason why a path is not a regular file, for example "no such file", followed by the text `fix`."""
    reason = "no such file"
    with suppress(OSError):  # as in `is_file`
        if path.exists():
            reason = "is a folder" if path.is_dir() else "is not a regular file"
    return f"{reason}; {fix}"


def folder_absence(path: Path) -> str:
    """Return the reason why a path is not a folder: the folder is missing, or the path is a file."""
    return "is a file; specify its folder" if path.exists() else "no such folder; specify an existing folder"


def checked_path(name: str, kinds: Sequence[str], most_bytes: int) -> Path:
    """Return the path of a regular file that has one of the name endings `kinds` and at most `most_bytes` bytes.

    Empty `kinds` permit any ending. Raises ValueError with the file name and the fix if a check fails.
    """
    path = library_file(name)
    known = f" ({', '.join(kinds)})" if kinds else ""
    try:
        if not path.exists():
            refuse(path, f"no such file in {path.parent.absolute()}; specify the path relative to the scenario file")
        if not path.is_file():
            refuse(path, absence(path, f"specify a file{known}"))
        size = path.stat().st_size
    except (OSError, RuntimeError) as error:
        refuse(path, f"cannot be read: {getattr(error, 'strerror', None) or error}; choose another file")
    if kinds and path.suffix.lower() not in kinds:
        refuse(path, f"unknown file type {path.suffix!r}; convert the file to one of {', '.join(kinds)}")
    if size == 0:
        refuse(path, "the file is empty; create the file again")
    if size > most_bytes:
        limit = f"{most_bytes / 1e6:.0f} MB"
        refuse(path, f"the file size is {size / 1e6:.3g} MB, but the limit is {limit}; crop or downsample it")
    return path


ZIP_ERRORS = (zipfile.BadZipFile, zlib.error, LZMAError, RuntimeError, NotImplementedError, EOFError, OSError)
"""Errors of the standard library for a damaged or encrypted zip archive."""


def refuse(path: Path, what: str) -> NoReturn:
    """Raise ValueError with the file name and the text `what`, which describes the problem."""
    shown = path.name if len(path.name) <= LONGEST_NAME else path.name[:LONGEST_NAME] + "..."
    raise ValueError(f"{shown}: {what}") from None
