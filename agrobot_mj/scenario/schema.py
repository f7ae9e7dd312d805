"""The scenario: one experiment as data.

The classes below are the schema of the TOML files: every key has a default, a misspelt one is an error. `load_scenario`
reads a file by name or path, applies dotted overrides and checks that the parts fit each other.
"""

import hashlib
import json
from collections.abc import Mapping
from math import atan, degrees, inf
from operator import attrgetter
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import AfterValidator, Field, ValidationError, model_validator

from agrobot_mj.control import Controller, Guidance, Kinematic, Loop, PdT2fnn, SpeedLoop, SteeringLoop
from agrobot_mj.control.gains import Gains, gains_of
from agrobot_mj.control.supervisor import Supervisor
from agrobot_mj.core.contracts import one_line, without_exit
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.messages import explain
from agrobot_mj.core.signals import TICK_S, Outcome
from agrobot_mj.core.spec import Spec, printable
from agrobot_mj.core.version import __version__
from agrobot_mj.estimation import Ekf, Estimator
from agrobot_mj.faults import Fault, clashes
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.hydraulics import Cylinder, Valve
from agrobot_mj.machine.implements import Implement, NoImplement
from agrobot_mj.machine.linkage import Linkage
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths import FigureEight, Path
from agrobot_mj.paths.base import start_of
from agrobot_mj.plants import Mujoco, Plant
from agrobot_mj.scenario.equipment import equipment_errors, prefixed
from agrobot_mj.scenario.overrides import check_overrides, complete, explicit_values, files, override, relocate_files
from agrobot_mj.sensors import Sensors
from agrobot_mj.terrain import Flat, Terrain

STEP_S = 0.002
"""Physics step unless another is given [s]."""
LONGEST_S = 24 * 3600.0
"""Longest run that a log in memory can hold [s]."""
MOST_ASIDE_M_S2 = 8.0
"""Lateral acceleration that no tyre of a tractor holds [m/s2]. Estimate: a friction of 0.8."""
SAID = {"version", "name", "title", "expected_outcome", "expected_reason", "gains"}
"""Keys that change nothing in a run, or nothing that others would not say."""
REASONED = ("stopped", "unfinished", "diverged")
"""Outcomes that come with a reason."""
SHORTEST_S = 0.001
"""Shortest duration; less than a tick is one [s]."""
DIVISORS = (5, 8, 10, 16, 20, 25, 40, 50, 80, 100, 125, 200, 250, 400, 500)
"""Numbers of steps in a tick that make a step with few decimals."""


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
    """Simulated time; the path's own when left out [s]."""
    physics: Literal["standard", "fast"] = "standard"
    """Physics step by name: 2 ms, or `fast`: 5 ms, 2.5 ms with a drawn implement, 2 ms on `ruts`."""
    physics_dt_s: Annotated[float, Field(ge=1e-4, le=0.005)] | None = None
    """Physics step, that of `physics` when left out; must divide the 0.05 s tick; tyres are stable up to 5 ms [s]."""
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
    def machine(self) -> Machine:
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
        """Eight hex digits that stand for everything that the run depends on."""
        content = self.model_dump(mode="json", exclude=SAID)
        read = files(content)
        relocate_files(content)  # the same files in another place are the same experiment
        digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
        for file in read:
            digest.update(file.read_bytes())
        return digest.hexdigest()[:8]

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
        data, default = explicit_values(self), Scenario()
        for key, value in overrides.items():
            override(data, key, value, default)
        return (resolve if files else validated)(data, self.name or "scenario")

    @model_validator(mode="after")
    def _gains_filled(self) -> "Scenario":
        for key, value in gains_of(self.law, self.gains).items():
            _fill(self, key.split("."), value)
        return self

    @model_validator(mode="after")
    def _parts_fit(self) -> "Scenario":
        if errors := list(_misfits(self)):
            raise ValueError("\n".join(errors))
        return self


def _fill(part: Spec, keys: list[str], value: Any) -> None:
    """Set a key that was not given as its default would be: it does not count as given afterwards."""
    if len(keys) > 1:
        inner = getattr(part, keys[0]).model_copy()  # defaults are shared
        _fill(inner, keys[1:], value)
        part.__dict__[keys[0]] = inner
    elif keys[0] not in part.model_fields_set:
        part.__dict__[keys[0]] = value


def _misfits(s: Scenario) -> list[str]:
    """Contradictions between keys that are valid by themselves; opens no file."""
    found = []
    if abs(s.steps_per_tick * s.step_s - TICK_S) > 1e-9:
        better = next(TICK_S / n for n in DIVISORS if TICK_S / n <= s.step_s)
        found.append(f"physics_dt_s: {s.step_s:g} does not divide the {TICK_S} s tick; try {better:g}")
    if s.physics != "standard" and s.physics_dt_s is not None:
        found.append(f"physics: {s.physics!r} and physics_dt_s = {s.physics_dt_s:g} both set the step; leave one out")
    if s.plant.kind == "bicycle":
        found += _beyond_the_bicycle(s)
    if s.expected_reason and s.expected_outcome not in REASONED:
        found.append(f'expected_reason: only {", ".join(REASONED)} have one; set expected_outcome = "stopped"')
    found += clashes(s.fault)
    if s.implement.receiver and s.implement.kind == "none":
        found.append('implement.receiver: there is no implement to carry it; set implement.kind = "mounted" or "drawn"')
    found += [
        f"{table}.{why} needs sensors.{name}.enabled = true"
        for table, needs in (("estimator", s.estimator.needs), ("guidance", s.guidance.needs))
        for name, why in needs.items()
        if not attrgetter(name)(s.sensors).enabled
    ]
    return found


def _beyond_the_bicycle(s: Scenario) -> list[str]:
    """Features of the scenario that the bicycle does not have."""
    found = []
    if s.terrain.kind != "flat":
        found.append(
            f"terrain.kind: the bicycle plant knows only flat ground, got {s.terrain.kind!r}; "
            'set terrain.kind = "flat" or plant.kind = "mujoco"'
        )
    elif s.terrain.patch:
        found.append('terrain.patch: the bicycle plant knows no ground properties; set plant.kind = "mujoco"')
    if s.implement.machine:
        found.append(
            f"implement.kind: the bicycle plant has no body for an implement, got {s.implement.kind!r}; "
            'set implement.kind = "none" or plant.kind = "mujoco"'
        )
    found += [
        f'fault[{k}].kind: {fault.kind!r} acts on what the bicycle plant does not have; set plant.kind = "mujoco"'
        for k, fault in enumerate(s.fault)
        if fault.machine
    ]
    return found


def resolve(data: dict[str, Any], source: str) -> Scenario:
    """A scenario from plain data, checked; `source` names it in messages. Raises `ScenarioError`."""
    scenario = validated(data, source)
    check_files(scenario, source)
    return scenario


def validated(data: dict[str, Any], source: str) -> Scenario:
    """A scenario from plain data whose path and ground are still to be checked. Raises `ScenarioError`."""
    complete(data, Scenario())
    try:
        # As JSON, because strict validation takes lists for tuples only there, and TOML has no other sequence.
        text = json.dumps(data, default=_as_plain, ensure_ascii=False).encode()
    except ValueError:  # UnicodeEncodeError among them
        raise ScenarioError(f"{source}: holds a number of thousands of digits, or text that is not UTF-8") from None
    try:
        return Scenario.model_validate_json(text)
    except ValidationError as error:
        raise ScenarioError(explain(error, source, data, Scenario)) from None


def _as_plain(value: Any) -> Any:
    """A value of numpy as Python's own, anything else as text."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


def check_files(scenario: Scenario, source: str, ground: bool = True) -> None:
    """Build path and ground, which reads the files that they name, and check that they fit the tractor and each other.

    Without `ground` the path alone. Raises `ScenarioError` with all that is wrong; `source` names the scenario.
    """
    with without_exit():
        try:
            scenario.path.check()
        except ValueError as error:
            raise ScenarioError(f"{source}: {prefixed('path', str(error))}") from None
        errors = [*_path_errors(scenario), *equipment_errors(scenario), *(_ground_errors(scenario) if ground else [])]
    if errors:
        raise ScenarioError("\n".join(f"{source}: {error}" for error in errors))


def _path_errors(s: Scenario) -> list[str]:
    """Reasons why the tractor cannot drive the path."""
    numbers = {"duration_s": s.path.duration_s, "max_curvature": s.path.max_curvature}
    for name, value in numbers.items():
        if not (isinstance(value, float | int) and 0.0 <= value < inf):
            return [f"path: {name} of kind {s.path.kind!r} must be finite and not negative, got {one_line(value)}"]
    found = []
    if s.ticks > LONGEST_S / TICK_S:
        found.append(f"path: takes {s.ticks * TICK_S:.0f} s; set duration_s, at most {LONGEST_S:.0f}")
    if s.path.speed_m_s > s.driveline.full_speed_m_s:
        top = f"driveline.full_speed_m_s ({s.driveline.full_speed_m_s:g})"
        found.append(f"path.speed_m_s: must be at most {top}, got {s.path.speed_m_s:g}")
    allowed = getattr(s.path, "lateral_acceleration_m_s2", inf)  # paths whose speed follows from limits keep to it
    if (aside := min(s.path.max_curvature * s.path.speed_m_s**2, allowed)) > MOST_ASIDE_M_S2:
        found.append(
            f"path.speed_m_s: {s.path.speed_m_s:g} m/s in the sharpest bend, {s.path.max_curvature:.3g} 1/m, needs "
            f"{aside:.2g} m/s2 to the side, more than tyres hold ({MOST_ASIDE_M_S2:g}); drive slower or make it wider"
        )
    needed = degrees(atan(s.path.max_curvature * s.tractor.wheelbase_m))
    if needed >= s.tractor.steer_limit_deg:
        place = s.path.sharpest
        found.append(
            f"path: its curvature of {s.path.max_curvature:.3g} 1/m at ({place.x:.1f}, {place.y:.1f}) m, "
            f"{place.distance:.1f} m from its start, needs {needed:.1f} deg of steering, the limit is "
            f"{s.tractor.steer_limit_deg:g} deg; make the path wider"
        )
    return found


def _ground_errors(s: Scenario) -> list[str]:
    """Reasons why there is no ground, or none under the tractor at its start."""
    start = start_of(s.path)
    try:
        if s.terrain.ground().covers(start.x, start.y):
            return []
    except ValueError as error:
        return [prefixed("terrain", str(error))]
    return [f"path: starts at ({start.x:g}, {start.y:g}) m, outside the terrain; make the terrain larger"]
