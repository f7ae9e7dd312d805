"""Results folders: exclusive access, atomic writes, and protection of the user's files.

A results folder contains a marker file, which lists the files written by this package. All other files are neither
overwritten nor deleted. Nothing is written to a folder that contains files but no marker file. An empty marker file,
created by the user, permits overwriting all files in the folder.

Commands open a folder with `results`; within this context, `atomic` and `write_json` write files.
"""

import errno
import json
import os
import re
import secrets
import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.locks import acquire_lock

MARK = ".agrobot-mj"  # Name of the marker file, which contains a comment line, then one file name per line
HEAD = "# agrobot_mj wrote the files listed here and may replace them; all other files in this folder are kept."
PATIENCE_S = 60.0  # Maximum time to wait for another process that prepares a shared folder [s]
MAIN_FILES = {"signals.parquet": "a run", "sweep.parquet": "a comparison or a sweep"}
"""Type of the results in a folder, by the name of their main file."""
_STALE = re.compile(r"\.(?P<name>.+)\.[0-9a-z_]{8}(?P<part>\.part)?")
"""Pattern of the names of temporary files, including the names used by earlier versions."""


@contextmanager
def results(folder: Path, names: Iterable[str] = (), shared: bool = False) -> Iterator[Path]:
    """Open `folder` exclusively: create and mark a missing folder, and delete partial files of a killed process.

    `names` are the files to be written; names of folders end with a slash. A new folder is removed if it is empty at
    the end. Processes that open a folder as `shared` wait for each other and keep partial files. Raises `ScenarioError`
    for a folder rejected by `check_folder`, and if another process writes to the folder.
    """
    check_folder(folder, names := tuple(names))
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        handle = acquire_lock(folder, PATIENCE_S if shared else 0.0)
    except TimeoutError:
        raise ScenarioError(
            f"--out {folder}: another run is writing to this folder; wait for it to end, or specify another folder"
        ) from None
    try:
        marked = owned_files(folder) is not None
        claim(folder, (name for name in names if name.endswith("/")))
        if not shared:
            _remove_half_written(folder)
        try:
            yield folder
        finally:
            if not marked and [path.name for path in folder.iterdir()] == [MARK]:
                (folder / MARK).unlink(missing_ok=True)
    finally:
        with suppress(OSError):
            for path in made:
                path.rmdir()
        if handle is not None:
            os.close(handle)


def check_folder(folder: Path, names: Iterable[str] = ()) -> None:
    """Raise `ScenarioError` unless the files or folders `names` may be written to `folder`."""
    if folder.is_dir() and owned_files(folder) is None and any(not _is_torn_mark(path) for path in folder.iterdir()):
        raise ScenarioError(
            f"{folder}: the folder contains files that agrobot-mj did not write; specify another folder, or allow "
            f"agrobot-mj to write its results into this one with: touch {shlex.quote(str(folder / MARK))}"
        )
    check_names(folder, names := tuple(names))
    main = MAIN_FILES.keys() & set(names)
    for name in sorted(MAIN_FILES.keys() & (owned_files(folder) or set()) - main):
        if main and (folder / name).exists() and (folder / MARK).stat().st_size:
            raise ScenarioError(
                f"{folder}: the folder already contains {MAIN_FILES[name]} ({name}), which must not be mixed with "
                "other results; delete the folder, or specify another one with --out"
            )


def claim(folder: Path, names: Iterable[str]) -> None:
    """Add names of files or folders to the marker file of `folder`; create the marker file if missing.

    Raises `ScenarioError` if one of the files exists and this package did not write it.
    """
    names = sorted(names)
    check_names(folder, names)
    before, wanted = owned_files(folder), frozenset(name.removesuffix("/") for name in names)
    if before is not None and wanted <= before and (folder / MARK).stat().st_size:
        return
    folder.mkdir(parents=True, exist_ok=True)
    lines = [HEAD, *sorted(wanted | (before or frozenset()) - {MARK})]
    temporary = temporary_path(folder / MARK)
    try:
        with temporary.open("x", encoding="utf-8", errors="surrogateescape") as file:
            file.write("\n".join(lines) + "\n")
        temporary.replace(folder / MARK)
    finally:
        temporary.unlink(missing_ok=True)


def owned_files(folder: Path) -> frozenset[str] | None:
    """Return the file names listed in the marker file of `folder`.

    Return the names of all files in the folder if the marker file is empty, and None if there is no marker file.
    """
    mark = folder / MARK
    if mark.is_symlink() or not mark.is_file():
        return None
    lines = mark.read_text("utf-8", "surrogateescape").split("\n")
    if not any(line.strip() for line in lines):
        return frozenset(path.name for path in folder.iterdir())
    return frozenset(line for line in lines if line != HEAD and is_bare(line))


def remove(folder: Path, names: Iterable[str]) -> None:
    """Delete the files `names` that the marker file of `folder` lists."""
    ours = owned_files(folder) or frozenset()
    for name in names:
        if name in ours:
            (folder / name).unlink(missing_ok=True)


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`. Rename the file to `path` at the end, or delete it after an error.

    Raises OSError with the name `path`, also if `path` is a device. Raises `ScenarioError` for a file in a results
    folder that this package did not write.
    """
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "is a device; specify a file", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    if owned_files(path.parent) is not None:
        claim(path.parent, [path.name])
    temporary = temporary_path(path)
    try:
        with errors_naming(path):
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))  # permissions minus the umask
            yield temporary
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON, atomically."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> Path:
    """Write a text file in UTF-8, atomically, and return its path."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def is_bare(name: object) -> bool:
    """Return whether `name` is a file name without a folder, other than the name of the marker file."""
    return isinstance(name, str) and name not in ("", ".", "..", MARK) and not set(name) & set("/\\\n\0")


def temporary_path(path: Path) -> Path:
    """Return a temporary path next to `path`, absolute because pyarrow interprets `a:/b` as a file system."""
    return path.absolute().with_name(f".{path.name}.{secrets.token_hex(4)}.part")


@contextmanager
def errors_naming(path: Path) -> Iterator[None]:
    """Set the file name of each OSError raised in the context to `path`, except in network errors."""
    try:
        yield
    except (ConnectionError, TimeoutError):  # network errors of the block
        raise
    except OSError as error:
        words = os.strerror(error.errno) if error.errno else str(error)  # libraries raise errors without errno
        raise OSError(error.errno, words, str(path)) from error


def check_names(folder: Path, names: Iterable[str]) -> None:
    """Raise `ScenarioError` for an invalid file name, and for an existing file that agrobot-mj did not write."""
    ours = owned_files(folder) or frozenset()
    for given in names:
        name = given.removesuffix("/") if isinstance(given, str) else given
        if not is_bare(name):
            raise ScenarioError(f"{folder}: {name!r} is not a valid file name in a results folder; rename the file")
        path = folder / name
        if path.is_symlink() and path.is_dir():
            raise ScenarioError(f"{path} is a link to a folder, and links are not followed; remove the link")
        if name not in ours and (path.exists() or path.is_symlink()):
            raise ScenarioError(f"{path} was not written by agrobot-mj; move it, or specify another folder")
        if name == given and path.is_dir():
            raise ScenarioError(f"{path} is a folder, not a file; move it, or specify another folder with --out")


def _is_torn_mark(path: Path) -> bool:
    """Return whether a file is the partial marker file of a new folder, left by a killed process."""
    return path.name.startswith(f".{MARK}.") and path.name.endswith(".part")


def _remove_half_written(folder: Path) -> None:
    """Delete partial files of this package from `folder` and from the subfolders listed in the marker file."""
    ours = {*(owned_files(folder) or ()), MARK}
    for path in folder.iterdir():
        if (match := _STALE.fullmatch(path.name)) and match["name"] in ours and path.is_file():
            path.unlink(missing_ok=True)
        elif path.name in ours and path.is_dir() and not path.is_symlink():
            for top, _, files in os.walk(path):
                for name in files:
                    if (match := _STALE.fullmatch(name)) and match["part"]:
                        Path(top, name).unlink(missing_ok=True)
