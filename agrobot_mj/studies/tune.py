"""Gains of a guidance law by search: the same objective, cases and budget for every law, judged on other cases.

Objective: the mean over surfaces, speeds and seeds of  xte_rms / XTE_M + steering travel / TRAVEL_DEG_S.  A run that
fails (`metrics.success`) costs more than any that succeeds, the more the less of its path it drove. Every speed drives
the same piece of the path. A worn valve among the cases is what a loss of margin costs. Differential evolution over the
ranges that the law declares (`tunable`), begun with its defaults, so that the result is never worse on the training
cases than these; test surfaces and seeds are never seen by the search. The result says how it came about.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from math import degrees, exp, log
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from agrobot_mj.core.errors import ScenarioError, shortened
from agrobot_mj.core.version import __version__
from agrobot_mj.metrics.success import COMPLETED, error_of, failures
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import write_json
from agrobot_mj.studies.pieces import at_speed
from agrobot_mj.studies.pool import pool

XTE_M = 0.05
"""Cross-track rms that costs 1 [m]. Estimate: twice the claim of RTK guidance."""
TRAVEL_DEG_S = 5.0
"""Mean steering rate that costs 1 [deg/s]. Estimate: a fifth of what the pump can do."""
MOST = 20.0
"""Most that a run costs which succeeds [-]."""
FAILED = 25.0
"""Least that a run costs which fails; one that drove nothing of its path costs MOST more [-]."""
POPULATION = 8
"""Candidates in a generation."""
WORN = {"kind": "valve_wear", "gain_share": 0.4, "dead_band_v": 0.8}
"""Valve with 40 % of its flow and 0.8 V more dead band."""
COMPENSATED = {"sensors.imu.enabled": True, "estimator.terrain_compensation": True}

Overrides = dict[str, Any]
TRAINING: dict[str, Overrides] = {
    "as the scenario": {},
    "soil": {"plant.tyre.kind": "soil"},
    "worn valve": {"fault": [WORN]},
}
"""Surfaces of the search."""
TEST: dict[str, Overrides] = {
    "rough D": {"terrain.kind": "rough", "terrain.iso_class": "D"},
    "side slope 10 deg": {"terrain.kind": "slope", "terrain.grade_deg": 10.0, **COMPENSATED},
    "worn valve on soil": {"plant.tyre.kind": "soil", "fault": [WORN]},
}
"""Surfaces of the judgement."""
SPEEDS = {"training": (0.8, 1.5), "test": (1.2,)}
"""Speeds of the path [m/s]."""
MOST_RUNS = 100_000
"""Most runs of a search and its judgement."""
FIRST_TEST_SEED = 1000
"""Seeds of the search count up from the scenario's, those of the judgement from here."""


class TuningCase(NamedTuple):
    """One run of the objective."""

    surface: str
    speed: float
    """Speed on the path [m/s]."""
    seed: int
    scenario: Scenario


class Judgement(NamedTuple):
    """What one run is worth."""

    cost: float
    """Its part of the objective [-]."""
    row: dict[str, Any]
    """Its metrics and whether it ended as expected, see `metrics.success`."""


class Tuning(NamedTuple):
    """What a search found."""

    gains: dict[str, float]
    """By dotted key."""
    provenance: dict[str, Any]
    """How it came about and how it scores, ready for JSON."""


def tunable(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Dotted keys of the scenario's law (and its yaw controller) with their ranges. Raises `ScenarioError`."""
    law, controller = scenario.guidance, scenario.controller
    found = {f"guidance.{key}": limits for key, limits in law.tunable.items()}
    if law.using(controller) is not law:
        found |= {f"controller.{key}": limits for key, limits in controller.tunable.items()}
    if not found:
        raise ScenarioError(f"guidance.kind: {law.kind!r} declares nothing to tune; name a law that does")
    return found


def check_size(budget: int, seeds: int) -> None:
    """Raise `ScenarioError` if a search takes more runs than `MOST_RUNS`."""
    surfaces = {"training": len(TRAINING), "test": len(TEST)}
    of_one = {part: surfaces[part] * len(SPEEDS[part]) * seeds for part in SPEEDS}
    runs = of_one["training"] * (max(budget, POPULATION) + 2) + 2 * of_one["test"]
    if runs > MOST_RUNS:
        raise ScenarioError(
            f"--budget {shortened(str(budget), 20)} --seeds {shortened(str(seeds), 20)}: more than {MOST_RUNS:,} runs; "
            "take fewer"
        )


def tuning_cases(scenario: Scenario, part: str, seeds: int) -> list[TuningCase]:
    """The cases of "training" or "test"; surfaces that the plant cannot have are left out."""
    surfaces = TRAINING if part == "training" else TEST
    first = scenario.seed if part == "training" else FIRST_TEST_SEED
    found = []
    for (surface, changes), speed in product(surfaces.items(), SPEEDS[part]):
        try:
            changed = at_speed(scenario.changed(changes), speed)
        except ScenarioError:
            continue
        found += [TuningCase(surface, speed, s, changed.changed({"seed": s})) for s in range(first, first + seeds)]
    return found


def judge(scenario: Scenario, gains: Overrides) -> Judgement:
    """One run under these gains."""
    done = run(scenario.changed(gains))
    row = {**done.metrics, "outcome": done.outcome, "expected": done.as_expected}
    return Judgement(_cost(row, done), row)


def _cost(row: dict[str, Any], done: Log) -> float:
    xte = error_of(row, "xte_rms")
    if xte is None:
        return FAILED + MOST * (1.0 - min(max(float(row.get("progress") or 0.0), 0.0), 1.0))
    travel = degrees(float(np.abs(np.diff(done.column("steer"))).sum())) / float(done.column("t")[-1])
    return min(xte / XTE_M + travel / TRAVEL_DEG_S, MOST)


def mean_cost(cases: Sequence[TuningCase], gains: Overrides) -> float:
    """The objective [-]."""
    return fmean(judge(case.scenario, gains).cost for case in cases)


def tune(
    scenario: Scenario,
    budget: int = 64,
    seeds: int = 2,
    jobs: int = 1,
    done: Callable[[int], object] = lambda evaluations: None,
) -> Tuning:
    """Search the gains of the scenario's law with `budget` evaluations of the objective, whole generations."""
    ranges = tunable(scenario)
    check_size(budget, seeds)
    if scenario.expected_outcome != COMPLETED:
        raise ScenarioError(
            f"{scenario.name}: expects {scenario.expected_outcome}, and only a run that completes has an error to make "
            f"small; add --set expected_outcome={COMPLETED}"
        )
    training, test = (tuning_cases(scenario, part, seeds) for part in ("training", "test"))
    if not training:
        raise ScenarioError(f"{scenario.name}: none of the surfaces of a tuning fits this scenario")
    space = [(log(low), log(high)) if low > 0 else (low, high) for low, high in ranges.values()]
    objective = partial(_objective, training, ranges)
    start = _candidates(scenario, ranges, space)
    with pool(jobs) as executor:

        def evaluate(function: Callable[[Any], float], candidates: Iterable[Any]) -> list[float]:
            found = list((executor.map if jobs > 1 else map)(function, list(candidates)))
            done(len(found))
            return found

        best = differential_evolution(
            objective, space, init=start, maxiter=max(budget // POPULATION - 1, 0), polish=False, seed=1,
            updating="deferred", workers=evaluate, tol=0.0,
        )  # fmt: skip
    gains = _gains(ranges, best.x)
    provenance = {
        "version": __version__,
        "scenario": scenario.name,
        "guidance": scenario.guidance.kind,
        "controller": scenario.controller.kind if any(key.startswith("controller") for key in ranges) else None,
        "evaluations": int(best.nfev),
        "ranges": {key: list(limits) for key, limits in ranges.items()},
        "gains": gains,
        "training": _judged(training, gains),
        "test": _judged(test, gains),
    }
    return Tuning(gains, provenance)


def write_tuning(tuning: Tuning, folder: Path) -> Path:
    """Write tuning.json under `folder`; returns its path."""
    write_json(folder / "tuning.json", tuning.provenance)
    return folder / "tuning.json"


def _objective(cases: Sequence[TuningCase], ranges: dict[str, tuple[float, float]], x: Any) -> float:
    return mean_cost(cases, _gains(ranges, x))


def _gains(ranges: dict[str, tuple[float, float]], x: Any) -> dict[str, float]:
    """Gains from a point of the search; those whose range excludes 0 are sought by their logarithm."""
    return {
        key: float(f"{exp(value) if low > 0 else value:.4g}")
        for (key, (low, _)), value in zip(ranges.items(), np.asarray(x).tolist(), strict=True)
    }


def _candidates(scenario: Scenario, ranges: dict[str, tuple[float, float]], space: list[tuple[float, float]]) -> Any:
    """First generation, shape (POPULATION, keys): the present gains, and a Latin hypercube."""
    rng, n = np.random.default_rng(1), len(space)
    cells = np.stack([rng.permutation(POPULATION) for _ in range(n)], axis=1)
    low, high = np.array(space).T
    points = low + (cells + rng.random((POPULATION, n))) / POPULATION * (high - low)
    for k, (key, (lowest, _)) in enumerate(ranges.items()):
        part, name = key.split(".")
        now = getattr(getattr(scenario, part), name)
        if now is not None:
            points[0, k] = np.clip(log(now) if lowest > 0 and now > 0 else now, low[k], high[k])
    return points


def _judged(cases: Sequence[TuningCase], gains: Overrides) -> dict[str, Any]:
    """Score of these gains and of the present ones, by surface."""
    surfaces = list(dict.fromkeys(case.surface for case in cases))
    found: dict[str, Any] = {
        "speeds_m_s": sorted({case.speed for case in cases}),
        "seeds": sorted({case.seed for case in cases}),
    }
    for name, chosen in (("score", gains), ("score_of_defaults", {})):
        judged = {surface: [judge(c.scenario, chosen) for c in cases if c.surface == surface] for surface in surfaces}
        scores = {surface: fmean(each.cost for each in some) for surface, some in judged.items()}
        failed = failures([each.row for some in judged.values() for each in some])
        found[name] = {**scores, "mean": sum(scores.values()) / max(len(scores), 1), "failed": failed}
    return found
