"""Files of a run: `signals.parquet`, `metrics.json`, `scenario.toml`, and the folder that holds them.

Each file appears complete or not at all, and those of one run are one set: all are written under other names first,
then renamed together. One process at a time writes into a folder.
"""

import errno
import json
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.simulation.log import Log

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # pragma: no cover - Windows has no such locks: runs are not told of each other there
    flock = None  # type: ignore[assignment]

RECORDING = "run.rrd"
"""Name of a run's recording."""
RUTS = "ruts.parquet"
"""Name of the map of ruts, of a run on soil that remembers."""
SET = ("metrics.json", "identified.json", "vehicle.json", "link.parquet", RUTS, "signals.parquet", "scenario.toml")
"""Files beside the recording that belong to one run; the first is there only if all are."""
_STALE = re.compile(r"\.(?P<name>.+)\.[0-9a-z_]{8}(\.part)?")
"""Names of temporary files of a run, also those of earlier versions."""
_PART = re.compile(r"\..+\.[0-9a-f]{8}\.part")
"""Names of temporary files of any kind."""
Writer = Callable[[Path], None]
"""Writes a file at the path given."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; renamed to `path` if the block succeeds, deleted if it raises.

    Raises OSError that names `path`, and where that is a device, which a file must not take the place of.
    """
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "is a device; name a file", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _temporary(path)
    try:
        with _naming(path):
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))  # less the umask
            yield temporary
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON."""
    with atomic(path) as temporary:
        _json(content)(temporary)


def write_log(log: Log, folder: Path, more: Mapping[str, Writer] | None = None, recorded: bool = True) -> None:
    """Write the files of a run into `folder`, which is created if missing, `more` of them, and its data files.

    They replace those of an earlier run together, with its recording unless this run is `recorded`, too. Raises
    OSError that names the file that cannot be written.
    """
    text, data_files = log.scenario.portable()
    writers: dict[str, Writer] = {
        **{name: partial(_copy, path) for name, path in data_files.items()},
        "signals.parquet": partial(_signals, log),
        **({RUTS: lambda path: pq.write_table(ruts, path, compression="zstd")} if (ruts := log.rut_table) else {}),
        "scenario.toml": lambda path: _write(path, text),
        **(more or {}),
        "metrics.json": _json(log.metrics),
    }
    folder.mkdir(parents=True, exist_ok=True)
    staged = {name: _temporary(folder / name) for name in writers}
    try:
        for name, write in writers.items():
            with _naming(folder / name):
                write(staged[name])
        with held_back():
            clear(folder, keep=tuple(writers)[:-1])
            if not recorded:
                (folder / RECORDING).unlink(missing_ok=True)  # beside other signals it would mislead
            for name, temporary in staged.items():
                with _naming(folder / name):
                    temporary.replace(folder / name)
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)


def clear(folder: Path, keep: tuple[str, ...] = ()) -> None:
    """Remove the files of an earlier run, except the recording and those named."""
    for name in SET:
        if name not in keep:
            with _naming(folder / name):
                (folder / name).unlink(missing_ok=True)


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """`folder` for this process alone, created if missing; what a killed run left half written is cleared away.

    A folder that is empty at the end and was not there before is removed again. Raises `ScenarioError` while another
    process writes there, or where a folder stands in the place of a file.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    handle = _locked(folder)
    try:
        for name in (*SET, RECORDING):
            if (folder / name).is_dir():
                raise ScenarioError(f"{folder / name}: is a folder; move it away, or name another folder with --out")
        for path in folder.iterdir():
            if (match := _STALE.fullmatch(path.name)) and match["name"] in (*SET, RECORDING) and path.is_file():
                path.unlink(missing_ok=True)
        sweep_up(folder, "*.part")
        sweep_up(folder, "*/*.part")  # a comparison has a folder for each run
        yield folder
    finally:
        with suppress(OSError):
            for path in made:
                path.rmdir()
        if handle is not None:
            os.close(handle)


def sweep_up(folder: Path, pattern: str) -> None:
    """Remove what `atomic` and `write_log` have left half written in files of this pattern, since they were killed."""
    for path in folder.glob(pattern):
        if _PART.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def _locked(folder: Path) -> int | None:
    """A handle that holds the lock of `folder`; None where the file system has none."""
    if flock is None:  # pragma: no cover
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        flock(handle, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise ScenarioError(
            f"--out {folder}: another run is writing there; wait for its end or name another folder"
        ) from None
    except OSError:
        os.close(handle)
        return None
    return handle


def _temporary(path: Path) -> Path:
    """A place beside `path`; absolute, since pyarrow takes the start of `a:/b` for the name of a file system."""
    return path.absolute().with_name(f".{path.name}.{secrets.token_hex(4)}.part")


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Errors of the block name the file that was to be, not a temporary one."""
    try:
        yield
    except (ConnectionError, TimeoutError):  # of what the block talks to
        raise
    except OSError as error:
        raise OSError(error.errno, _reason(error), str(path)) from error


def _reason(error: OSError) -> str:
    """Words of the system for an error, also for those that a library has put into words of its own."""
    return os.strerror(error.errno) if error.errno else str(error)


def _json(content: Any) -> Writer:
    return lambda path: _write(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _signals(log: Log, path: Path) -> None:
    """The signals, a row group after the other, so that memory does not grow with the length of a run.

    Without dictionaries: measured values hardly repeat, and files are a sixth smaller.
    """
    with pq.ParquetWriter(path, log.schema, compression="zstd", use_dictionary=False) as writer:
        for piece in log.pieces():
            writer.write_table(piece)
            del piece  # before the next one is made


def _copy(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
