"""Falsification command: searches for the mildest failing combination of key values and writes `falsify.json`,
`falsify.png` and a recording."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLACK, BLUE, VERMILION
from agrobot_mj.extensions.search.closeness import Closeness, check_closeness
from agrobot_mj.extensions.search.courses import courses, courses_figure
from agrobot_mj.extensions.search.falsify.search import (
    CONFIRMED,
    NOT_FOUND,
    Combination,
    Falsified,
    FalsifyQuestion,
    FalsifySearch,
)
from agrobot_mj.extensions.search.limit.question import condition_of
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies import Task, about, check_tractors, study, write_json
from agrobot_mj.studies.style import write_figure

FAILURE = {"run.rrd": "failure.rrd", "signals.parquet": "failure.parquet", "scenario.toml": "failure.toml"}
"""Names of the files of the failing run, and of their copies in the results folder."""
FILES = ("falsify.json", "falsify.png", *FAILURE.values())
"""Files that a falsification writes. Without a failing combination, the files of the failing run are missing."""


def falsify(
    scenario: Scenario,
    question: FalsifyQuestion,
    folder: Path,
    jobs: int | None = None,
    done: Callable[[Combination], object] = lambda tried: None,
) -> Falsified:
    """Search for the mildest combination of values of scenario keys with which the run fails. Write the result and the
    table of all runs to `folder`."""
    question.check(scenario)
    mild = scenario.changed(question.overrides(scenario, (0.0,) * len(question.varied)))
    check_tractors([mild, mild.changed({"seed": scenario.seed + max(question.seeds, CONFIRMED) - 1})])
    condition, closeness = condition_of(question.until, mild), Closeness(question.until, question.score)
    check_closeness(closeness, mild)
    with study(folder, FILES, jobs) as do:
        found = FalsifySearch(scenario, question, condition, do, done).run()
        tasks = [Task.of(scenario, each.values) for each in (found.tried[0], found.mildest)]
        driven = courses(tasks, closeness, do, {} if found.verdict == NOT_FOUND else FAILURE)
        write_json(folder / "falsify.json", content(scenario, question, found))
        write_figure(folder / "falsify.png", figure, question, found, driven)
    return found


def content(scenario: Scenario, q: FalsifyQuestion, found: Falsified) -> dict[str, Any]:
    """Return the content of `falsify.json`: settings, result with its neighbours, and all evaluated combinations."""
    return {
        **about(scenario),
        **q._asdict(),
        "varied": [each._asdict() for each in q.varied],
        "first_seed": scenario.seed,
        "verdict": found.verdict,
        "statement": found.statement,
        "mildest": {**found.mildest._asdict(), "distance": found.mildest.distance},
        "alone": {key: tried._asdict() for key, tried in found.alone.items()},
        "around": [tried._asdict() for tried in found.around],
        "tried": [tried._asdict() for tried in found.tried],
    }


def figure(q: FalsifyQuestion, found: Falsified, driven: list[dict[str, Any]]) -> Figure:
    """Return a figure of all evaluated combinations, drawn versus the two keys that change most in the result, and of
    the trajectories at the mild values and at the result."""
    drawn, beside, _ = courses_figure(driven, ("all mild", _name(found)))
    _draw_tried(beside, q, found)
    return drawn


def _name(found: Falsified) -> str:
    return "closest" if found.verdict == NOT_FOUND else "answer"


def _draw_tried(axes: Axes, q: FalsifyQuestion, found: Falsified) -> None:
    order = sorted(range(len(q.varied)), key=lambda k: -abs(found.mildest.distances[k]))
    x, *more = [q.varied[k].key for k in order[:2]]

    def place(tried: Combination) -> tuple[float, float]:
        return tried.values[x], tried.values[more[0]] if more else tried.close

    for fails, colour, marker, label in ((False, BLUE, "o", "holds"), (True, VERMILION, "x", "fails")):
        if places := [place(tried) for tried in found.tried if tried.fails is fails]:
            axes.plot(*zip(*places, strict=True), marker, color=colour, markersize=3, label=label)
    axes.plot(*place(found.mildest), "*", color=BLACK, markersize=8, label=_name(found))
    axes.set(xlabel=x, ylabel=more[0] if more else "margin to failure [-]")
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
