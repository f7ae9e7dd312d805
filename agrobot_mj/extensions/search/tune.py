"""Search for the gains of a guidance law, with the same objective, cases and budget for every law.

The objective is the mean cost of runs over cases (`tuning_cases`) and seeds. The tracking cost is xte_rms / XTE_M +
steering travel / TRAVEL_DEG_S. The acquisition cost (`metrics.acquisition`) is acquired_s / ACQUIRED_S + overshoot /
OVERSHOOT_M + steering travel / TRAVEL_DEG_S. If the line is not acquired, the duration replaces acquired_s, and the
final distance / XTE_M is added. A run that fails (`metrics.success`) or loses its line costs more than any successful
run. The cost of a failed run decreases with the completed fraction of its task.

Differential evolution searches the ranges that the law declares (`tunable`), starting from the scenario's gains, so
that the result is never worse on the training cases. Test cases have other seeds and are used only for the evaluation
of the result.
"""

from collections.abc import Callable, Mapping, Sequence
from math import degrees, inf, log
from operator import attrgetter
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError, shorten
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.search.tuning_cases import TuningCase, TuningFile, tuning_cases
from agrobot_mj.metrics.success import COMPLETED, error_of, failures
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.studies import RunTasks, Task, about, check_tractors, study, write_json
from agrobot_mj.studies.engine.tasks import ERROR

XTE_M = 0.05  # Cross-track RMS error with cost 1 [m]. Assumed value: twice the stated accuracy of RTK guidance.
OVERSHOOT_M = 0.1  # Overshoot across a line with cost 1 [m]. Assumed value: more leaves a strip without seed.
ACQUIRED_S = 20.0  # Acquisition time with cost 1 [s]. Assumed value: duration of a drive of 25 m.
LOST_M = 0.2  # Distance from the line at the end of a run above which the line is not acquired [m]. Assumed value.
TRAVEL_DEG_S = 5.0  # Mean steering rate with cost 1 [deg/s]. Assumed value: a fifth of the rate at full pump flow.
MOST = 20.0  # Maximum cost of a successful run [-]
FAILED = 25.0  # Minimum cost of a failed run [-]. Without any progress, the cost is larger by `MOST`.
POPULATION = 8
MUTATION, CROSSOVER = (0.5, 1.0), 0.7
"""Differential evolution [Storn1997]: range of the factor on the difference of two candidates, and probability of
changing a key [-]."""
MOST_RUNS = 100_000  # Maximum number of runs of a search, including the evaluation of its result
Overrides = dict[str, Any]
Limits = tuple[float, float]  # Minimum and maximum of a gain [unit of the gain]


class Judgement(NamedTuple):
    """Cost and metrics of one run."""

    cost: float  # Cost of the run [-], of which the search minimizes the mean
    row: dict[str, Any]  # Metrics of the run, including whether it ended as expected (`metrics.success`)


def tunable(scenario: Scenario) -> dict[str, Limits]:
    """Return the gain ranges of a scenario's law and yaw controller, by dotted key.

    Raises `ScenarioError` for a law without tunable gains.
    """
    law, controller = scenario.guidance, scenario.controller
    driving = law.using(controller)
    found = {f"guidance.{key}": limits for key, limits in law.tunable.items()}
    if driving is not law:
        found |= {f"controller.{key}": limits for key, limits in controller.tunable.items()}
    if not (found and driving.follows_path):
        raise ScenarioError(
            f"guidance.kind: {law.kind!r} has no tunable gains; specify another law, or define `tunable` in the class "
            "of your law"
        )
    return found


def check_size(file: TuningFile, budget: int, seeds: int) -> None:
    """Raise `ScenarioError` if a gain search needs more than `MOST_RUNS` runs."""
    of_one = {part: file.runs(part) * seeds for part in ("training", "test")}
    runs = of_one["training"] * (max(budget, POPULATION) + 2) + 2 * of_one["test"]
    if runs > MOST_RUNS:
        raise ScenarioError(
            f"--budget {shorten(str(budget), 20)} --seeds {shorten(str(seeds), 20)}: this needs more than "
            f"{MOST_RUNS:,} runs; reduce the budget or the seeds"
        )


def task_of(case: TuningCase, gains: Overrides) -> Task:
    """Return the simulation task for one case with the given gains."""
    return Task.of(case.scenario, gains, measure=steering)


def steering(log: Log) -> dict[str, float]:
    """Return the duration of a run [s] and the sum of absolute changes of the steering angle [deg]."""
    travel = np.nan_to_num(np.abs(np.diff(log.column("steer"))), posinf=0.0)
    return {"end_s": float(log.column("t")[-1]), "steer_travel_deg": degrees(float(travel.sum()))}


def judge(case: TuningCase, row: dict[str, Any]) -> Judgement:
    """Return the cost and metrics of a run. `row` contains the metrics and the results of the function `steering`."""
    if row["outcome"] == ERROR:
        return Judgement(FAILED + MOST, row)
    return (_acquisition if case.measure == "acquisition" else _tracking)(row)


def _tracking(row: dict[str, Any]) -> Judgement:
    xte = error_of(row, "xte_rms")
    if xte is None:
        return Judgement(FAILED + MOST * (1.0 - min(max(float(row.get("progress") or 0.0), 0.0), 1.0)), row)
    return Judgement(min(xte / XTE_M + _travel(row), MOST), row)


def _acquisition(row: dict[str, Any]) -> Judgement:
    acquired, aside = row["acquisition.acquired_s"], row["acquisition.end_abs_max_m"]
    if not row["expected"] or aside > LOST_M:
        reason = row.get("stop_reason") or f"not within {LOST_M:g} m of its line at the end"
        row = {**row, "expected": False, "stop_reason": reason}
        return Judgement(FAILED + min(aside / XTE_M, MOST), row)
    late = row["end_s"] / ACQUIRED_S + aside / XTE_M if acquired is None else acquired / ACQUIRED_S
    return Judgement(min(late + row["acquisition.overshoot_m"] / OVERSHOOT_M + _travel(row), MOST), row)


def _travel(row: dict[str, Any]) -> float:
    return float(row["steer_travel_deg"] / row["end_s"] / TRAVEL_DEG_S)


def mean_costs(
    cases: Sequence[TuningCase], candidates: Sequence[Overrides], bounds: Sequence[float], do: RunTasks
) -> list[float]:
    """Return the mean cost of each candidate [-]. The evaluation of a candidate ends early if its cost exceeds its
    limit in `bounds`. The result is then a lower bound of the cost."""
    totals, going = [0.0] * len(candidates), list(range(len(candidates)))
    for case in cases:
        rows = do([task_of(case, candidates[k]) for k in going])
        for k, row in zip(going, rows, strict=True):
            totals[k] += judge(case, row).cost
        going = [k for k in going if totals[k] <= bounds[k] * len(cases)]
    return [total / len(cases) for total in totals]


def tune(
    scenario: Scenario,
    file: TuningFile,
    folder: Path,
    budget: int | None = None,
    seeds: int | None = None,
    jobs: int | None = None,
    known: Overrides | None = None,
    done: Callable[[int], object] = lambda evaluations: None,
) -> dict[str, Any]:
    """Tune the gains of a scenario's law. Write tuning.json to `folder` and return its content."""
    check_size(file, budget or file.budget, seeds or file.seeds)
    training, test = (tuning_cases(scenario, file, part, seeds or file.seeds) for part in ("training", "test"))
    check_tractors(case.scenario for case in (*training, *test))
    with study(folder, ("tuning.json",), jobs) as do:
        found = search(scenario, training, test, budget or file.budget, do, known, done)
        write_json(folder / "tuning.json", found)
    return found


def search(
    scenario: Scenario,
    training: Sequence[TuningCase],
    test: Sequence[TuningCase],
    budget: int,
    do: RunTasks,
    known: Overrides | None = None,
    done: Callable[[int], object] = lambda evaluations: None,
) -> dict[str, Any]:
    """Search for gains with `budget` evaluations, in complete generations. Return gains, scores and history."""
    ranges = tunable(scenario)
    if scenario.expected_outcome != COMPLETED:
        raise ScenarioError(
            f"{scenario.name}: the scenario expects {scenario.expected_outcome}, but only completed runs have "
            f"tracking errors to minimise; add --set expected_outcome={COMPLETED}"
        )
    if not training:
        raise ScenarioError(f"{scenario.name}: the plant supports no tuning case; add --set plant.kind=mujoco")
    present = {key: attrgetter(key)(scenario) for key in ranges}
    trace: list[tuple[dict[str, float], float]] = []

    def evaluate(points: Array, bounds: Sequence[float]) -> list[float]:
        some = [_gains(ranges, x) for x in points]
        found = mean_costs(training, some, bounds, do)
        trace.extend(zip(some, found, strict=True))
        done(len(found))
        return found

    _evolve(_first([present, {**present, **(known or {})}], ranges), max(budget // POPULATION, 1), evaluate)
    gains = min(trace, key=lambda tried: tried[1])[0]
    return {
        **about(scenario),
        "law": scenario.law,
        "evaluations": len(trace),
        "ranges": {key: list(limits) for key, limits in ranges.items()},
        "before": present,
        "gains": gains,
        "training": _evaluate_gains(training, gains, do),
        "test": _evaluate_gains(test, gains, do),
        "trace": [[*ranges, "cost"], *([*tried.values(), round(cost, 4)] for tried, cost in trace)],
    }


def _evolve(points: Array, generations: int, evaluate: Callable[[Array, Sequence[float]], list[float]]) -> None:
    """Run differential evolution (best/1/bin) on `points`, shape (POPULATION, n), each within 0 to 1 [Storn1997].

    A trial replaces a point only if its cost is not higher. Therefore the evaluation of a trial ends when its cost
    exceeds the cost of the point.
    """
    rng, costs = np.random.default_rng(1), evaluate(points, [inf] * POPULATION)
    for _ in range(generations - 1):
        best, factor = points[int(np.argmin(costs))], rng.uniform(*MUTATION)
        trials = points.copy()
        for k in range(POPULATION):
            one, other = points[rng.choice([j for j in range(POPULATION) if j != k], 2, replace=False)]
            changed = rng.random(points.shape[1]) < CROSSOVER
            changed[rng.integers(points.shape[1])] = True
            trials[k, changed] = (best + factor * (one - other))[changed]
        outside = (trials < 0.0) | (trials > 1.0)
        trials[outside] = rng.random(int(outside.sum()))
        found = evaluate(trials, costs)
        better = [k for k in range(POPULATION) if found[k] <= costs[k]]
        points[better] = trials[better]
        costs = [min(pair) for pair in zip(costs, found, strict=True)]


def _gains(ranges: Mapping[str, Limits], x: Array) -> dict[str, float]:
    """Return the gains at a search point within 0 to 1, to two significant digits. Positive ranges are logarithmic."""
    found = {}
    for (key, (low, high)), share in zip(ranges.items(), x.tolist(), strict=True):
        value = low * (high / low) ** share if low > 0 else low + share * (high - low)
        found[key] = min(max(float(f"{value:.2g}"), low), high)
    return found


def _first(begun: Sequence[Mapping[str, float | None]], ranges: Mapping[str, Limits]) -> Array:
    """Return the first generation of search points (POPULATION, keys): initial gains, then a Latin hypercube."""
    rng, n = np.random.default_rng(1), len(ranges)
    cells = np.stack([rng.permutation(POPULATION) for _ in range(n)], axis=1)
    points: Array = (cells + rng.random((POPULATION, n))) / POPULATION
    for row, gains in enumerate(begun):
        for k, (key, (low, high)) in enumerate(ranges.items()):
            if (now := gains[key]) is not None:
                now = min(max(now, low), high)
                points[row, k] = log(now / low) / log(high / low) if low > 0 else (now - low) / (high - low)
    return points


def _evaluate_gains(cases: Sequence[TuningCase], gains: Overrides, do: RunTasks) -> dict[str, Any]:
    found: dict[str, Any] = {
        "speeds_m_s": sorted({case.speed for case in cases}),
        "seeds": sorted({case.seed for case in cases}),
    }
    for name, chosen in (("score", gains), ("score_before", {})):
        rows = do([task_of(case, chosen) for case in cases])
        judged = [judge(case, row) for case, row in zip(cases, rows, strict=True)]
        costs: dict[str, list[float]] = {}
        for case, one in zip(cases, judged, strict=True):
            costs.setdefault(case.name, []).append(one.cost)
        scores = {each: round(fmean(some), 4) for each, some in costs.items()}
        failed = failures([one.row for one in judged])
        found[name] = {**scores, "mean": fmean(scores.values()) if scores else 0.0, "failed": failed}
    return found
