"""Execution of tasks in this process, in a process pool, or by the workers of a Dask scheduler.

Dask workers need the same code (`core.identity`), plugin files at the same paths, and access to the results folder,
which contains copies of the input files.
"""

import gc
import logging
import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import TYPE_CHECKING, TypeVar

from agrobot_mj.core.errors import ScenarioError, import_extra
from agrobot_mj.core.identity import code_text, differing
from agrobot_mj.core.interrupts import deferring, held_back
from agrobot_mj.core.kernel_cache import CACHE
from agrobot_mj.scenario.plugins import load_plugins, loaded_files
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies.engine.tasks import Done, Task, failure, other_code, perform

AHEAD = 2
"""Maximum number of submitted work items per worker: one running and one waiting, to limit the memory usage."""
UNSTARTED = (
    "no worker process can start because the import of the main program fails there; save the program as a file with "
    'its code below `if __name__ == "__main__":`, or use one job'
)
Work = TypeVar("Work")
Result = TypeVar("Result")


def cores() -> int:
    """Return the number of processor cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Pool:
    """Context manager for a pool of worker processes. A pool of one worker uses this process.

    Workers load the plugins of this process, and exit if this process is killed. Their temporary files are deleted at
    the end.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> "Pool":
        self._scratch = TemporaryDirectory(prefix="agrobot-mj-", ignore_cleanup_errors=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(kind is not None)
        self._scratch.cleanup()

    def spread(
        self, function: Callable[[Work], Result], todo: Iterable[Work], died: Callable[[Work], Result] | None = None
    ) -> Iterator[tuple[Work, Result]]:
        """Yield each work item with its result, in order of completion.

        If a worker dies, all other workers are terminated and the items in progress are repeated one by one. If an item
        kills its worker again, its result is `died(work)`; without `died`, `BrokenProcessPool` is raised. Raise
        `ScenarioError` if no worker can start.
        """
        if self.workers <= 1:
            for work in todo:
                with deferring():  # signals take effect between two ticks or after the work item
                    result = function(work)
                yield work, result
            return
        todo, suspects = iter(todo), list[Work]()
        while True:
            self._executor = self._executor or _executor(self.workers, self._scratch.name)
            for work, future in stream(self._executor, function, todo, AHEAD * self.workers):
                if isinstance(future.exception(), BrokenProcessPool):
                    suspects.append(work)
                else:
                    yield work, future.result()
            if not suspects:
                return
            self._end(at_once=True)
            for work in suspects:
                yield work, self._alone(function, work, died)
            suspects = []

    def _alone(self, function: Callable[[Work], Result], work: Work, died: Callable[[Work], Result] | None) -> Result:
        executor = _executor(1, self._scratch.name)
        try:
            with held_back():
                started = executor.submit(os.getpid)
            if isinstance(started.exception(), BrokenProcessPool):
                raise ScenarioError(UNSTARTED)
            return executor.submit(function, work).result()
        except BrokenProcessPool:
            if died is None:
                raise
            return died(work)
        finally:
            _stop(executor, at_once=True)

    def _end(self, at_once: bool) -> None:
        executor, self._executor = self._executor, None
        if executor:
            _stop(executor, at_once)


def pool_map(function: Callable[[Work], Result], todo: Iterable[Work], workers: int) -> Iterator[tuple[Work, Result]]:
    """Yield each work item with its result, computed by a temporary pool of worker processes as in `Pool.spread`."""
    with Pool(workers) as pool:
        yield from pool.spread(function, todo)


@contextmanager
def compiling_beside(scenario: Scenario) -> Iterator[None]:
    """Compile the control loop in a second process within the context, if the cache of compiled code is empty.

    The process simulates the scenario on the bicycle model and flat ground, which compiles everything except the
    physics.
    """
    if CACHE is None or any(CACHE.rglob("*.nbi")) or cores() < 2:
        yield
        return
    with TemporaryDirectory(prefix="agrobot-mj-", ignore_cleanup_errors=True) as scratch:
        helper = _executor(1, scratch)
        try:
            with held_back():
                helper.submit(perform, Task.of(scenario, {"plant.kind": "bicycle", "terrain.kind": "flat"}))
            yield
        finally:
            _stop(helper, at_once=True)


def _executor(workers: int, scratch: str) -> ProcessPoolExecutor:
    context, known = multiprocessing.get_context("spawn"), (loaded_files(), scratch)
    try:
        return ProcessPoolExecutor(workers, mp_context=context, initializer=_begin_worker, initargs=known)
    except OSError as error:  # the semaphores of the queues cannot be created
        raise ScenarioError(
            f"worker processes need shared memory, on Linux in /dev/shm: {error.strerror}; make /dev/shm writable, or "
            "use one job"
        ) from error


def _stop(executor: ProcessPoolExecutor, at_once: bool) -> None:
    for process in list((executor._processes or {}).values()) if at_once else ():
        process.terminate()
    executor.shutdown(wait=True, cancel_futures=at_once)


def stream(
    executor: Executor, function: Callable[[Work], Result], todo: Iterator[Work], window: int
) -> "Iterator[tuple[Work, Future[Result]]]":
    """Yield each work item with its completed future. At most `window` items are submitted at the same time."""
    first = list(islice(todo, window))
    first[1:1] = first[2:] and [first.pop()]  # the first and last item differ most: workers compile different kernels
    running = {_handed_out(executor, function, work): work for work in first}
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future
            if not isinstance(future.exception(), BrokenProcessPool):
                running |= {_handed_out(executor, function, work): work for work in islice(todo, 1)}


def _handed_out(executor: Executor, function: Callable[[Work], Result], work: Work) -> "Future[Result]":
    try:
        with held_back():  # a signal would interrupt the message to a starting worker
            return executor.submit(function, work)
    except BrokenProcessPool as error:
        refused: Future[Result] = Future()
        refused.set_exception(error)
        return refused


def _begin_worker(plugins: tuple[Path, ...], scratch: str) -> None:
    tempfile.tempdir = scratch
    _leave_signals_to_the_parent()
    load_plugins(plugins)
    gc.freeze()  # garbage collections do not search the modules


def _leave_signals_to_the_parent() -> None:
    """Ignore Ctrl-C in a worker process, because its parent handles the signal, and exit if the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


if TYPE_CHECKING:
    from distributed import Client

PATIENCE_S = 10  # Time limit for a response of a Dask scheduler [s]


@contextmanager
def dask_cluster(address: str) -> Iterator[Callable[[Iterable[Task]], Iterator[tuple[Task, Done]]]]:
    """Yield a function that executes tasks on the workers of the Dask scheduler at `address`."""
    # Dask logs a traceback if the scheduler is lost. This module raises a readable error instead.
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
                f"--scheduler {address}: the connection was lost; finished runs are kept; run the same command again"
            ) from None


def _client(address: str) -> "Client":
    distributed = import_extra("distributed", "cluster", "--scheduler")
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
        raise ScenarioError(
            f"--scheduler {address}: the scheduler has no workers; start one with: dask worker {address}"
        )
    for worker, text in codes.items():
        if apart := differing(text, code_text()):
            raise ScenarioError(f"--scheduler {address}: worker {worker} uses {other_code(apart)}")
    return max(1, sum(map(int, client.nthreads().values())))


def _ready(plugins: tuple[Path, ...]) -> str:
    load_plugins(plugins)
    return code_text()


def _perform(task: Task, plugins: tuple[Path, ...]) -> Done:
    load_plugins(plugins)  # needed by workers that join later
    return perform(task)


DIED = "the worker process died twice on this run (killed, out of memory, or a crash of a library)"
Perform = Callable[[Iterable[Task]], Iterator[tuple[Task, Done]]]
"""Type of a function that executes tasks and yields each task with its result, in order of completion."""


@contextmanager
def performing(jobs: int | None, scheduler: str | None = None, most: int | None = None) -> Iterator[Perform]:
    """Yield a function that executes tasks: with Dask if `scheduler` is given, otherwise with `jobs` processes.

    Default of `jobs`: the number of cores, at most `most`.
    """
    if scheduler:
        with dask_cluster(scheduler) as over_dask:
            yield over_dask
        return
    workers = jobs or cores()
    with Pool(workers if most is None else min(workers, most)) as pool:
        yield lambda tasks: pool.spread(perform, tasks, lambda task: failure(DIED))
