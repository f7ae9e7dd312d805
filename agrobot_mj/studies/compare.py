"""A comparison: its runs, their folders and rows, and the paper's figures."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.scenario.plugins import load_files, loaded_files
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import write_json, write_log
from agrobot_mj.studies.compare_plan import Case
from agrobot_mj.studies.report import write_figures

MOST_DRAWN = 24
"""Laws that figures and the common recording show; more could not be told apart."""


def compare(
    todo: Sequence[Case],
    folder: Path,
    rrd: bool = True,
    jobs: int | None = None,
    done: Callable[[Case], None] = lambda case: None,
) -> list[dict[str, Any]]:
    """Run all cases, some at a time, and write everything under `folder`; returns the rows of comparison.json.

    Figures and the common recording are of the first seed and the first `MOST_DRAWN` laws.
    """
    workers = min(len(todo), jobs or os.cpu_count() or 1)
    shown = drawn(todo)
    wanted = {case.folder for case in shown}
    metrics: dict[str, dict[str, Any]] = {}
    logs: dict[str, Log] = {}

    def keep(case: Case, result: tuple[dict[str, Any], Log | None]) -> None:
        metrics[case.folder], log = result
        if log is not None:
            logs[case.folder] = log
        done(case)

    if workers == 1:
        for case in todo:
            keep(case, _run_case(case, folder, rrd, case.folder in wanted))
    else:
        with _pool(workers) as pool:
            futures = {pool.submit(_run_case, case, folder, rrd, case.folder in wanted): case for case in todo}
            for future in as_completed(futures):
                keep(futures[future], future.result())
    rows = [_row(case, metrics[case.folder]) for case in todo]
    write_json(folder / "comparison.json", rows)
    if rrd:
        write_comparison([(f"{case.plant}-{case.law}", logs[case.folder]) for case in shown], folder / "comparison.rrd")
    write_figures([(case.plant, case.law, logs[case.folder]) for case in shown], folder)
    return rows


def drawn(todo: Sequence[Case]) -> list[Case]:
    """The cases that figures show."""
    laws = list(dict.fromkeys(case.law for case in todo))[:MOST_DRAWN]
    return [case for case in todo if case.seed == todo[0].seed and case.law in laws]


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A process pool that leaves no process behind, however the block ends."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin_worker, initargs=(loaded_files(),))
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()


def _begin_worker(plugins: tuple[Path, ...]) -> None:
    """Start a worker: load the parent's plugins first, since its scenarios may be of their kinds."""
    _leave_signals_to_the_parent()
    load_files(plugins)


def _leave_signals_to_the_parent() -> None:
    """Ignore Ctrl-C in a worker, since the parent ends its workers itself; end the worker if the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_case(case: Case, folder: Path, rrd: bool, wanted: bool) -> tuple[dict[str, Any], Log | None]:
    """Metrics of a case, and its log if it is wanted: thousands of logs would not fit into memory."""
    place = folder / case.folder
    log = run(case.scenario, (Recording(place / "run.rrd"),) if rrd else ())
    write_log(log, place)
    return log.metrics, log if wanted else None


def _row(case: Case, metrics: dict[str, Any]) -> dict[str, Any]:
    law = {"controller": case.controller, "guidance": case.scenario.guidance.kind, "variant": case.variant}
    return {"plant": case.plant, **law, "seed": case.seed, "folder": case.folder, **metrics}
