"""A sweep from file to table: check the plan, do what is missing, write each row as it comes, the table at the end."""

import errno
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import check_folder, remove, results
from agrobot_mj.studies.engine import Done, Task, performing
from agrobot_mj.studies.sweep.plan import MAX_RUNS, SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import TABLE, Store, merge

MOST_HEARD = 100
"""Largest number of scenarios, evenly over the plan, that are checked for hints."""
Begin = Callable[[Iterator[Scenario]], object]
"""Function that is called with scenarios before they are driven."""
Shard = tuple[int, int]
"""Number of this part, from 1, and how many parts there are."""


class SweepOptions(NamedTuple):
    """How a sweep is to be done."""

    jobs: int | None = None
    """Number of processes; None for as many as there are cores."""
    scheduler: str | None = None
    """Address of a Dask scheduler that does the work instead."""
    shard: Shard = (1, 1)
    """Part of the runs to do."""
    fresh: bool = False
    """Whether to discard what is there."""
    max_runs: int = MAX_RUNS
    """Most runs allowed."""
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
    """Run a sweep into `folder`, or what is missing of it there. Raises `ScenarioError` before anything runs.

    `begin` hears of some of its scenarios before that.
    """
    plan, store = SweepPlan(read_sweep(source)), Store(folder)
    plan.check_size(options.max_runs)  # before anything goes through its values
    with results(folder, store.names(plan)) if _is_whole(options) else nullcontext():
        return _complete(plan, store, options, begin)


def _is_whole(options: SweepOptions) -> bool:
    """Whether the sweep has its folder for itself; shards may share one, since each has runs of its own."""
    return options.shard == (1, 1)


def _complete(plan: SweepPlan, store: Store, options: SweepOptions, begin: Begin) -> SweepSummary:
    """Do what is missing of a sweep in its folder."""
    part = range(options.shard[0] - 1, plan.total, options.shard[1])
    _prepare(plan, store, options, part)
    begin(plan.some(MOST_HEARD))
    todo = [number for number in part if not store.finished(plan, number)]
    store.tell_again()
    before, unexpected, errors = len(part) - len(todo), 0, 0
    if todo:
        remove(store.folder, (TABLE,))
    with (
        _full_disk_told(store),
        _table_in_the_end(store),
        tally(f"{plan.sweep.name}: {len(part):,} runs", len(part), before, options.quiet) as advance,
        closing(_results(plan, store, todo, options)) as results,
    ):
        for each, result in results:
            run, expected = plan.run(each.number), bool(result.numbers["expected"])
            store.put(run.number, store.task(plan, run.number)[1], store.row(run, result, plan), result.files)
            unexpected += not expected
            errors += result.numbers["error"] is not None
            advance(expected=expected)
    return SweepSummary(store.folder, plan.total, before, len(todo), unexpected, errors)


def merged(sources: Sequence[Path], folder: Path) -> tuple[int, int]:
    """Bring parts of a sweep together in `folder`; returns how many rows its table has, and should have."""
    store = Store(folder)
    if not sources:
        raise ScenarioError(f"{folder}: no such folder; --merge joins the folders that --shard has written")
    with results(folder, (TABLE,), shared=True), _full_disk_told(store):
        common = merge(sources, store)
        return store.write_table(), int(common["runs"])


def _prepare(plan: SweepPlan, store: Store, options: SweepOptions, part: range) -> None:
    """Check the plan, unless the folder has results of it already, and mark the folder as its own."""
    folder, names = store.folder, store.names(plan)
    check_folder(folder, names)
    new = options.fresh or store.begun is None or bool(store.changes(plan))
    if new:
        title = f"{plan.sweep.name}: checking {plan.combinations:,} combinations"
        with tally(title, plan.checks, quiet=options.quiet) as advance:
            plan.check(advance)
    with _full_disk_told(store), nullcontext() if _is_whole(options) else results(folder, names, shared=True):
        if options.fresh:
            others = not _is_whole(options) and not _is_other(store, plan)
            store.clear(part if others else None)
        elif new and store.begun is not None:
            store.clear(set(store.stale(plan)))
        store.begin(plan)


def _is_other(store: Store, plan: SweepPlan) -> bool:
    """Whether what is in the folder is of no use to this sweep, nor to another shard of it."""
    try:
        return bool(store.changes(plan))
    except ScenarioError:
        return True


def _results(plan: SweepPlan, store: Store, todo: Sequence[int], options: SweepOptions) -> Generator[tuple[Task, Done]]:
    if todo:
        with performing(options.jobs, options.scheduler, len(todo)) as perform:
            yield from perform(store.task(plan, number)[0] for number in todo)


@contextmanager
def _table_in_the_end(store: Store) -> Iterator[None]:
    """Write the table once the block ends, also when it is broken off; not if it has all rows already."""
    try:
        yield
    except (KeyboardInterrupt, ScenarioError):
        store.write_table()
        raise
    if store.in_table != store.count:
        store.write_table()


@contextmanager
def _full_disk_told(store: Store) -> Iterator[None]:
    """A full disk as a message that says what is safe and what to do."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        kept = sum(1 for _ in store.rows())
        text = f"{error.strerror}; {kept:,} finished runs are kept; free some space and start the same command again"
        raise OSError(error.errno, text, str(store.folder)) from None
