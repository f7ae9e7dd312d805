"""Executors of tasks: this process, a pool of processes, or the workers of a Dask scheduler."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from agrobot_mj.studies.engine.cluster import dask_cluster
from agrobot_mj.studies.engine.pool import Pool, cores
from agrobot_mj.studies.engine.tasks import Done, Task, failure, perform

DIED = "the worker process died twice on this run (killed, out of memory, or a crash of a library)"
Perform = Callable[[Iterable[Task]], Iterator[tuple[Task, Done]]]
"""Function that does tasks and yields each with its result, in the order in which they end."""


@contextmanager
def performing(jobs: int | None, scheduler: str | None = None, most: int | None = None) -> Iterator[Perform]:
    """Yield a function that does tasks: over processes, by default one per core for at most `most` tasks, or over
    Dask."""
    if scheduler:
        with dask_cluster(scheduler) as over_dask:
            yield over_dask
        return
    workers = jobs or cores()
    with Pool(workers if most is None else min(workers, most)) as pool:
        yield lambda tasks: pool.spread(perform, tasks, lambda task: failure(DIED))
