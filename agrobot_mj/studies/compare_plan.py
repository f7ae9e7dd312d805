"""Plan of a comparison: a sweep whose variants are laws on plants. All runs are checked before the first run.

A comparison runs each law on each plant with each seed. Laws are the entries of `controllers` (with the guidance law of
the scenario) and of `guidance` (with each controller, if the guidance law uses one). A variant is a named set of
overrides. A variant that sets [guidance] or [controller] is an additional law. Any other variant changes machine, field
or path; all laws from `controllers` and `guidance` run with each such variant.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.labels import safe_names
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.feasibility import check_tractors
from agrobot_mj.studies.engine.tasks import Task
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import BASE, Sweep, SweepFile, SweepVariant

PLANTS = ("bicycle", "mujoco")
CONTROLLERS = ("pd", "pd_t2fnn")
"""Default controllers of a comparison for which no controllers, guidance laws or variants are given."""
MOST_RUNS = 2000
"""Default maximum number of runs of a comparison. On the figure-eight, 2000 runs take one to three hours on one
core."""
MOST_DRAWN = 24
"""Maximum number of laws in figures and in the common recording, so that their lines are distinguishable."""
OWN_OPTIONS = {"plant": "--plants", "plant.kind": "--plants", "seed": "--seeds"}
"""Keys that variants must not set, each with the command-line option to use instead."""


class CompetingLaw(NamedTuple):
    """Law of a comparison, with its name in tables and its overrides of the scenario."""

    name: str
    overrides: Mapping[str, Any]
    variant: str | None = None


class Case(NamedTuple):
    """Run of a comparison: plant, law, seed and scenario."""

    plant: str
    law: str
    variant: str | None  # Name of the variant, or None if there is no variant
    seed: int
    scenario: Scenario
    folder: str

    @property
    def controller(self) -> str | None:
        """Kind of the yaw controller, or None for a guidance law without a yaw controller."""
        s = self.scenario
        return s.controller.kind if _takes_controller(s) else None


class Comparison(SweepPlan):
    """Plan of a comparison. Each run has a folder named after plant, law and seed."""

    def __init__(
        self,
        scenario: Scenario,
        cases: Sequence[Case],
        laws: Sequence[SweepVariant],
        seeds: int,
        left_out: Sequence[str] = (),
    ) -> None:
        super().__init__(Sweep(scenario.name, SweepFile(base=BASE, seeds=seeds, variant=tuple(laws)), scenario))
        self.cases = list(cases)
        self.left_out = left_out
        """Texts that name each omitted plant or law, with the reason why it cannot run the scenario."""
        self.recorded = True
        """Whether the comparison writes a recording of each run and a common recording."""

    @cached_property
    def drawn(self) -> list[int]:
        """Indices of the runs drawn in figures: runs with the first seed of the first `MOST_DRAWN` laws."""
        laws = list(dict.fromkeys(case.law for case in self.cases))[:MOST_DRAWN]
        first = self.cases[0].seed
        return [number for number, case in enumerate(self.cases) if case.seed == first and case.law in laws]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the run folders, in the form required by `simulation.results.results`."""
        return tuple(f"{case.folder}/" for case in self.cases)

    def folder(self, number: int) -> str:
        """Return the folder of run `number`, relative to the results folder."""
        return self.cases[number].folder

    def task(self, number: int) -> Task:
        """Return the task of run `number`. Body poses are kept for runs in the common recording."""
        kept = "signals" if not self.recorded else "poses" if number in self.drawn else "recordings"
        return super().task(number)._replace(keep=kept)

    def check(self, advance: Callable[[], object] = lambda: None) -> None:
        """Do nothing: the function `plan` has already checked all runs. This method overrides the check of sweeps."""


def plan(
    scenario: Scenario,
    controllers: Sequence[str] | None = None,
    guidance: Sequence[str] | None = None,
    variants: Sequence[SweepVariant] = (),
    plants: Sequence[str] | None = None,
    seeds: int = 1,
    most: int = MOST_RUNS,
) -> Comparison:
    """Return the checked plan of all combinations of laws, plants and seeds. The first seed is the seed of `scenario`.

    By default, each law runs on all plants that can run the law. Explicit `plants` must be able to run all laws. Raises
    `ScenarioError` if a run is invalid.
    """
    laws = competing(scenario, controllers, guidance, variants)
    able, left_out = (list(plants), []) if plants is not None else runnable(scenario)
    _check_number(len(laws), len(able), seeds, most)
    cases, lines = list[Case](), list[SweepVariant]()
    named = list(zip(laws, safe_names(law.name for law in laws), strict=True))
    tried = {(plant, place): _scenario_or_error(scenario, plant, law) for plant, (law, place) in product(able, named)}
    for plant, (law, place) in product(able, named):
        first = tried[plant, place]
        if isinstance(first, ScenarioError):
            if plants is not None or all(isinstance(tried[other, place], ScenarioError) for other in able):
                raise first
            left_out.append(f"{law.name} on {plant} is omitted: {str(first).splitlines()[0]}")
            continue
        _check_seeds(first.seed, seeds)
        lines.append(SweepVariant(name=f"{plant}-{place}", set={"plant.kind": plant, **law.overrides}))
        for seed in range(first.seed, first.seed + seeds):
            changed = first.model_copy(update={"seed": seed})  # the checks are independent of the seed
            cases.append(Case(plant, law.name, law.variant, seed, changed, f"{plant}-{place}-s{seed}"))
    check_tractors(case.scenario for case in cases[::seeds])
    return Comparison(scenario, cases, lines, seeds, left_out)


def competing(
    scenario: Scenario,
    controllers: Sequence[str] | None,
    guidance: Sequence[str] | None,
    variants: Sequence[SweepVariant],
) -> list[CompetingLaw]:
    """Return the laws to compare: each named law with each variant of machine, field or path, and variants that are
    laws."""
    _check_variants(variants)
    own = [variant for variant in variants if _is_law(variant)]
    conditions = [variant for variant in variants if not _is_law(variant)]
    named = _laws_of_kinds(scenario, controllers, guidance, bool(variants))
    found = [
        CompetingLaw(f"{variant.name}, {law.name}", {**law.overrides, **variant.set}, variant.name)
        if law.name
        else CompetingLaw(variant.name, variant.set, variant.name)
        for variant, law in product(conditions, named or [CompetingLaw("", {})])
    ]
    laws = [*(found or named), *(CompetingLaw(variant.name, variant.set, variant.name) for variant in own)]
    _check_names(laws)
    return laws


def _is_law(variant: SweepVariant) -> bool:
    return any(key.split(".")[0] in ("guidance", "controller") for key in variant.set)


def _laws_of_kinds(
    scenario: Scenario, controllers: Sequence[str] | None, guidance: Sequence[str] | None, varied: bool
) -> list[CompetingLaw]:
    """Return the laws for lists of controller and guidance kinds. Default without lists and variants: `CONTROLLERS`."""
    if controllers is None and not guidance:
        if varied:
            return []
        controllers = CONTROLLERS
    found, inside, errors = [], False, list[str]()
    for kind in guidance or ():
        try:
            takes = _takes_controller(scenario.changed({"guidance.kind": kind}))
        except ScenarioError as error:
            errors.append(str(error))
            continue
        inside |= takes
        if takes and controllers is not None:
            pairs = [{"guidance.kind": kind, "controller.kind": controller} for controller in controllers]
            found += [CompetingLaw(f"{kind}-{pair['controller.kind']}", pair) for pair in pairs]
        else:
            found.append(CompetingLaw(kind, {"guidance.kind": kind}))
    if errors:
        raise ScenarioError("\n".join(errors))
    if controllers is None or inside:
        return found
    if not _takes_controller(scenario):  # controllers have no effect, so that all runs would be equal
        kind = scenario.guidance.kind
        return found if kind in (guidance or ()) else [CompetingLaw(kind, {}), *found]
    return [*(CompetingLaw(kind, {"controller.kind": kind}) for kind in controllers), *found]


def runnable(scenario: Scenario, plants: Sequence[str] = PLANTS) -> tuple[list[str], list[str]]:
    """Return the plants that can run the scenario, and a text with the reason for each omitted plant."""
    able, left_out = [], []
    for plant in plants:
        try:
            scenario.changed({"plant.kind": plant})
            able.append(plant)
        except ScenarioError as error:
            left_out.append(f"{plant} is omitted: {str(error).splitlines()[0]}")
    return able, left_out


def _takes_controller(scenario: Scenario) -> bool:
    return scenario.guidance.using(scenario.controller) is not scenario.guidance


def _scenario_or_error(scenario: Scenario, plant: str, law: CompetingLaw) -> Scenario | ScenarioError:
    place = f"--variant {law.variant!r}: " if law.variant else ""
    try:
        changed = scenario.changed({"plant.kind": plant, **law.overrides})
    except ScenarioError as error:
        return ScenarioError(f"{place}{error}")
    if command := changed.guidance.outside:
        kind = changed.guidance.kind
        return ScenarioError(f'{place}guidance.kind: "{kind}" needs an external program; use `agrobot-mj {command}`')
    return changed


def _check_variants(variants: Sequence[SweepVariant]) -> None:
    names = [variant.name for variant in variants]
    if repeated := next((name for name in names if names.count(name) > 1), None):
        raise ScenarioError(f"--variant {repeated!r}: the name is given twice; use different names")
    for variant in variants:
        for key, value in variant.set.items():
            inside = key == "plant" and not (isinstance(value, Mapping) and "kind" in value)
            if key in OWN_OPTIONS and not inside:
                raise ScenarioError(f"--variant {variant.name!r}: {key}: set this key with {OWN_OPTIONS[key]}")


def _check_names(laws: Sequence[CompetingLaw]) -> None:
    names = [law.name for law in laws]
    for law in laws:
        if law.variant is not None and names.count(law.name) > 1:
            raise ScenarioError(
                f"--variant {law.variant!r}: this is also the name of a compared law; choose another name"
            )


def _check_number(laws: int, plants: int, seeds: int, most: int) -> None:
    if (runs := laws * plants * seeds) > most:
        raise ScenarioError(
            f"{runs} runs are planned ({laws} laws, {plants} plants, {seeds} seeds), but the limit is {most}; "
            f"reduce the number of runs or add --max-runs {runs}"
        )


def _check_seeds(first: int, seeds: int) -> None:
    last = first + seeds - 1
    if last >= 2**63:
        raise ScenarioError(f"--seeds {seeds}: the last seed would be {last}, above 2^63 - 1; set a smaller seed")
