"""Execution of one run of a study in any process: conversion of a `Task` to a row of results and files.

A run that fails has metrics. A run that raises an exception has the outcome `error` and an error message.
"""

import errno
import json
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError, is_installed
from agrobot_mj.core.identity import Identity, code_text, differing
from agrobot_mj.core.interrupts import raised_by_handler
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.overrides import explicit_values, flat
from agrobot_mj.scenario.plugins import place_in_plugin
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.simulation.branching import Branch
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.results import MARK
from agrobot_mj.simulation.run import Watcher, run
from agrobot_mj.simulation.storage import RECORDING, can_record, write_log

ERROR = "error"
WALL = ("wall_s", "real_time_factor", "identity")  # Metrics that may differ between repetitions of a run
LAST = "metrics.json"  # Name of the file that a run writes last. If it exists, all files of the run are complete.
POSES = "poses.npy"  # File name of the poses of all bodies, an array of shape (ticks, bodies, 7)
Row = dict[str, Any]
"""Results of a run as JSON values: `outcome`, `expected`, `error`, `version`, and metrics by dotted name."""


class Task(NamedTuple):
    """One run of a study: base scenario, overrides, and results to keep."""

    base: str  # Base scenario as JSON text, as returned by `base_text`
    name: str
    overrides: dict[str, Any]
    keep: str = "table"
    """Files of the run to keep: a value of `SweepFile.keep`, or `poses` for signals, recording and body poses."""
    measure: Callable[[Log], Mapping[str, Any]] | None = None
    """Function that computes additional results from the log. Worker processes must be able to import this function."""
    branches: tuple[Branch, ...] | None = None  # Branches of the random streams, or None for a run without branches
    number: int = 0
    identity: Identity | None = None  # Identity of the row, or None if any version of the code may perform the task

    @classmethod
    def of(cls, scenario: Scenario, overrides: Mapping[str, Any] | None = None, **more: Any) -> "Task":
        """Return a task for a scenario with overrides by dotted key. `more` contains other fields of the task."""
        return cls(base_text(scenario), scenario.name, dict(overrides or {}), **more)


class Done(NamedTuple):
    """Result of a completed task: row of results, and files to keep."""

    row: Row
    files: dict[str, bytes]  # Content of the files to keep, by path relative to the folder of the run


def base_text(base: Scenario) -> str:
    """Return a scenario as JSON text without default values. `resolve` converts the text back to an equal scenario."""
    return json.dumps(explicit_values(base), sort_keys=True)


def perform(task: Task) -> Done:
    """Simulate the run of a task and return its row and its files to keep.

    Errors of the run are stored in the row. Other errors are raised: OSError for a full disk, exceptions of signal
    handlers, and `ScenarioError` if the code of this process differs from the code in the task identity.
    """
    if task.identity and (apart := differing(code_text(), task.identity.code)):
        raise ScenarioError(f"{task.name}: a worker uses {other_code(apart)}")
    began, scenario = time.perf_counter(), None
    try:
        base = _base(task.base, task.name)
        scenario = base.changed(task.overrides) if task.overrides else base
        return _run_task(task, scenario)
    except Exception as error:
        full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
        if full or raised_by_handler(error):
            raise
        text = f"{type(error).__name__}: {error}{place_in_plugin(error)}"
        return failure(text, time.perf_counter() - began, str(scenario.identity) if scenario else None)


def failure(text: str, wall_s: float | None = None, identity: str | None = None) -> Done:
    """Return the result for a run that raised an exception; `text` is the error message."""
    end = {"outcome": ERROR, "expected": False, "error": text}
    return Done({**end, "wall_s": wall_s, "identity": identity, "version": __version__}, {})


@lru_cache(maxsize=32)
def _base(text: str, name: str) -> Scenario:
    return resolve(json.loads(text), name)


def _run_task(task: Task, scenario: Scenario) -> Done:
    if task.keep in ("table", "failures"):
        log = run(scenario, branches=task.branches)
        if task.keep == "table" or log.as_expected:
            return Done(_numbers(log, task), {})
    with tempfile.TemporaryDirectory(prefix="agrobot-mj-") as place:
        folder = Path(place)
        # Recording all runs would need several MB each. A failed run is therefore simulated again for its recording.
        watchers: tuple[Watcher, ...] = ()
        if task.keep != "signals" and can_record():
            from agrobot_mj.recording import Recording

            watchers = (Recording(folder / "run.rrd"),)
        log = run(scenario, watchers, branches=task.branches)
        write_log(log, folder)
        if task.keep == "poses":
            np.save(folder / POSES, log.poses)
        kept = sorted((file for file in folder.iterdir() if file.name != MARK), key=lambda file: file.name == LAST)
        return Done(_numbers(log, task), {file.name: file.read_bytes() for file in kept})


def _numbers(log: Log, task: Task) -> dict[str, Any]:
    measured = task.measure(log) if task.measure else {}
    end = {"expected": log.as_expected, "error": None}
    return dict(flat({"outcome": log.outcome, **end, **log.metrics, **measured, "version": __version__}))


def other_code(parts: Sequence[str]) -> str:
    """Return the error message for a worker whose code differs from the code of the command in the parts `parts` of the
    identity."""
    return (
        f"different {' and '.join(parts)}: the code was edited meanwhile, or registered where workers do not find it; "
        "restart the command and the workers of a scheduler, and register kinds at the top level of a module"
    )


def files_kept(keep: str, expected: bool) -> tuple[str, ...]:
    """Return the names of the files kept for a completed run.

    `keep` is a value of `SweepFile.keep`, or `poses`; `expected` is whether the run ended as expected.
    """
    if keep == "table" or (keep == "failures" and expected):
        return ()
    recorded = (RECORDING,) if keep != "signals" and is_installed("rerun") else ()
    return LAST, *recorded, *((POSES,) if keep == "poses" else ())
