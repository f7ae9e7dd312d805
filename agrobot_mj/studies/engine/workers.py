"""Execution of tasks by this process, by a pool of processes, or by the workers of an existing Dask scheduler.

Workers of a scheduler need the same code (`core.identity`), plugin files at the same paths, and access to the results
folder with the copies of input files.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from agrobot_mj.core.errors import ScenarioError, required
from agrobot_mj.core.identity import code_text, differing
from agrobot_mj.scenario.plugins import load_plugins, loaded_files
from agrobot_mj.studies.engine.pool import AHEAD, Pool, cores, stream
from agrobot_mj.studies.engine.tasks import Done, Task, failure, other_code, perform

if TYPE_CHECKING:
    from distributed import Client

PATIENCE_S = 10
"""Time limit for an answer of a scheduler [s]."""


@contextmanager
def dask_cluster(address: str) -> Iterator[Callable[[Iterable[Task]], Iterator[tuple[Task, Done]]]]:
    """Yield a function that performs tasks with a Dask scheduler."""
    # Dask reports a lost scheduler as a traceback; this module raises a readable error.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    with _client(address) as client:
        window = AHEAD * _workers(client, address)
        executor, function = client.get_executor(pure=False), partial(_perform, plugins=loaded_files())

        def over_dask(tasks: Iterable[Task]) -> Iterator[tuple[Task, Done]]:
            for task, future in stream(executor, function, iter(tasks), window):
                error = future.exception()
                if isinstance(error, OSError | ScenarioError):
                    raise error
                yield task, future.result() if error is None else failure(f"{type(error).__name__}: {error}")

        try:
            yield over_dask
        except CancelledError:
            raise ScenarioError(
                f"--scheduler {address}: the connection is lost; finished runs are kept; start the same command again"
            ) from None


def _client(address: str) -> "Client":
    distributed = required("distributed", "cluster", "--scheduler")
    try:
        return distributed.Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = f"no answer within {PATIENCE_S} s" if isinstance(error, TimeoutError) else str(error).splitlines()[0]
        raise ScenarioError(
            f"--scheduler {address}: the scheduler cannot be reached: {reason}; specify its address as tcp://HOST:8786"
        ) from None


def _workers(client: "Client", address: str) -> int:
    try:
        codes: dict[str, str] = client.run(_ready, loaded_files())
    except Exception as error:
        raise ScenarioError(f"--scheduler {address}: a worker is not ready: {type(error).__name__}: {error}") from None
    if not codes:
        raise ScenarioError(f"--scheduler {address}: it has no workers; start one with: dask worker {address}")
    for worker, text in codes.items():
        if apart := differing(text, code_text()):
            raise ScenarioError(f"--scheduler {address}: worker {worker} has {other_code(apart)}")
    return max(1, sum(map(int, client.nthreads().values())))


def _ready(plugins: tuple[Path, ...]) -> str:
    load_plugins(plugins)
    return code_text()


def _perform(task: Task, plugins: tuple[Path, ...]) -> Done:
    load_plugins(plugins)  # for workers that join later
    return perform(task)


DIED = "the worker process died twice on this run (killed, out of memory, or a crash of a library)"
Perform = Callable[[Iterable[Task]], Iterator[tuple[Task, Done]]]
"""Function that performs tasks and yields each task with its result, in order of completion."""


@contextmanager
def performing(jobs: int | None, scheduler: str | None = None, most: int | None = None) -> Iterator[Perform]:
    """Yield a function that performs tasks, with Dask if `scheduler` is given, otherwise with `jobs` processes. Default
    of `jobs`: number of cores, at most `most`."""
    if scheduler:
        with dask_cluster(scheduler) as over_dask:
            yield over_dask
        return
    workers = jobs or cores()
    with Pool(workers if most is None else min(workers, most)) as pool:
        yield lambda tasks: pool.spread(perform, tasks, lambda task: failure(DIED))
