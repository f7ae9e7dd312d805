"""Ownership of files: a folder of results carries a mark, which names what this package wrote there.

Files that the mark does not name are somebody else's: they are neither overwritten nor deleted, and nothing is written
into a folder that holds files but no mark. An empty mark, made by hand, hands over all that is in the folder.
"""

import secrets
import shlex
from collections.abc import Iterable
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError

MARK = ".agrobot-mj"
"""Name of the mark: a line about it, then a name on each line."""
HEAD = "# agrobot_mj wrote the files named here and may replace them; it leaves all others in this folder alone."


def is_bare(name: object) -> bool:
    """Whether `name` is a plain file name: no path, no parent folder, not the mark."""
    return isinstance(name, str) and name not in ("", ".", "..", MARK) and not set(name) & set("/\\\n\0")


def owned(folder: Path) -> frozenset[str] | None:
    """Names of our files in `folder` by its mark; None where it has none."""
    mark = folder / MARK
    if mark.is_symlink() or not mark.is_file():
        return None
    lines = mark.read_text("utf-8", "surrogateescape").split("\n")
    if not any(line.strip() for line in lines):
        return frozenset(path.name for path in folder.iterdir())
    return frozenset(line for line in lines if line != HEAD and is_bare(line))


def check_folder(folder: Path) -> None:
    """Raise `ScenarioError` unless results may go into `folder`: it is missing, empty, or carries the mark."""
    if folder.is_dir() and owned(folder) is None and any(not _is_torn_mark(path) for path in folder.iterdir()):
        raise ScenarioError(
            f"{folder}: holds files, but no mark of agrobot-mj ({MARK}), so nothing is written there; name a new "
            f"folder; if all that is in it may be replaced, as old results of agrobot-mj may, hand it over: "
            f"touch {shlex.quote(str(folder / MARK))}"
        )


def _is_torn_mark(path: Path) -> bool:
    """Whether a command was killed while it wrote the mark of a new folder."""
    return path.name.startswith(f".{MARK}.") and path.name.endswith(".part")


def check_names(folder: Path, names: Iterable[str]) -> None:
    """Raise `ScenarioError` unless each of these names is free in `folder` or one of our files."""
    ours = owned(folder) or frozenset()
    for name in names:
        if not is_bare(name):
            raise ScenarioError(f"{folder}: {name!r} is no name of a file in a folder of results; rename the file")
        path = folder / name
        if path.is_symlink() and path.is_dir():
            raise ScenarioError(f"{path}: is a link to a folder, which is not followed; move it away")
        if name not in ours and (path.exists() or path.is_symlink()):
            raise ScenarioError(f"{path}: was not written by agrobot-mj; move it away, or name another folder")


def check_output(folder: Path, names: Iterable[str]) -> None:
    """Raise `ScenarioError` unless files of these names may be written into `folder`."""
    check_folder(folder)
    check_names(folder, names)


def reserve(folder: Path, names: Iterable[str]) -> None:
    """Name files that are about to be written in the mark of `folder`, which is made if missing.

    Raises `ScenarioError` as `check_names`.
    """
    wanted = frozenset(names)
    check_names(folder, sorted(wanted))
    before = owned(folder)
    if before is not None and wanted <= before and (folder / MARK).stat().st_size:
        return
    folder.mkdir(parents=True, exist_ok=True)
    lines = [HEAD, *sorted(wanted | (before or frozenset()) - {MARK})]
    temporary = folder / f".{MARK}.{secrets.token_hex(4)}.part"
    try:
        with temporary.open("x", encoding="utf-8", errors="surrogateescape") as file:
            file.write("\n".join(lines) + "\n")
        temporary.replace(folder / MARK)
    finally:
        temporary.unlink(missing_ok=True)


def remove(folder: Path, names: Iterable[str]) -> None:
    """Delete those of the named files that exist and are ours."""
    ours = owned(folder) or frozenset()
    for name in names:
        if name in ours:
            (folder / name).unlink(missing_ok=True)


def disown_empty(folder: Path) -> None:
    """Take the mark away where nothing else is in the folder."""
    if [path.name for path in folder.iterdir()] == [MARK]:
        (folder / MARK).unlink(missing_ok=True)
