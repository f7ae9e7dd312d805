"""Run of a study in any process: a `Task` in, its numbers and files out.

A failed run has numbers like any other; a run that raises has the outcome `error` and its message.
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

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import Identity, code_text, differing
from agrobot_mj.core.interrupts import raised_by_handler
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.overrides import explicit_values, flat
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.simulation.branching import Branch
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.results import MARK
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import RECORDING, write_log

ERROR = "error"
"""Outcome of a run that raised."""
WALL = ("wall_s", "real_time_factor", "identity")
"""Metrics that may differ between runs that went the same."""
LAST = "metrics.json"
"""File of a run that is written last: it exists only if all do."""
POSES = "poses.npy"
"""File with the poses of a run, shape (ticks, bodies, 7)."""
Row = dict[str, Any]
"""Results of a run, ready for JSON: `outcome`, `expected`, `error`, metrics by dotted name, `version`."""


class Task(NamedTuple):
    """Description of one run for a worker."""

    base: str
    """Base scenario as JSON, see `base_text`."""
    name: str
    """Name of the base scenario."""
    overrides: dict[str, Any]
    """All that differs from the base scenario, by dotted key."""
    keep: str = "table"
    """Files of the run to keep, see `SweepFile.keep`; `poses` is its recording with `POSES`."""
    measure: Callable[[Log], Mapping[str, Any]] | None = None
    """Function, importable by workers, for numbers beyond the run's metrics."""
    branches: tuple[Branch, ...] | None = None
    """Ticks from which its noise continues otherwise; None for a run that no other one is to begin like."""
    number: int = 0
    """Number of the run among those it is done with."""
    identity: Identity | None = None
    """Identity of the row; None if any code may run the task."""

    @classmethod
    def of(cls, scenario: Scenario, overrides: Mapping[str, Any] | None = None, **more: Any) -> "Task":
        """Return a run of a scenario with overrides by dotted key; `more` are other fields."""
        return cls(base_text(scenario), scenario.name, dict(overrides or {}), **more)


class Done(NamedTuple):
    """Result of a run."""

    row: Row
    files: dict[str, bytes]
    """Files to keep, by path from the run's folder."""


def base_text(base: Scenario) -> str:
    """Return a scenario as JSON that reads back as the same, with the same keys left to their defaults."""
    return json.dumps(explicit_values(base), sort_keys=True)


def perform(task: Task) -> Done:
    """Perform one run.

    Raises errors that are not caused by the run: OSError for a full disk, exceptions of signal handlers, and
    `ScenarioError` if this process has other code than the task requires.
    """
    if task.identity and (apart := differing(code_text(), task.identity.code)):
        raise ScenarioError(f"{task.name}: a worker has {other_code(apart)}")
    began, identity = time.perf_counter(), None
    try:
        base = _base(task.base, task.name)
        scenario = base.changed(task.overrides) if task.overrides else base
        identity = str(scenario.identity)
        return _driven(task, scenario)
    except Exception as error:
        full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
        if full or raised_by_handler(error):
            raise
        return failure(f"{type(error).__name__}: {error}", time.perf_counter() - began, identity)


def failure(text: str, wall_s: float | None = None, identity: str | None = None) -> Done:
    """Return the result of a run that raised."""
    end = {"outcome": ERROR, "expected": False, "error": text}
    return Done({**end, "wall_s": wall_s, "identity": identity, "version": __version__}, {})


@lru_cache(maxsize=32)
def _base(text: str, name: str) -> Scenario:
    return resolve(json.loads(text), name)


def _driven(task: Task, scenario: Scenario) -> Done:
    if task.keep in ("table", "failures"):
        log = run(scenario, branches=task.branches)
        if task.keep == "table" or log.as_expected:
            return Done(_numbers(log, task), {})
    with tempfile.TemporaryDirectory(prefix="agrobot-mj-") as place:
        folder = Path(place)
        # A failure is driven once more for its recording: it repeats exactly, and rerun keeps some MB of each.
        log = (
            run(scenario, branches=task.branches)
            if task.keep == "signals"
            else _recorded(scenario, folder, task.branches)
        )
        write_log(log, folder)
        if task.keep == "poses":
            np.save(folder / POSES, log.poses)
        kept = sorted((file for file in folder.iterdir() if file.name != MARK), key=lambda file: file.name == LAST)
        return Done(_numbers(log, task), {file.name: file.read_bytes() for file in kept})


def _recorded(scenario: Scenario, folder: Path, branches: tuple[Branch, ...] | None) -> Log:
    from agrobot_mj.recording import Recording

    return run(scenario, (Recording(folder / "run.rrd"),), branches=branches)


def _numbers(log: Log, task: Task) -> dict[str, Any]:
    measured = task.measure(log) if task.measure else {}
    end = {"expected": log.as_expected, "error": None}
    return dict(flat({"outcome": log.outcome, **end, **log.metrics, **measured, "version": __version__}))


def other_code(parts: Sequence[str]) -> str:
    """Return the message for a worker in which these parts of the code differ from those of the command."""
    return (
        f"other {' and '.join(parts)} than this command: edited meanwhile, or registered where workers do not see it; "
        "start the command, and workers of a scheduler, again, and register kinds at the top level of a module"
    )


def files_kept(keep: str, expected: bool) -> tuple[str, ...]:
    """Return the names of the files required for a run kept as the task requests, except its row."""
    if keep == "table" or (keep == "failures" and expected):
        return ()
    return (LAST,) if keep == "signals" else (LAST, RECORDING, POSES) if keep == "poses" else (LAST, RECORDING)
