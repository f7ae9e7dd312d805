"""The limits of one or more laws: search them, write `limit.json` and `limit.png`."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.feasibility import check_tractors
from agrobot_mj.simulation.storage import write_json
from agrobot_mj.studies.engine import resuming
from agrobot_mj.studies.limit.question import Counterpart, Found, Question, Tried, at_value, check, laws
from agrobot_mj.studies.limit.search import find_limit
from agrobot_mj.studies.style import PANEL_WIDTH_IN, SPARE_COLOURS, STYLE, save

FILES = ("limit.json", "limit.png")
"""Files of a search for a limit."""


def limit(
    scenario: Scenario,
    question: Question,
    kinds: Sequence[str],
    folder: Path,
    jobs: int | None = None,
    done: Callable[[str, Tried], object] = lambda law, tried: None,
    begin: Callable[[list[Scenario]], object] = lambda ends: None,
    beside: Mapping[str, Any] | None = None,
    failed: Callable[[str], object] = lambda text: None,
) -> list[Found]:
    """Search the limit of each kind of guidance and write the answers under `folder`, which keeps the rows of its runs.

    `begin` hears of the scenarios at both ends of the range before anything is driven, `failed` of the errors that runs
    raise. `beside` has the overrides of a counterpart without the hardship, of which the same is asked. Raises
    `ScenarioError`.
    """
    scenarios = laws(scenario, kinds)
    condition = check(question, scenarios)
    for each in scenarios.values():
        each.changed(dict(beside or {}))
    starts, stops = (
        [at_value(each, question, end) for each in scenarios.values()] for end in (question.start, question.stop)
    )
    check_tractors(starts)  # where the key leads to an impossible one, that is where it fails
    begin([*starts, *stops])
    with resuming(folder, FILES, jobs, failed) as do:
        found = [
            find_limit(name, under, question, condition, do, partial(done, name), beside)
            for name, under in scenarios.items()
        ]
        write_json(folder / "limit.json", content(scenario, question, found))
        with mpl.rc_context(STYLE):
            save(figure(question, found), folder / "limit.png")
    return found


def content(scenario: Scenario, question: Question, found: Sequence[Found]) -> dict[str, Any]:
    """`limit.json`: the question, and for each law the verdict and every value tried."""
    return {
        "scenario": scenario.name,
        "version": __version__,
        **question._asdict(),
        "tolerance": question.resolution,
        "first_seed": scenario.seed,
        "laws": [{**_plain(each), "beside": each.beside and _plain(each.beside)} for each in found],
    }


def _plain(found: Found | Counterpart) -> dict[str, Any]:
    """An answer as plain data."""
    return {**found._asdict(), "tried": [tried.written for tried in found.tried]}


def figure(question: Question, found: Sequence[Found]) -> Figure:
    """Success rate over the key with its interval, one panel per law; where it stops holding is shaded."""
    drawn = Figure((PANEL_WIDTH_IN, 1.5 * len(found) + 0.6), layout="constrained")
    grid = drawn.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each, k in zip(grid, found, range(len(found)), strict=True):
        colour = SPARE_COLOURS[k % len(SPARE_COLOURS)]
        values = [t.value for t in each.tried]
        rates = [100 * (1 - t.failed / t.runs) for t in each.tried]
        lower = [rate - 100 * t.low for rate, t in zip(rates, each.tried, strict=True)]
        upper = [100 * t.high - rate for rate, t in zip(rates, each.tried, strict=True)]
        if each.interval:
            axes.axvspan(*each.interval, color="#DDDDDD", linewidth=0)
        axes.axhline(100 * question.reliability, color="black", linewidth=0.6, linestyle="--")
        # Rounding may leave a bar a hair below zero length, which matplotlib refuses.
        bars = [[max(0.0, b) for b in lower], [max(0.0, b) for b in upper]]
        axes.errorbar(values, rates, bars, color=colour, marker="o", markersize=3, linewidth=0.9, capsize=2)
        axes.set(ylim=(-5, 105), title=each.law)
    drawn.supylabel(f"successful runs, {question.confidence:.0%} interval [%]", fontsize=8)
    grid[-1].set_xlabel(question.key)
    return drawn
