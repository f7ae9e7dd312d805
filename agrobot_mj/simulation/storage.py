"""Files of a run: `signals.parquet`, `metrics.json`, `scenario.toml` and its data files.

They are one set: all are written under other names first, then renamed together.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from agrobot_mj.core.interrupts import held_back
from agrobot_mj.core.learned import LEARNED, learned_table
from agrobot_mj.scenario.plugins import plugin_note
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.results import claim, errors_naming, remove, temporary_path

RECORDING = "run.rrd"
"""Name of a run's recording."""
RUTS = "ruts.parquet"
"""Name of the map of ruts, of a run on soil that remembers."""
SET = (
    *("metrics.json", "identified.json", "vehicle.json", "link.parquet"),
    *(RUTS, LEARNED, "signals.parquet", "scenario.toml"),
)
"""Files of one run beside the recording; the first exists only if all do."""
Writer = Callable[[Path], None]
"""Writes a file at the path given."""


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
    claim(folder, writers)
    staged = {name: temporary_path(folder / name) for name in writers}
    try:
        for name, write in writers.items():
            with errors_naming(folder / name):
                write(staged[name])
        with held_back():
            clear(folder, keep=tuple(writers)[:-1])
            if not recorded:
                remove(folder, [RECORDING])  # beside other signals it would mislead
            for name, temporary in staged.items():
                with errors_naming(folder / name):
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
            with errors_naming(folder / name):
                remove(folder, [name])


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
