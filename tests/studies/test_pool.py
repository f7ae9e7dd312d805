"""Pool of worker processes."""

import errno
import multiprocessing.synchronize
import os
import signal
import sys
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.studies.engine import workers as pool


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_does_not_interrupt_the_start_of_a_worker():
    """Workers start in `submit`; a worker that receives an incomplete message prints a traceback."""
    told = []

    def submit(function, work):
        signal.raise_signal(signal.SIGINT)
        told.append(work)
        done = Future()
        done.set_result(None)
        return done

    with pytest.raises(KeyboardInterrupt):
        list(pool.stream(SimpleNamespace(submit=submit), print, iter("ab"), 2))
    assert told == ["a"]


def test_failure_to_start_workers_is_not_attributed_to_a_run(monkeypatch):
    """Workers cannot import a program on standard input, so each worker dies with any task."""
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None, raising=False)
    monkeypatch.setattr(sys.modules["__main__"], "__file__", "<stdin>", raising=False)
    with pool.Pool(2) as workers, pytest.raises(ScenarioError, match=r"no worker process can start .* __name__"):
        list(workers.spread(abs, [-1, -2], died=lambda work: 0))


def test_error_for_unwritable_shared_memory_names_the_memory(monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(multiprocessing.synchronize.SemLock, "__init__", refuse)
    with pytest.raises(ScenarioError, match=r"shared memory, on Linux in /dev/shm: Read-only file system; .*one job"):
        list(pool.pool_map(abs, [-1, -2], workers=2))


def test_pool_starts_the_first_and_the_last_run_at_the_same_time():
    """These runs differ most, so the workers of a comparison compile different kernels at the same time."""
    order = []

    def submit(function, work):
        order.append(work)
        done = Future()
        done.set_result(None)
        return done

    done = [work for work, _ in pool.stream(SimpleNamespace(submit=submit), print, iter(range(6)), 4)]
    assert order == [0, 3, 1, 2, 4, 5]
    assert sorted(done) == list(range(6))


@pytest.mark.parametrize(("files", "cores", "begun"), [((), 2, 1), (("run_steps.nbi",), 2, 0), ((), 1, 0)])
def test_background_compilation_needs_an_empty_cache_and_a_free_core(monkeypatch, tmp_path, files, cores, begun):
    submitted, ended = [], []
    for name in files:
        (tmp_path / name).touch()
    executor = SimpleNamespace(submit=lambda function, task: submitted.append(task))
    monkeypatch.setattr(pool, "CACHE", tmp_path)
    monkeypatch.setattr(pool, "cores", lambda: cores)
    monkeypatch.setattr(pool, "_executor", lambda workers, scratch: executor)
    monkeypatch.setattr(pool, "_stop", lambda executor, at_once: ended.append(at_once))
    with pool.compiling_beside(load_scenario("side_slope_10")):
        assert (len(submitted), ended) == (begun, [])
    assert ended == [True] * begun
    assert all(
        pool.perform(task._replace(overrides={**task.overrides, "duration_s": 0.1})).row["error"] is None
        for task in submitted
    )
