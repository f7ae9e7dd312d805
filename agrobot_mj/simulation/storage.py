"""Files of a run: `signals.parquet`, `metrics.json`, `scenario.toml` and data files.

The files are a consistent set: all are first written under temporary names and then renamed together.
"""

import json
import shutil
import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from agrobot_mj.core.errors import is_installed
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.core.learned import LEARNED, learned_table
from agrobot_mj.scenario.plugins import plugin_note
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.results import claim, errors_naming, remove, temporary_path

RECORDING = "run.rrd"  # File name of the recording of a run
RUTS = "ruts.parquet"  # File name of the map of ruts of a run on deformable soil
SET = (
    *("metrics.json", "identified.json", "vehicle.json", "link.parquet"),
    *(RUTS, LEARNED, "signals.parquet", "scenario.toml"),
)
"""Names of the files of a run, without the recording. `metrics.json` is renamed last and marks a complete set."""
Writer = Callable[[Path], None]  # Function that writes a file at the given path


@cache
def can_record() -> bool:
    """Return whether rerun-sdk is installed. Otherwise the first call prints the command that installs rerun-sdk."""
    if is_installed("rerun"):
        return True
    print('no recording: rerun-sdk is not installed; pip install "agrobot-mj[recording]"', file=sys.stderr)
    return False


def write_log(log: Log, folder: Path, more: Mapping[str, Writer] | None = None, recorded: bool = True) -> None:
    """Write the data files of a run, and the additional files `more`, into `folder`, which is created if missing.

    The new files replace all files of an earlier run in one step. The recording of the earlier run is removed unless
    the new run is `recorded`. Raises OSError with the name of a file that cannot be written, and `ScenarioError` if an
    existing file was not written by agrobot-mj.
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
        "metrics.json": lambda path: _write(path, json.dumps(log.metrics, indent=2, allow_nan=False) + "\n"),
    }
    claim(folder, writers)
    staged = {name: temporary_path(folder / name) for name in writers}
    try:
        for name, write in writers.items():
            with errors_naming(folder / name):
                write(staged[name])
        with held_back():
            clear(folder, keep=tuple(writers)[:-1])
            if not recorded:
                remove(folder, [RECORDING])  # it would not match the new signals
            for name, temporary in staged.items():
                with errors_naming(folder / name):
                    temporary.replace(folder / name)
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)


def files_of_run(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of all files that a run of `scenario` may write to its folder."""
    return *SET, RECORDING, *scenario.portable()[1]


def clear(folder: Path, keep: tuple[str, ...] = ()) -> None:
    """Remove the files of an earlier run, except the recording and the files `keep`."""
    for name in SET:
        if name not in keep:
            with errors_naming(folder / name):
                remove(folder, [name])


def _table(table: Any) -> Writer:
    return lambda path: pq.write_table(table, path, compression="zstd")


def _signals(log: Log, path: Path) -> None:
    """Write the signals in row groups, so that memory usage is independent of the length of the run. Without dictionary
    encoding, which is useful only for repeated values, the files are a sixth smaller."""
    with pq.ParquetWriter(path, log.schema, compression="zstd", use_dictionary=False) as writer:
        for piece in log.pieces():
            writer.write_table(piece)
            del piece  # frees the memory before the next block is built


def _copy(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
