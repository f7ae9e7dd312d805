"""Execution of a sweep: check of the plan, simulation of missing runs, and table of all rows."""

import errno
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import check_folder, results
from agrobot_mj.studies.engine.workers import performing
from agrobot_mj.studies.sweep.plan import MAX_RUNS, SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import TABLE, Store, merge, read_plan

MAX_EXAMPLES = 100
"""Maximum number of example scenarios that are checked for configuration hints, at equal intervals of the plan."""
Begin = Callable[[Iterator[Scenario]], object]
"""Type of a function that receives example scenarios of a sweep before the first run."""
Shard = tuple[int, int]  # Number of a part of the runs, from 1, and number of parts


class SweepOptions(NamedTuple):
    """Execution options of a sweep."""

    jobs: int | None = None  # Number of processes, or None for one per core
    scheduler: str | None = None
    shard: Shard = (1, 1)  # Part of the runs that this process simulates
    fresh: bool = False  # Whether existing results are deleted first
    max_runs: int = MAX_RUNS
    quiet: bool = False


DEFAULTS = SweepOptions()


class SweepSummary(NamedTuple):
    """Results folder and numbers of runs of a finished sweep."""

    folder: Path
    total: int
    before: int  # Number of runs in this part of the sweep whose results already existed
    new: int
    unexpected: int
    errors: int


def sweep(
    source: str | Path, folder: Path, options: SweepOptions = DEFAULTS, begin: Begin = lambda some: None
) -> SweepSummary:
    """Simulate the missing runs of a sweep and write all results to `folder`.

    Before the first run, `begin` is called with some scenarios of the sweep. Raise `ScenarioError` before the first run
    if a run is infeasible.
    """
    plan = SweepPlan(read_sweep(source))
    plan.check_size(options.max_runs)  # must precede all loops over the runs
    store = Store(folder, plan)
    # Shards may share a folder, because they have different runs.
    with results(folder, store.names) if options.shard == (1, 1) else nullcontext():
        return drive(store, options, begin)


def drive(store: Store, options: SweepOptions, begin: Begin = lambda some: None) -> SweepSummary:
    """Simulate the missing runs of a sweep in its results folder, and write the results table.

    The caller locks the folder, unless several processes run parts of the sweep in it.
    """
    plan, before, unexpected, errors = store.plan, 0, 0, 0
    part = range(options.shard[0] - 1, plan.total, options.shard[1])
    _prepare(store, options, part)
    begin(plan.some(MAX_EXAMPLES))
    with _full_disk_told(store):
        try:
            with (
                tally(f"{plan.sweep.name}: {len(part):,} runs", len(part), quiet=options.quiet) as advance,
                performing(options.jobs, options.scheduler, len(part)) as perform,
                closing(store.drive(part, store.task, perform)) as driven,
            ):
                for _, row, there in driven:
                    before += there
                    unexpected += not there and not row["expected"]
                    errors += row["error"] is not None
                    advance(expected=row["expected"], there=there)
        except (KeyboardInterrupt, ScenarioError):
            store.write_table()
            raise
        if before < len(part) or store.in_table < plan.total:
            store.write_table()
    return SweepSummary(store.folder, plan.total, before, len(part) - before, unexpected, errors)


def merge_results(sources: Sequence[Path], folder: Path) -> tuple[int, int]:
    """Merge the results of separately simulated parts of a sweep into `folder`. Return the numbers of rows and of
    planned runs."""
    if not sources:
        raise ScenarioError(f"{folder}: none of the folders to merge exists; specify folders written with --shard")
    with results(folder, (TABLE,), shared=True):
        return merge(sources, folder)


def _prepare(store: Store, options: SweepOptions, part: range) -> None:
    """Write the sweep files to the results folder. Check the plan first, unless the folder contains results of this
    plan."""
    folder, plan, whole = store.folder, store.plan, options.shard == (1, 1)
    check_folder(folder, store.names)
    if options.fresh or read_plan(folder) is None or store.changed:
        title = f"{plan.sweep.name}: checking {plan.checks:,} combinations"
        with tally(title, plan.checks, quiet=options.quiet) as advance:
            plan.check(advance)
    with _full_disk_told(store), nullcontext() if whole else results(folder, store.names, shared=True):
        if options.fresh:
            store.clear(None if whole or _is_other(store) else part)
        store.begin()


def _is_other(store: Store) -> bool:
    try:
        return store.changed
    except ScenarioError:
        return True


@contextmanager
def _full_disk_told(store: Store) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        kept = sum(1 for _ in store.rows())
        text = f"{error.strerror}; {kept:,} finished runs are kept; free disk space and run the same command again"
        raise OSError(error.errno, text, str(store.folder)) from None
