"""The limits of one or more laws: search them, write `limit.json` and `limit.png`."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.storage import write_json
from agrobot_mj.studies.drawing import can_draw
from agrobot_mj.studies.limit.search import Found, Question, RunTasks, Tried, check, find_limit, laws
from agrobot_mj.studies.pool import cores, pool
from agrobot_mj.studies.sweep.work import perform


def limit(
    scenario: Scenario,
    question: Question,
    kinds: Sequence[str],
    folder: Path,
    jobs: int | None = None,
    done: Callable[[str, Tried], object] = lambda law, tried: None,
) -> list[Found]:
    """Search the limit of each kind of guidance and write the answers under `folder`. Raises `ScenarioError`."""
    scenarios = laws(scenario, kinds)
    condition = check(question, scenarios)
    found = []
    with _workers(jobs or cores()) as do:
        for name, under in scenarios.items():
            found.append(find_limit(name, under, question, condition, do, partial(done, name)))
    write_json(folder / "limit.json", content(scenario, question, found))
    if can_draw():
        from agrobot_mj.studies.limit.figure import write_figure

        write_figure(question, found, folder / "limit.png")
    return found


@contextmanager
def _workers(jobs: int) -> Iterator[RunTasks]:
    """Runs in this process, or in some that live as long as the block."""
    if jobs == 1:
        yield lambda tasks: [perform(task) for task in tasks]
        return
    with pool(jobs) as executor:
        try:
            yield lambda tasks: list(executor.map(perform, tasks))
        except BrokenProcessPool:
            raise ScenarioError("limit: a worker process died in a run; --jobs 1 shows why") from None


def content(scenario: Scenario, question: Question, found: Sequence[Found]) -> dict[str, Any]:
    """`limit.json`: the question, and for each law the verdict and every value tried."""
    return {
        "scenario": scenario.name,
        "version": __version__,
        **question._asdict(),
        "tolerance": question.resolution,
        "first_seed": scenario.seed,
        "laws": [{**each._asdict(), "tried": [tried._asdict() for tried in each.tried]} for each in found],
    }
