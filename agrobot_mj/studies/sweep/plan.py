"""Plan of a sweep: number of runs, overrides of each run, and a check that all runs are feasible.

Runs are numbered in nested loops: variants (outermost), axes in file order, samples, and seeds (innermost).
Only random samples are stored per run, so that the memory of a plan is independent of the number of combinations.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property, partial
from math import prod
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.scenario.checks import check_files
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.feasibility import check_tractor, tractor_key
from agrobot_mj.studies.engine.tasks import Task, base_text
from agrobot_mj.studies.sweep.axes import Listed
from agrobot_mj.studies.sweep.schema import Sweep, portable

RUNS = "runs"
MAX_RUNS = 100_000  # Default maximum number of runs of a sweep: about one day on a laptop
MOST_GROUNDS = 300
"""Maximum number of different fields that the check of a plan creates. Further fields are checked in their runs."""
MOST_KEPT = 1000
"""Maximum number of tractors with cached check results. With random samples, each run may have a different tractor."""
MOST_LINES = 80  # Maximum number of parameter combinations listed in a message


class RunPlan(NamedTuple):
    """Run of a sweep: number, variant, seed and overrides."""

    number: int  # Index of the run, counted from 0
    variant: str | None  # Name of the variant, or None if there are no variants
    seed: int
    parameters: dict[str, Any]
    overrides: dict[str, Any]  # Overrides of the base scenario by dotted key, in the order in which they are applied

    @property
    def place(self) -> str:
        """Variant and parameter values of the run, as text for messages."""
        parts = [] if self.variant is None else [f"variant {self.variant!r}"]
        return (
            ", ".join([*parts, *(f"{key}={_text_of(value)}" for key, value in self.parameters.items())]) or "every run"
        )


class SweepPlan:
    """Plan of all runs of a sweep, accessed by run number."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep, self.file = sweep, sweep.file
        # Axes of tables come last, because TOML files, including the resolved sweep file, require this order.
        axes = self.file.axes.items()
        self.axes = dict(sorted(axes, key=lambda a: any(isinstance(v, dict) for v in getattr(a[1], "values", ()))))
        self.sizes = [len(axis) for axis in self.axes.values()]
        self.samples = points_of(self.file.method, self.file.samples, len(self.file.draws)) if self.file.draws else 1
        self.combinations = max(len(self.file.variant), 1) * prod(self.sizes)

    @property
    def total(self) -> int:
        """Number of runs of the sweep."""
        return self.combinations * self.samples * len(self.sweep.seeds)

    @property
    def varied(self) -> set[str]:
        """Keys set by axes, random parameters and variants."""
        return {*self.axes, *self.file.draws}.union(*(variant.set for variant in self.file.variant))

    @property
    def checks(self) -> int:
        """Number of runs tested by `check`. Without random samples, runs that differ only in the seed count as one."""
        return self.total // self._stride

    @property
    def _stride(self) -> int:
        return 1 if self.file.draws else len(self.sweep.seeds)

    @property
    def parts(self) -> str:
        """Factors of the number of runs as text, for example `3 speed x 5 seeds`."""
        counts = [(len(self.file.variant), "variants")] if self.file.variant else []
        counts += list(zip(self.sizes, self.axes, strict=True))
        counts += [(self.samples, "samples")] if self.samples > 1 else []
        return " x ".join(f"{count:,} {what}" for count, what in [*counts, (len(self.sweep.seeds), "seeds")])

    def run(self, number: int) -> RunPlan:
        """Return the plan of run `number`, counted from 0: variant, seed, parameter values and overrides."""
        combination, repeat = divmod(number, self.samples * len(self.sweep.seeds))
        seed = self.sweep.seeds[repeat % len(self.sweep.seeds)]
        row = repeat if self.file.paired else number
        if self.file.common:
            row = repeat // len(self.sweep.seeds)
        values = {}
        rest = combination
        for key, axis in reversed(self.axes.items()):
            rest, k = divmod(rest, len(axis))
            values[key] = axis.at(k)
        variant = self.file.variant[rest] if self.file.variant else None
        parameters = {key: values[key] for key in self.axes}
        parameters |= {key: column[row] for key, column in self._draws.items()}
        overrides = {**(variant.set if variant else {}), **parameters}
        # Kinds and tables come first, because they determine the other keys.
        overrides = dict(sorted(overrides.items(), key=lambda item: not sets_schema(*item)))
        return RunPlan(number, variant.name if variant else None, seed, parameters, {**overrides, "seed": seed})

    def task(self, number: int) -> Task:
        """Return the task that simulates run `number`, counted from 0."""
        return Task(self.base, self.sweep.base.name, self.run(number).overrides, self.file.keep, number=number)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the folder that contains the run folders, in the form required by `simulation.results.results`."""
        return (f"{RUNS}/",)

    def folder(self, number: int) -> str:
        """Return the folder for the kept files of run `number`, relative to the results folder."""
        return f"{RUNS}/{number:08}"

    def runs(self, first: int = 0, step: int = 1) -> Iterator[RunPlan]:
        """Yield every `step`-th run, starting with run `first`."""
        return (self.run(number) for number in range(first, self.total, step))

    def some(self, most: int) -> Iterator[Scenario]:
        """Yield up to `most` valid scenarios with different parameter values, evenly spaced over the plan."""
        step = self._stride * max(1, -(-self.checks // most))
        for run in self.runs(step=step):
            with suppress(ScenarioError):
                yield self.sweep.base.changed(run.overrides, files=False)

    @cached_property
    def _draws(self) -> dict[str, list[Any]]:
        if not self.file.draws:
            return {}
        rows = self.samples * len(self.sweep.seeds) * (1 if self.file.paired else self.combinations)
        if self.file.common:
            rows = self.samples
        points = _points(self.file.method, rows, len(self.file.draws), self.file.draw_seed)
        return {key: draw.values(points[:, k]) for k, (key, draw) in enumerate(self.file.draws.items())}

    @cached_property
    def base(self) -> str:
        """Base scenario as JSON text."""
        return base_text(self.sweep.base)

    @cached_property
    def mixed(self) -> frozenset[str]:
        """Parameters stored as text in the results table, because their values are tables or have different types."""
        values: dict[str, list[Any]] = {k: list(a.values) for k, a in self.file.axes.items() if isinstance(a, Listed)}
        values |= {key: list(getattr(draw, "choice", ())) for key, draw in self.file.draws.items()}
        kinds = {key: {float if type(v) is int else type(v) for v in each} for key, each in values.items()}
        return frozenset(key for key, found in kinds.items() if len(found) > 1 or found & {dict, list})

    @cached_property
    def file_names(self) -> dict[str, str]:
        """Names of the data files in the results folder, by original path."""
        return portable(self.sweep).names

    def check_size(self, max_runs: int = MAX_RUNS) -> None:
        """Raise `ScenarioError` if the number of runs exceeds `max_runs`."""
        if self.total > max_runs:
            raise ScenarioError(
                f"{self.sweep.name}: the sweep has {self.total:,} runs ({self.parts}), but the limit is {max_runs:,}; "
                f"use fewer values, draw samples instead, or set --max-runs {self.total}"
            )

    def check(self, advance: Callable[[], object] = lambda: None) -> None:
        """Raise a `ScenarioError` that lists the infeasible runs, if any. `advance` is called after the check of each
        run."""
        checker, wrong = _Checker(self.sweep.base), dict[str, list[str]]()
        for run in self.runs(step=self._stride):
            for fault in checker.faults(run):
                wrong.setdefault(fault, []).append(run.place)
            advance()
        if wrong:
            raise ScenarioError("\n".join(self._list_errors(wrong, self.checks)))

    def _list_errors(self, wrong: dict[str, list[str]], checked: int) -> Iterator[str]:
        room = MOST_LINES
        for fault, found in wrong.items():
            places = list(dict.fromkeys(found))
            whole = len(found) == checked
            yield f"{self.sweep.name}: {fault}" + ("" if whole else f", in {len(places):,} combinations:")
            if not whole:
                yield from (f"  {place}" for place in places[:room])
                if len(places) > room:
                    yield f"  and {len(places) - room:,} more"
                room = max(room - len(places), 0)


class _Checker:
    """Check of individual runs. Results for a repeated tractor, field or path are cached."""

    def __init__(self, base: Scenario) -> None:
        self.base, self.tractors, self.places = base, dict[object, list[str]](), dict[object, list[str]]()

    def faults(self, run: RunPlan) -> list[str]:
        """Return the error messages of a run, without the scenario name."""
        try:
            scenario = self.base.changed(run.overrides, files=False)
        except ScenarioError as error:
            return self._plain(error)
        command = scenario.guidance.outside
        if command:
            return [f'guidance.kind: "{scenario.guidance.kind}" needs an external program and cannot be swept']
        room = len(self.tractors) < MOST_KEPT
        wrong = self._find(self.tractors, tractor_key(scenario), room, partial(check_tractor, scenario))
        return [*wrong, *self._of_place(scenario)]

    def _of_place(self, scenario: Scenario) -> list[str]:
        tractor, fields = scenario.tractor, len(self.places) < MOST_GROUNDS
        key = (scenario.path, scenario.terrain, scenario.ticks, tractor.wheelbase_m, tractor.steer_limit_deg)
        return self._find(self.places, key, fields, partial(check_files, scenario, self.base.name, fields))

    def _find(self, known: dict[object, list[str]], key: object, room: bool, check: Callable[[], None]) -> list[str]:
        if key in known:
            return known[key]
        faults = []
        try:
            check()
        except ScenarioError as error:
            faults = self._plain(error)
        if room:
            known[key] = faults
        return faults

    def _plain(self, error: ScenarioError) -> list[str]:
        return [line.removeprefix(f"{self.base.name}: ").removeprefix("--set ") for line in str(error).splitlines()]


def sets_schema(key: str, value: Any) -> bool:
    """Return whether an override sets a `kind` or a table, and must therefore be applied before other overrides."""
    return key.rpartition(".")[2] == "kind" or isinstance(value, dict | list)


def points_of(method: str, samples: int, draws: int) -> int:
    """Return the number of sample points that a sampling `method` needs for `samples` requested samples and `draws`
    random parameters."""
    return samples * (draws + 2) if method == "saltelli" else samples


def _saltelli(n: int, dimensions: int, generator: np.random.Generator) -> Array:
    """Return the design of [Saltelli2010] for sensitivity indices, shape (n (d + 2), d), where d is `dimensions`."""
    from scipy.stats import qmc

    base = qmc.Sobol(2 * dimensions, rng=generator).random_base2(max(n - 1, 0).bit_length())[:n]
    a, b = base[:, None, :dimensions], base[:, None, dimensions:]
    mixed = np.where(np.eye(dimensions, dtype=bool), b, a)
    return np.concatenate([a, mixed, b], axis=1).reshape(-1, dimensions)


def _points(method: str, n: int, dimensions: int, seed: int) -> Array:
    generator = stream(seed, "sweep draws")
    if method == "random":
        points = generator.random((n, dimensions))
    elif method == "saltelli":
        points = _saltelli(n // (dimensions + 2), dimensions, generator)
    else:
        from scipy.stats import qmc

        if method == "sobol":
            # The first n points of a sequence whose length, the next power of two, is balanced.
            points = qmc.Sobol(dimensions, rng=generator).random_base2(max(n - 1, 0).bit_length())[:n]
        else:
            points = qmc.LatinHypercube(dimensions, rng=generator).random(n)
    return np.clip(points, 1e-12, 1.0 - 1e-12)


def _text_of(value: Any) -> str:
    return json.dumps(value) if isinstance(value, dict | list | tuple | bool) else str(value)
