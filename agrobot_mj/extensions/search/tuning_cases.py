"""Tuning files: training cases for a gain search, and test cases for the evaluation of its result.

A case is a set of overrides of the tuned scenario, as for `--set`. Its key `measure` selects the cost: `tracking` for
the cross-track error, `acquisition` for the acquisition of a line from a lateral offset.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import SCENARIOS
from agrobot_mj.core.spec import Positive, Spec
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.loading import find_file, read_toml
from agrobot_mj.scenario.overrides import absolute_paths, read_spec
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies.pieces import at_speed

Name = Annotated[str, Field(min_length=1, max_length=200)]
FIRST_TEST_SEED = 1000
"""First seed of the test cases. The seeds of the training cases start at the scenario seed."""


class CaseSpec(Spec):
    """Case of a tuning file: one run, or one run for each speed."""

    name: Name
    """Name of the case in the table of costs."""
    measure: Literal["tracking", "acquisition"] = "tracking"
    """Cost of the case: cross-track error (`tracking`) or acquisition of the line (`acquisition`)."""
    speeds_m_s: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    """Speeds at which the same path segment is simulated [m/s]. Default: the speed of the scenario."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Scenario overrides of the case, by dotted key."""


class LawSpec(Spec):
    """Guidance law whose gains are tuned."""

    set: dict[str, Any]
    """Overrides that select the law and its initial gains."""
    known: dict[str, float] = Field(default_factory=dict)
    """Gains that are known to be good. The first generation of the search includes these gains."""


class TuningFile(Spec):
    """Content of a tuning file."""

    title: str = ""
    """Title for lists and reports, on one line."""
    version: str = __version__
    """Version of agrobot_mj that wrote the file, for information only."""
    budget: Annotated[int, Field(ge=8)] = 64
    """Default number of evaluations of the objective."""
    seeds: Annotated[int, Field(ge=1)] = 2
    """Default number of seeds per case."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Scenario overrides of all cases, by dotted key."""
    training: Annotated[tuple[CaseSpec, ...], Field(min_length=1)]
    """Training cases for the search: `[[training]]`."""
    test: Annotated[tuple[CaseSpec, ...], Field(min_length=1)]
    """Test cases for the evaluation of the result: `[[test]]`."""
    laws: dict[str, LawSpec] = Field(default_factory=dict)
    """Laws that `make gains` tunes, by name."""

    def part(self, name: str) -> tuple[CaseSpec, ...]:
        """Return the cases in the part "training" or "test" of the tuning file."""
        return self.training if name == "training" else self.test

    def runs(self, name: str) -> int:
        """Return the number of runs per seed of the part "training" or "test"."""
        return sum(len(case.speeds_m_s or (0,)) for case in self.part(name))


class TuningCase(NamedTuple):
    """Case with one seed and one speed, which is one run of the objective."""

    name: str
    measure: str  # Cost of the case: `tracking` or `acquisition`
    seed: int
    scenario: Scenario

    @property
    def speed(self) -> float:
        """Reference speed of the scenario's path [m/s]."""
        return self.scenario.path.speed_m_s


def read_tuning(source: str | Path) -> TuningFile:
    """Read a tuning file by its name or path. Raises `ScenarioError` with all errors of the file."""
    shipped = {path.stem: path for path in sorted((SCENARIOS / "tunings").glob("*.toml"))}
    path = find_file(source, "tuning", shipped, "", f"known: {', '.join(shipped)}")
    data = read_toml(path)
    absolute_paths(data, path.parent.resolve())
    return read_spec(TuningFile, data, path.name)


def tuning_cases(scenario: Scenario, file: TuningFile, part: str, seeds: int) -> list[TuningCase]:
    """Return one `TuningCase` for each case, speed and seed in the part "training" or "test". Cases that the scenario's
    plant does not support are omitted."""
    first = scenario.seed if part == "training" else FIRST_TEST_SEED
    return [
        TuningCase(case.name, case.measure, seed, changed.changed({"seed": seed}))
        for case in file.part(part)
        for changed in _scenarios_at_speeds(scenario, {**file.set, **case.set}, case)
        for seed in range(first, first + seeds)
    ]


def _scenarios_at_speeds(scenario: Scenario, changes: dict[str, Any], case: CaseSpec) -> Iterator[Scenario]:
    """If the plant supports a case, yield its scenario at each speed. Raises `ScenarioError` for invalid keys."""
    try:
        changed = scenario.changed(changes)
    except ScenarioError as error:
        if scenario.plant.kind == "mujoco":
            raise ScenarioError("\n".join(f"case {case.name!r}: {line}" for line in str(error).splitlines())) from None
        scenario.changed({"plant.kind": "mujoco"} | changes)  # raises an error if the plant is not the cause
        return
    yield from [at_speed(changed, speed) for speed in case.speeds_m_s] if case.speeds_m_s else [changed]
