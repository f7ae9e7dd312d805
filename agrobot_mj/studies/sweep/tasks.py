"""One run of a sweep, wherever it is done: a `Task` in, its row and the files to keep out. Writes nothing that stays.

A run that fails is a row like any other; one that raises has the outcome `error` and its message.
"""

import errno
import json
import tempfile
import time
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.ownership import MARK
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import write_log

ERROR = "error"
"""Outcome of a run that raised."""
WALL = ("wall_s", "real_time_factor")
"""Metrics that differ when a run is repeated; the table has the first of them, in its last columns."""


class Task(NamedTuple):
    """What a worker needs to do one run."""

    number: int
    """Number of the run in its plan."""
    base: str
    """Base scenario as JSON, see `plan.base_text`."""
    name: str
    """Name of the base scenario."""
    overrides: dict[str, Any]
    """All that differs from the base scenario, by dotted key."""
    keep: str
    """What to keep of the run, see `SweepFile.keep`."""


class Done(NamedTuple):
    """What came out of a run."""

    numbers: dict[str, Any]
    """`outcome`, `expected`, `error` and metrics, `wall_s` and `version` last; ready for JSON."""
    files: dict[str, bytes]
    """Files to keep, by path from the run's folder."""


def perform(task: Task) -> Done:
    """Do one run. Raises OSError where the disk is full, which is no fault of the run; nothing else."""
    began = time.perf_counter()
    try:
        return _driven(task, _base(task.base, task.name).changed(task.overrides))
    except Exception as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        return failure(f"{type(error).__name__}: {error}", time.perf_counter() - began)


def failure(text: str, wall_s: float | None = None) -> Done:
    """The result of a run that raised."""
    return Done({"outcome": ERROR, "expected": False, "error": text, "wall_s": wall_s, "version": __version__}, {})


@lru_cache(maxsize=2)
def _base(text: str, name: str) -> Scenario:
    return resolve(json.loads(text), name)


def _driven(task: Task, scenario: Scenario) -> Done:
    if task.keep in ("table", "failures"):
        log = run(scenario)
        if task.keep == "table" or log.as_expected:
            return Done(_numbers(log, scenario), {})
    with tempfile.TemporaryDirectory(prefix="agrobot-mj-") as place:
        folder = Path(place)
        # A failure is driven once more for its recording: it repeats exactly, and rerun keeps some MB of each.
        log = run(scenario) if task.keep == "signals" else _recorded(scenario, folder)
        write_log(log, folder)
        files = (file for file in sorted(folder.iterdir()) if file.name != MARK)
        return Done(_numbers(log, scenario), {file.name: file.read_bytes() for file in files})


def _recorded(scenario: Scenario, folder: Path) -> Log:
    from agrobot_mj.recording import Recording

    return run(scenario, (Recording(folder / "run.rrd"),))


def _numbers(log: Log, scenario: Scenario) -> dict[str, Any]:
    metrics = {key: value for key, value in flat(log.metrics) if key not in (*WALL, "outcome")}
    end = {"wall_s": log.wall_s, "version": __version__}
    return {"outcome": log.outcome, "expected": log.as_expected, "error": None, **metrics, **end}
