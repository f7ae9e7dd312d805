"""Execution of a sweep: check the plan, run the missing runs, write each row when done, and the table at the end."""

import errno
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import check_folder, results
from agrobot_mj.studies.engine import performing
from agrobot_mj.studies.sweep.plan import MAX_RUNS, SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import TABLE, Store, begun, merge

MOST_HEARD = 100
"""Maximum number of scenarios, evenly over the plan, that are checked for hints."""
Begin = Callable[[Iterator[Scenario]], object]
"""Callback that receives scenarios before they are simulated."""
Shard = tuple[int, int]
"""Number of this part, from 1, and number of parts."""


class SweepOptions(NamedTuple):
    """Options of a sweep."""

    jobs: int | None = None
    """Number of processes; None for the number of cores."""
    scheduler: str | None = None
    """Address of a Dask scheduler that does the work instead."""
    shard: Shard = (1, 1)
    """Part of the runs to do."""
    fresh: bool = False
    """Whether to discard existing results."""
    max_runs: int = MAX_RUNS
    """Maximum number of runs allowed."""
    quiet: bool = False
    """Whether to show no progress."""


DEFAULTS = SweepOptions()


class SweepSummary(NamedTuple):
    """Result of a sweep."""

    folder: Path
    total: int
    """Number of runs of the whole sweep."""
    before: int
    """Runs of this part that were there already."""
    new: int
    """Runs done now."""
    unexpected: int
    """Runs done now that did not end as expected."""
    errors: int
    """Runs done now that raised an error."""


def sweep(
    source: str | Path, folder: Path, options: SweepOptions = DEFAULTS, begin: Begin = lambda some: None
) -> SweepSummary:
    """Run a sweep, or its missing runs, into `folder`. Raises `ScenarioError` before any run.

    `begin` receives some of its scenarios before that.
    """
    plan = SweepPlan(read_sweep(source))
    plan.check_size(options.max_runs)  # before anything goes through its values
    store = Store(folder, plan)
    # Shards may share a folder, since each has runs of its own.
    with results(folder, store.names) if options.shard == (1, 1) else nullcontext():
        return drive(store, options, begin)


def drive(store: Store, options: SweepOptions, begin: Begin = lambda some: None) -> SweepSummary:
    """Run the missing runs of a sweep in its folder, which is open unless shared by shards; see `sweep`."""
    plan, before, unexpected, errors = store.plan, 0, 0, 0
    part = range(options.shard[0] - 1, plan.total, options.shard[1])
    _prepare(store, options, part)
    begin(plan.some(MOST_HEARD))
    with _full_disk_told(store):
        try:
            with (
                tally(f"{plan.sweep.name}: {len(part):,} runs", len(part), quiet=options.quiet) as advance,
                performing(options.jobs, options.scheduler, len(part)) as perform,
                closing(store.drive(part, plan.task, perform, store)) as driven,
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


def merged(sources: Sequence[Path], folder: Path) -> tuple[int, int]:
    """Bring parts of a sweep together in `folder`; returns how many rows its table has, and should have."""
    if not sources:
        raise ScenarioError(f"{folder}: no such folder; --merge joins the folders that --shard has written")
    with results(folder, (TABLE,), shared=True):
        return merge(sources, folder)


def _prepare(store: Store, options: SweepOptions, part: range) -> None:
    """Check the plan, unless the folder has results of it already, and mark the folder as its own."""
    folder, plan, whole = store.folder, store.plan, options.shard == (1, 1)
    check_folder(folder, store.names)
    if options.fresh or begun(folder) is None or store.changed:
        title = f"{plan.sweep.name}: checking {plan.combinations:,} combinations"
        with tally(title, plan.checks, quiet=options.quiet) as advance:
            plan.check(advance)
    with _full_disk_told(store), nullcontext() if whole else results(folder, store.names, shared=True):
        if options.fresh:
            store.clear(None if whole or _is_other(store) else part)
        store.begin()


def _is_other(store: Store) -> bool:
    """Return whether the folder contains results unusable for this sweep and its shards."""
    try:
        return store.changed
    except ScenarioError:
        return True


@contextmanager
def _full_disk_told(store: Store) -> Iterator[None]:
    """Turn a disk-full error into a message that says which results are stored and how to continue."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        kept = sum(1 for _ in store.rows())
        text = f"{error.strerror}; {kept:,} finished runs are kept; free some space and start the same command again"
        raise OSError(error.errno, text, str(store.folder)) from None
