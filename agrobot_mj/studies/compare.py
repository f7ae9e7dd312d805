"""One scenario under several controllers, plants and seeds: folders, rows, and the paper's figures."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.scenario.plugins import load_files, loaded_files
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import claimed, write_json, write_log
from agrobot_mj.studies.report import write_figures

PLANTS = ("bicycle", "mujoco")
"""Plants of a comparison unless others are named."""


class Case(NamedTuple):
    """One run of a comparison."""

    plant: str
    controller: str
    seed: int
    scenario: Scenario

    @property
    def folder(self) -> str:
        """Name of the run's folder."""
        return f"{self.plant}-{self.controller}-s{self.seed}"


def cases(scenario: Scenario, controllers: Sequence[str], plants: Sequence[str], seeds: int) -> list[Case]:
    """Every combination, checked; seeds count up from the scenario's. Raises `ScenarioError`."""
    return [
        Case(
            plant,
            controller,
            seed,
            scenario.changed({"plant.kind": plant, "controller.kind": controller, "seed": seed}),
        )
        for plant in plants
        for controller in controllers
        for seed in range(scenario.seed, scenario.seed + seeds)
    ]


def runnable(scenario: Scenario, plants: Sequence[str] = PLANTS) -> tuple[list[str], list[str]]:
    """Those of `plants` that can run the scenario, and one line per other plant that says why it cannot."""
    able, left_out = [], []
    for plant in plants:
        try:
            scenario.changed({"plant.kind": plant})
            able.append(plant)
        except ScenarioError as error:
            left_out.append(f"{plant} is left out: {str(error).splitlines()[0]}")
    return able, left_out


def compare(
    todo: Sequence[Case],
    folder: Path,
    rrd: bool = True,
    jobs: int | None = None,
    done: Callable[[Case], None] = lambda case: None,
) -> list[dict[str, Any]]:
    """Run all cases, some at a time, and write everything under `folder`; returns the rows of comparison.json."""
    workers = min(len(todo), jobs or os.cpu_count() or 1)
    logs: dict[str, Log] = {}
    if workers == 1:
        for case in todo:
            logs[case.folder] = _run_case(case, folder, rrd)
            done(case)
    else:
        with _pool(workers) as pool:
            futures = {pool.submit(_run_case, case, folder, rrd): case for case in todo}
            for future in as_completed(futures):
                logs[futures[future].folder] = future.result()
                done(futures[future])
    rows = [_row(case, logs[case.folder]) for case in todo]
    write_json(folder / "comparison.json", rows)
    first = [case for case in todo if case.seed == todo[0].seed]
    if rrd:
        named = [(f"{case.plant}-{case.controller}", logs[case.folder]) for case in first]
        write_comparison(named, folder / "comparison.rrd")
    write_figures([(case.plant, case.controller, logs[case.folder]) for case in first], folder)
    return rows


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


def _run_case(case: Case, folder: Path, rrd: bool) -> Log:
    place = folder / case.folder
    with claimed(place):
        log = run(case.scenario, (Recording(place / "run.rrd"),) if rrd else ())
        write_log(log, place, recorded=rrd)
    return log


def _row(case: Case, log: Log) -> dict[str, Any]:
    return {"plant": case.plant, "controller": case.controller, "seed": case.seed, **log.metrics}
