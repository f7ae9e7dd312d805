"""Command that estimates a failure probability: splits runs by their margin and writes `risk.json`, `risk.png` and a
failed run."""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLACK, BLUE
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.search.closeness import Closeness, check_closeness
from agrobot_mj.extensions.search.courses import courses, courses_figure
from agrobot_mj.extensions.search.limit.question import condition_of
from agrobot_mj.extensions.search.risk.population import AHEAD_S, Population, Run, populations
from agrobot_mj.extensions.search.risk.splitting import CONFIDENCE, RiskEstimate, RiskQuestion, Split, estimate
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.progress import tally
from agrobot_mj.studies import Row, Task, about, check_tractors, study, write_json
from agrobot_mj.studies.style import write_figure

FAILURE = {"run.rrd": "failure.rrd", "signals.parquet": "failure.parquet"}
"""Names of the files of a failed run, and of their copies in the results folder."""
EMPTY = 0.25
"""Fraction of splittings without failure above which the interval is too narrow [-]. In the example of the page, the
fraction is 0.6 with 20 particles, whose intervals are too narrow, and 0.1 with 50."""
FILES = ("risk.json", "risk.png", *FAILURE.values())


class Risk(NamedTuple):
    """Result of a risk estimation."""

    estimate: RiskEstimate
    paths: int  # Number of simulated runs, including runs that share their initial part with another run
    worth: float  # Simulated time of all complete and partial runs, divided by the time of one complete run [-]
    statement: str
    splits: tuple[Split, ...]
    ordinary: Run  # Ordinary run for the figure: of the runs simulated from the start, the one with the median margin
    failure: Run | None


def risk(
    scenario: Scenario,
    question: RiskQuestion,
    folder: Path,
    jobs: int | None = None,
    done: Callable[[Population], object] = lambda population: None,
    quiet: bool = True,
) -> Risk:
    """Estimate the probability that a run fails. Write the result and the rows of all runs to `folder`."""
    question.check()
    check_tractors([scenario, scenario.changed({"seed": scenario.seed + question.particles * question.repeats - 1})])
    condition, closeness = condition_of(question.until, scenario), Closeness(question.until, question.score)
    check_closeness(closeness, scenario)
    with study(folder, FILES, jobs) as do:
        rounds = count(1)

        def drive(tasks: Sequence[Task]) -> list[Row]:
            title = f"{scenario.name}, round {next(rounds)}: {len(tasks)} runs"
            with tally(title, len(tasks), quiet=quiet) as advance:
                return do(tasks, done=lambda expected, there: advance(there=there))

        found = answer(scenario, question, populations(scenario, question, condition, drive, done))
        shown = [found.ordinary, *([found.failure] if found.failure else [])]
        tasks = [Task.of(scenario, {"seed": run.seed}, branches=run.branches) for run in shown]
        driven = courses(tasks, closeness, do, FAILURE)
        write_json(folder / "risk.json", content(scenario, question, found))
        write_figure(folder / "risk.png", figure, found.splits, driven, question.score)
    return found


def answer(scenario: Scenario, q: RiskQuestion, done: Sequence[Population]) -> Risk:
    """Return the failure probability and its explanation from completed executions of the splitting algorithm."""
    splits = tuple(each.split for each in done if each.split)
    found, runs, worth = estimate(splits, q.particles), [run for each in done for run in each.runs], worth_of(done)
    driven = f"{len(runs):,} runs with the duration of {worth:,.0f} complete ones"
    if found.probability:
        text = f"a run fails with a probability of {found.probability:.2g}"
        text += f" ({100 * CONFIDENCE:.0f} % interval {found.low:.2g} to {found.high:.2g}), from {driven}"
        crude = found.probability * (1 - found.probability) / found.error**2 if found.error else 0.0
        text += f"; plain Monte Carlo would need {crude:,.0f} runs for the same standard error" if crude else ""
        empty = sum(not split.probability for split in splits)
        if empty > EMPTY * len(splits):
            text += f"; {empty} of {len(splits)} splittings found no failure, so the interval is unreliable"
            text += "; increase --particles"
        flaws = Counter(run.flaw for run in runs if run.flaw)
        text += f"; these include {', '.join(f'{n} {flaw}' for flaw, n in flaws.items())}" if flaws else ""
    else:
        text = f"no failure in {driven}; the probability of failure is below about {found.high:.1g}"
    plain = sorted((run for run in runs if not run.branches), key=lambda run: run.level)
    failure = next((run for run in runs if run.failed and run.ticks), None)
    statement = f"{scenario.name}: {q.until}: {text}"
    return Risk(found, len(runs), worth, statement, splits, plain[len(plain) // 2], failure)


def worth_of(done: Sequence[Population]) -> float:
    """Return the total number of simulated ticks divided by the mean number of ticks of a run without branches [-]."""
    runs = [run for each in done for run in each.runs]
    whole = [run.ticks for run in runs if not run.branches]
    return sum(run.ticks - run.begun for run in runs) / max(sum(whole) / len(whole), 1.0)


def content(scenario: Scenario, q: RiskQuestion, found: Risk) -> dict[str, Any]:
    """Return the content of `risk.json`: settings, result, executions of the splitting algorithm, and seed and branches
    of a failed run."""
    failures = [found.failure] if found.failure else []
    return {
        **about(scenario),
        **q._asdict(),
        "first_seed": scenario.seed,
        **found.estimate._asdict(),
        "confidence": CONFIDENCE,
        "paths": found.paths,
        "worth": found.worth,
        "statement": found.statement,
        "splits": [split._asdict() for split in found.splits],
        "failure": [{"seed": run.seed, "branches": [list(branch) for branch in run.branches]} for run in failures],
    }


def figure(splits: Sequence[Split], courses: Sequence[dict[str, Any]], score: str | None) -> Figure:
    """Return a figure of the probability of exceeding each level of the margin, and of the trajectories of two runs.

    Each thin line is one execution of the splitting algorithm, the thick line is their mean, and the dashed line is the
    failure probability. Levels are extrapolated margins or values of `score`. Levels differ from the margins in the
    other panel, and a level above 0 is not necessarily a failure.
    """
    drawn, chances, _ = courses_figure(courses, ("a run", "a failure"))
    levels, mean = _mean(splits)
    for split in splits:
        chances.step(levels, _chances(split, levels), where="post", color=BLUE, linewidth=0.4)
    chances.step(levels, mean, where="post", color=BLACK)
    least = min((weight for split in splits for _, weight in split.trace if weight), default=0.1)
    if fail := fmean(split.probability for split in splits):
        chances.axhline(fail, color=BLACK, linewidth=0.6, linestyle="--")
        chances.annotate(f"fail: {fail:.2g}", (0.02, fail), xycoords=("axes fraction", "data"), va="bottom")
        least = min(least, fail)
    label = score or f"margin to failure, {AHEAD_S:g} s ahead [-]"
    chances.set(yscale="log", ylim=(0.7 * least, 1.4), xlabel=label, ylabel="probability of a larger margin [-]")
    return drawn


def _mean(splits: Sequence[Split]) -> tuple[Array, Array]:
    """Return the exceeded levels of closeness to failure, and the probability of exceeding each level, averaged over
    all splittings."""
    levels = np.unique([level for split in splits for level, _ in split.trace])
    mean = np.mean([_chances(split, levels) for split in splits], axis=0)
    return levels[mean > 0], mean[mean > 0]


def _chances(split: Split, levels: Array) -> Array:
    """Return the probability of exceeding each level of the margin, estimated by one execution of the splitting
    algorithm."""
    own, weights = np.array([(-np.inf, 1.0), *split.trace]).T
    return np.asarray(weights[np.searchsorted(own, levels, side="right") - 1])
