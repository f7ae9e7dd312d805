"""Data files that a scenario names, looked at before anything opens them: no device may block, no giant be read."""

from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from agrobot_mj.core.resources import library_file

LONGEST_NAME = 80
"""Characters of a name that messages show."""

Stamp = tuple[str, int, int]
"""Path of a file, time of its last change [ns], size: a file with the same stamp has the same content."""


def stamp(name: str) -> Stamp | None:
    """Identity of the file's present content; None where there is no such file."""
    path = library_file(name)
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return str(path), status.st_mtime_ns, status.st_size


def checked(name: str, kinds: Sequence[str], most_bytes: int) -> Path:
    """The path of a regular file with one of these endings (any, when none is given) and of sensible size.

    Raises ValueError that begins with the file's name and ends with the fix.
    """
    path = library_file(name)
    known = f" ({', '.join(kinds)})" if kinds else ""
    try:
        if path.is_dir():
            refuse(path, f"is a folder; name a file{known}")
        if not path.exists():
            refuse(path, f"no such file in {path.parent.absolute()}; give its path from the folder of the scenario")
        if not path.is_file():
            refuse(path, f"is not a regular file; name one{known}")
        size = path.stat().st_size
    except (OSError, RuntimeError) as error:
        refuse(path, f"cannot be read: {getattr(error, 'strerror', None) or error}; choose another file")
    if kinds and path.suffix.lower() not in kinds:
        refuse(path, f"unknown type {path.suffix!r}; convert it to one of {', '.join(kinds)}")
    if size == 0:
        refuse(path, "is empty; write it again")
    if size > most_bytes:
        refuse(path, f"has {size / 1e6:.3g} MB, the limit is {most_bytes / 1e6:.0f}; crop or thin it out")
    return path


def refuse(path: Path, what: str) -> NoReturn:
    """Raise the ValueError that says `what` is wrong with a file."""
    shown = path.name if len(path.name) <= LONGEST_NAME else path.name[:LONGEST_NAME] + "..."
    raise ValueError(f"{shown}: {what}") from None
