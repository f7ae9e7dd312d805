"""Files of a run: `signals.parquet`, `metrics.json`, `scenario.toml`, and the folder that holds them.

Each file appears complete or not at all, and those of one run are one set: all are written under other names first,
then renamed together. One process at a time writes into a folder, and only over files of our own (`ownership`).
"""

import errno
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.core.learned import LEARNED, learned_table
from agrobot_mj.scenario.plugins import plugin_note
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.ownership import MARK, check_output, disown_empty, owned, remove, reserve

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # pragma: no cover - Windows has no such locks: runs are not told of each other there
    flock = None  # type: ignore[assignment]

RECORDING = "run.rrd"
"""Name of a run's recording."""
RUTS = "ruts.parquet"
"""Name of the map of ruts, of a run on soil that remembers."""
SET = (
    *("metrics.json", "identified.json", "vehicle.json", "link.parquet"),
    *(RUTS, LEARNED, "signals.parquet", "scenario.toml"),
)
"""Files of one run beside the recording; the first exists only if all do."""
_STALE = re.compile(r"\.(?P<name>.+)\.[0-9a-z_]{8}(\.part)?")
"""Names of temporary files of a run, also those of earlier versions."""
PATIENCE_S = 60.0
"""Longest wait of one that shares a folder for another that prepares it [s]."""
Writer = Callable[[Path], None]
"""Writes a file at the path given."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; renamed to `path` if the block succeeds, deleted if it raises.

    Raises OSError that names `path`, and where that is a device, which a file must not take the place of; in a folder
    of results `ScenarioError` where the file there is not ours.
    """
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "is a device; name a file", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    if owned(path.parent) is not None:
        reserve(path.parent, [path.name])
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
    OSError that names the file that cannot be written, `ScenarioError` where a file of that name is not ours.
    """
    text, data_files = log.scenario.portable()
    text = f"# identity {log.metrics.get('identity', '')}\n{plugin_note()}{text}"
    writers: dict[str, Writer] = {
        **{name: partial(_copy, path) for name, path in data_files.items()},
        "signals.parquet": partial(_signals, log),
        **({LEARNED: _table(learned_table(log.learned))} if log.learned else {}),
        **({RUTS: _table(ruts)} if (ruts := log.rut_table) else {}),
        "scenario.toml": lambda path: _write(path, text),
        **(more or {}),
        "metrics.json": _json(log.metrics),
    }
    reserve(folder, writers)
    staged = {name: _temporary(folder / name) for name in writers}
    try:
        for name, write in writers.items():
            with _naming(folder / name):
                write(staged[name])
        with held_back():
            clear(folder, keep=tuple(writers)[:-1])
            if not recorded:
                remove(folder, [RECORDING])  # beside other signals it would mislead
            for name, temporary in staged.items():
                with _naming(folder / name):
                    temporary.replace(folder / name)
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)


def files_of_run(scenario: Scenario) -> tuple[str, ...]:
    """Names of all files that a run of `scenario` may write into its folder."""
    return *SET, RECORDING, *scenario.portable()[1]


def clear(folder: Path, keep: tuple[str, ...] = ()) -> None:
    """Remove the files of an earlier run, except the recording and those named."""
    for name in SET:
        if name not in keep:
            with _naming(folder / name):
                remove(folder, [name])


@contextmanager
def exclusive(folder: Path, names: Iterable[str] = (*SET, RECORDING), shared: bool = False) -> Iterator[Path]:
    """`folder` for this process alone, created and marked if missing; what a killed run left half written goes.

    `names` are what is going to be written. A folder that is empty at the end and was not there before is removed
    again. Who shares it with others waits for them, and leaves what they are writing. Raises `ScenarioError` where the
    folder or a file there is not ours, while another process writes there, or where a folder stands in the place of a
    file.
    """
    check_output(folder, names := tuple(names))
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    handle = _locked(folder, PATIENCE_S if shared else 0.0)
    try:
        for name in (*SET, RECORDING):
            if (folder / name).is_dir():
                raise ScenarioError(f"{folder / name}: is a folder; move it away, or name another folder with --out")
        unmarked = owned(folder) is None
        reserve(folder, ())
        if not shared:
            _tidy(folder)
        try:
            yield folder
        finally:
            if unmarked:
                disown_empty(folder)
    finally:
        with suppress(OSError):
            for path in made:
                path.rmdir()
        if handle is not None:
            os.close(handle)


def _tidy(folder: Path) -> None:
    """Remove what a killed command has left half written in its folder, and in those of a comparison's runs."""
    ours = owned(folder) or frozenset()
    sweep_up(folder, {*ours, MARK}.__contains__)
    for place in (folder / name for name in sorted(ours)):
        if place.is_dir() and (inner := owned(place)) is not None:
            sweep_up(place, {*inner, MARK}.__contains__)


def sweep_up(folder: Path, is_ours: Callable[[str], bool]) -> None:
    """Remove half-written files whose names are ours, which a killed writer has left in `folder`."""
    for path in folder.iterdir() if folder.is_dir() and not folder.is_symlink() else ():
        if (match := _STALE.fullmatch(path.name)) and is_ours(match["name"]) and path.is_file():
            path.unlink(missing_ok=True)


def _locked(folder: Path, patience: float) -> int | None:
    """A handle that holds the lock of `folder`, within `patience` [s]; None where the file system has none."""
    if flock is None:  # pragma: no cover
        return None
    handle, deadline = os.open(folder, os.O_RDONLY), time.monotonic() + patience
    while True:
        try:
            flock(handle, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            if time.monotonic() < deadline:
                time.sleep(0.1)
                continue
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
        words = os.strerror(error.errno) if error.errno else str(error)  # a library may have put it into its own
        raise OSError(error.errno, words, str(path)) from error


def _json(content: Any) -> Writer:
    return lambda path: _write(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _table(table: Any) -> Writer:
    return lambda path: pq.write_table(table, path, compression="zstd")


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
