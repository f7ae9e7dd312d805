"""The scenario: one experiment as data.

The classes below are the schema of the TOML files: every key has a default, a misspelt one is an error. `load_scenario`
reads a file by name or path, applies dotted overrides and checks that the parts fit each other.
"""

import json
from collections.abc import Mapping
from copy import deepcopy
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import AfterValidator, Field, model_validator

from agrobot_mj.control import Controller, Guidance, Kinematic, Loop, PdT2fnn, SpeedLoop, SteeringLoop
from agrobot_mj.control.gains import Gains, gains_of
from agrobot_mj.control.supervisor import Supervisor
from agrobot_mj.core.contracts import without_exit
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import Identity, code, digest, file_digest, joined
from agrobot_mj.core.signals import TICK_S, Outcome
from agrobot_mj.core.spec import Spec, fill, printable
from agrobot_mj.core.version import __version__
from agrobot_mj.estimation import Ekf, EkfFull, Estimator
from agrobot_mj.faults import Fault
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.fitting import ratios_of
from agrobot_mj.machine.hydraulics import Cylinder, Valve
from agrobot_mj.machine.implements import Implement, NoImplement
from agrobot_mj.machine.linkage import Linkage
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths import FigureEight, Path
from agrobot_mj.plants import Mujoco, Plant
from agrobot_mj.scenario.contradictions import (
    LONGEST_S,
    equipment_errors,
    ground_errors,
    misfits,
    path_errors,
    prefixed,
)
from agrobot_mj.scenario.machines import COMPACT, embody, machine_file, machine_tables
from agrobot_mj.scenario.overrides import (
    check_overrides,
    complete,
    explicit_values,
    files,
    forget,
    override,
    read_spec,
    relocate_files,
)
from agrobot_mj.sensors import Sensors
from agrobot_mj.terrain import Flat, Terrain

STEP_S = 0.002
"""Physics step unless another is given [s]."""
SAID = {"version", "name", "title", "expected_outcome", "expected_reason", "gains", "machine"}
"""Keys that change nothing in a run, or nothing that others would not say."""
SHORTEST_S = 0.001
"""Shortest duration; less than a tick is one [s]."""


def long_enough(seconds: float) -> float:
    """Return `seconds` unchanged. Raises ValueError where nobody can mean so short a run."""
    if seconds < SHORTEST_S:
        raise ValueError(f"must be at least {SHORTEST_S:g}, got {seconds:g}")
    return seconds


class Steering(Spec):
    """Everything between the steering reference and the wheels."""

    valve: Valve = Valve()
    """Electro-hydraulic valve and pump."""
    cylinder: Cylinder = Cylinder()
    """Steering cylinder."""
    linkage: Linkage = Linkage()
    """Kingpins and linkage between cylinder and wheels."""
    loop: Loop = SteeringLoop()
    """Low-level angle controller."""


class Scenario(Spec):
    """One experiment."""

    name: Annotated[str, Field(max_length=200), AfterValidator(printable)] = ""
    """Short name; the file's own when left out."""
    title: Annotated[str, Field(max_length=1000), AfterValidator(printable)] = ""
    """One line for lists and reports."""
    version: str = __version__
    """Version of agrobot_mj that wrote the file; for information."""
    expected_outcome: Outcome = "completed"
    """Outcome that the run should have; any other makes the exit status 1."""
    expected_reason: Annotated[str, Field(max_length=200), AfterValidator(printable)] = ""
    """Part of the reason for which the run should end so, as in "no GNSS fix"; any reason when left out."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    """Seed from which all randomness follows."""
    duration_s: Annotated[float, Field(gt=0, le=LONGEST_S), AfterValidator(long_enough)] | None = None
    """Longest simulated time; the path's own when left out. A path with an end ends the run when the tractor has passed
    it [s]."""
    physics: Literal["standard", "fast"] = "standard"
    """Physics step by name: 2 ms, or `fast`: 5 ms, 2.5 ms with a drawn implement, 2 ms on `ruts`."""
    physics_dt_s: Annotated[float, Field(ge=1e-4, le=0.005)] | None = None
    """Physics step, that of `physics` when left out; must divide the 0.05 s tick; tyres are stable up to 5 ms [s]."""
    machine: Annotated[str, Field(max_length=4000), AfterValidator(printable)] = COMPACT
    """Machine by name (`agrobot-mj list --machines`) or file; its keys stand below those of the scenario."""
    tractor: TractorParameters = TractorParameters()
    implement: Implement = NoImplement()
    """Implement at the hitch, on the MuJoCo plant."""
    plant: Plant = Mujoco()
    terrain: Terrain = Flat()
    path: Path = FigureEight()
    controller: Controller = PdT2fnn()
    fault: Annotated[tuple[Fault, ...], Field(max_length=1000)] = ()
    """Scripted faults and disturbances, `[[fault]]`."""
    guidance: Guidance = Kinematic()
    """Guidance law: from estimate and path to steering angle and speed."""
    gains: Gains = "tuned"
    """Gains that are not given, of a law with a yaw controller: searched, or those of the paper's figures."""
    supervisor: Supervisor = Supervisor()
    """Limits of autonomous driving, and a controlled stop."""
    speed: SpeedLoop = SpeedLoop()
    """Cascade from speed to pedal voltage."""
    steering: Steering = Steering()
    driveline: Driveline = Driveline()
    sensors: Sensors = Sensors()
    estimator: Estimator = Ekf()

    @property
    def ticks(self) -> int:
        """Number of 50 ms ticks."""
        duration = self.path.duration_s if self.duration_s is None else self.duration_s
        return max(1, round(duration / TICK_S))

    def expects(self, outcome: str, reason: str = "") -> bool:
        """Whether a run that ended with this outcome, for this reason, ended as it should."""
        return outcome == self.expected_outcome and self.expected_reason in reason

    @property
    def expectation(self) -> str:
        """How the run should end, in words."""
        return self.expected_outcome + (f" ({self.expected_reason})" if self.expected_reason else "")

    @property
    def step_s(self) -> float:
        """Physics step [s]."""
        if self.physics_dt_s is not None:
            return self.physics_dt_s
        return min(self.plant.fast_step_s, self.implement.fast_step_s) if self.physics == "fast" else STEP_S

    @property
    def steps_per_tick(self) -> int:
        """Physics steps in a tick."""
        return round(TICK_S / self.step_s)

    @property
    def vehicle(self) -> Machine:
        """What its plant is built from, besides the plant's own model."""
        steering = self.steering
        return Machine(
            self.tractor, steering.valve, steering.cylinder, self.driveline, self.implement, steering.linkage
        )

    @property
    def law(self) -> str:
        """Kind of the guidance law that drives, with that of the yaw controller inside it where it takes one."""
        takes = self.guidance.using(self.controller) is not self.guidance
        return f"{self.guidance.kind} with {self.controller.kind}" if takes else self.guidance.kind

    @property
    def hash8(self) -> str:
        """Eight hex digits that stand for what the scenario says and the files that it names."""
        return joined(self.identity[:2])

    @property
    def identity(self) -> Identity:
        """Identity of its run, with the code as this process has it; what was expected of the run is no part."""
        content = self.model_dump(mode="json", exclude=SAID)
        read = files(content)
        relocate_files(content)  # the same files in another place are the same experiment
        said = digest(json.dumps(content, sort_keys=True).encode())
        return Identity(said, joined(file_digest(file) for file in read), *code())

    def to_toml(self) -> str:
        """The resolved scenario as TOML; running it gives the same signals."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True) | {"version": __version__})

    def portable(self) -> tuple[str, dict[str, FilePath]]:
        """As `to_toml`, but with data files by names that lie beside it, and the present path of each of them."""
        data = self.model_dump(mode="json", exclude_none=True) | {"version": __version__}
        moved = relocate_files(data)
        return tomli_w.dumps(data), moved

    def changed(self, overrides: Mapping[str, Any], files: bool = True) -> "Scenario":
        """A copy with overrides by dotted key, checked again. Raises `ScenarioError`.

        Without `files` neither path nor ground is built; `check_files` must follow before it is run.
        """
        check_overrides(overrides)
        data = explicit_values(self)
        apply_overrides(data, overrides)
        return (resolve if files else validated)(data, self.name or "scenario")

    @model_validator(mode="after")
    def _size_followed(self) -> "Scenario":
        ratios = ratios_of(self.tractor, self.driveline, self.implement)
        if any(ratio != 1.0 for ratio in ratios.values()):
            parts = {name: part for name in type(self).model_fields if isinstance(part := getattr(self, name), Spec)}
            self.__dict__.update({name: part.following(ratios) for name, part in parts.items() if name != "tractor"})
        return self

    @model_validator(mode="after")
    def _gains_filled(self) -> "Scenario":
        for key, value in gains_of(self.law, self.gains).items():
            fill(self, key.split("."), value)
        return self

    @model_validator(mode="after")
    def _slip_expected(self) -> "Scenario":
        pulled = self.implement.kind != "none" or any(fault.kind == "drawbar" for fault in self.fault)
        if isinstance(self.estimator, EkfFull) and not pulled:
            fill(self, ["estimator", "unseen_slip_walk_rt_s"], 0.0)
        return self

    @model_validator(mode="after")
    def _parts_fit(self) -> "Scenario":
        if errors := misfits(self):
            raise ValueError("\n".join(errors))
        return self


def on_machine(data: Mapping[str, Any]) -> Scenario:
    """The default scenario on the machine that plain data names: what the data says only a part of.

    Without the machine's guidance law where the data has a yaw controller and names no law. Raises `ScenarioError`
    where there is no such machine.
    """
    name, guidance = data.get("machine", COMPACT), data.get("guidance")
    named = isinstance(guidance, Mapping) and "kind" in guidance
    if not isinstance(name, str) or (found := machine_file(name)) is None:
        return Scenario()
    return _on_machine("controller" in data and not named, *found)


@lru_cache(maxsize=64)
def _on_machine(cascade: bool, path: FilePath, *_changed: int) -> Scenario:
    tables = machine_tables(path)
    if cascade:
        tables.pop("guidance", None)
    complete(tables, Scenario())
    return _validated(tables, path.name)


def apply_overrides(data: dict[str, Any], overrides: Mapping[str, Any]) -> None:
    """Set keys of plain data, dotted; that of the machine first, from whose kinds the others count.

    Raises `ScenarioError`.
    """
    if "machine" in overrides:
        data["machine"] = overrides["machine"]
    default = on_machine(data)
    for key, value in overrides.items():
        override(data, key, value, default)


def resolve(data: dict[str, Any], source: str) -> Scenario:
    """A scenario from plain data, checked; `source` names it in messages. Raises `ScenarioError`."""
    scenario = validated(data, source)
    check_files(scenario, source)
    return scenario


def validated(data: dict[str, Any], source: str) -> Scenario:
    """A scenario from plain data whose path and ground are still to be checked. Raises `ScenarioError`."""
    own, default = deepcopy(data), on_machine(data)
    complete(data, default)
    scenario = _validated(data, source)
    forget(scenario, own)
    return scenario


def _validated(data: dict[str, Any], source: str) -> Scenario:
    added = embody(data, source)
    scenario = read_spec(Scenario, data, source)
    scenario.tractor.model_fields_set.difference_update(added)
    return scenario


def check_files(scenario: Scenario, source: str, ground: bool = True) -> None:
    """Build path and ground, which reads the files that they name, and check that they fit the tractor and each other.

    Without `ground` the path alone. Raises `ScenarioError` with all that is wrong; `source` names the scenario.
    """
    with without_exit():
        try:
            scenario.path.check()
        except ValueError as error:
            raise ScenarioError(f"{source}: {prefixed('path', str(error))}") from None
        errors = [*path_errors(scenario), *equipment_errors(scenario), *(ground_errors(scenario) if ground else [])]
    if errors:
        raise ScenarioError("\n".join(f"{source}: {error}" for error in errors))
