"""Tables of a scenario: the schema of the TOML files. Every key has a default, and unknown keys are errors."""

from operator import attrgetter
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from agrobot_mj.control import Controller, Guidance, Kinematic, Loop, PdT2fnn, SpeedLoop, SteeringLoop
from agrobot_mj.control.gains import Gains, gains_of
from agrobot_mj.control.supervisor import Supervisor
from agrobot_mj.core.signals import TICK_S, Outcome
from agrobot_mj.core.spec import Spec, fill, printable
from agrobot_mj.core.version import __version__
from agrobot_mj.estimation import Ekf, EkfFull, Estimator
from agrobot_mj.faults import Fault, clashes
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.fitting import ratios_of
from agrobot_mj.machine.hydraulics import Cylinder, Valve
from agrobot_mj.machine.implements import Implement, NoImplement
from agrobot_mj.machine.linkage import Linkage
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths import FigureEight, Path
from agrobot_mj.plants import Mujoco, Plant
from agrobot_mj.scenario.machines import COMPACT
from agrobot_mj.sensors import Sensors
from agrobot_mj.terrain import Flat, Terrain

STEP_S = 0.002  # Default physics step [s]
SHORTEST_S = 0.001  # Minimum value of a duration [s]; a run has at least one tick
LONGEST_S = 24 * 3600.0  # Maximum duration of a run [s]
REASONED = ("stopped", "unfinished", "diverged")  # Outcomes for which a run also reports a reason
DIVISORS = (5, 8, 10, 16, 20, 25, 40, 50, 80, 100, 125, 200, 250, 400, 500)
"""Numbers of physics steps per tick for which the step in seconds is a short decimal number [-]."""


def long_enough(seconds: float) -> float:
    """Return a duration [s] unchanged. Raises ValueError for a duration below `SHORTEST_S`."""
    if seconds < SHORTEST_S:
        raise ValueError(f"must be at least {SHORTEST_S:g}, got {seconds:g}")
    return seconds


class Steering(Spec):
    """Steering system: angle controller, valve, cylinder and linkage."""

    valve: Valve = Valve()
    """Electro-hydraulic valve and pump."""
    cylinder: Cylinder = Cylinder()
    """Steering cylinder."""
    linkage: Linkage = Linkage()
    """Kingpins, and linkage between cylinder and front wheels."""
    loop: Loop = SteeringLoop()
    """Controller of the steering angle."""


class Tables(Spec):
    """Tables of a scenario, which describe one experiment. Their validation opens no files."""

    name: Annotated[str, Field(max_length=200), AfterValidator(printable)] = ""
    """Short name of the scenario. Default: the file name."""
    title: Annotated[str, Field(max_length=1000), AfterValidator(printable)] = ""
    """One-line title of the scenario in lists and reports."""
    version: str = __version__
    """Version of agrobot_mj that wrote the file. The version has no effect on runs."""
    expected_outcome: Outcome = "completed"
    """Expected outcome of the run. Any other outcome gives exit status 1."""
    expected_reason: Annotated[str, Field(max_length=200), AfterValidator(printable)] = ""
    """Text that the stop reason must contain, such as "no GNSS fix". Default: any reason."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    """Seed of all random generators."""
    duration_s: Annotated[float, Field(gt=0, le=LONGEST_S), AfterValidator(long_enough)] | None = None
    """Maximum simulated time [s]. Default: duration of the path. Passing the end of the path ends the run early."""
    physics: Literal["standard", "fast"] = "standard"
    """Physics step: 2 ms (`standard`) or 5 ms (`fast`; 2.5 ms for drawn implements or light wheels, 2 ms on `ruts`)."""
    physics_dt_s: Annotated[float, Field(ge=1e-4, le=0.005)] | None = None
    """Physics step [s], a divisor of the 0.05 s tick. Tyre models are stable up to 5 ms. Default: set by `physics`."""
    machine: Annotated[str, Field(max_length=4000), AfterValidator(printable)] = COMPACT
    """Machine: a name listed by `agrobot-mj list --machines`, or a file. Keys of the scenario take precedence."""
    tractor: TractorParameters = TractorParameters()
    implement: Implement = NoImplement()
    """Implement at the hitch of the MuJoCo plant."""
    plant: Plant = Mujoco()
    terrain: Terrain = Flat()
    path: Path = FigureEight()
    controller: Controller = PdT2fnn()
    fault: Annotated[tuple[Fault, ...], Field(max_length=1000)] = ()
    """Faults and disturbances of the run, given as `[[fault]]` tables."""
    guidance: Guidance = Kinematic()
    """Guidance law, which computes steering angle and speed from the estimate and the path."""
    gains: Gains = "tuned"
    """Default gains of a law with a yaw controller: `tuned`, or `paper` for the gains of the figures in the paper."""
    supervisor: Supervisor = Supervisor()
    """Supervisor, which monitors the limits of autonomous operation and performs a controlled stop."""
    speed: SpeedLoop = SpeedLoop()
    """Speed controller: a cascade that computes the pedal voltage from the speed error."""
    steering: Steering = Steering()
    driveline: Driveline = Driveline()
    sensors: Sensors = Sensors()
    estimator: Estimator = Ekf()

    @property
    def ticks(self) -> int:
        """Maximum number of ticks of 50 ms in a run."""
        duration = self.path.duration_s if self.duration_s is None else self.duration_s
        return max(1, round(duration / TICK_S))

    def expects(self, outcome: str, reason: str = "") -> bool:
        """Return whether the outcome and the stop reason of a run are as the scenario expects."""
        return outcome == self.expected_outcome and self.expected_reason in reason

    @property
    def expectation(self) -> str:
        """Expected outcome of the run as text, with the expected stop reason in parentheses."""
        return self.expected_outcome + (f" ({self.expected_reason})" if self.expected_reason else "")

    @property
    def step_s(self) -> float:
        """Duration of a physics step [s]."""
        if self.physics_dt_s is not None:
            return self.physics_dt_s
        if self.physics == "standard":
            return STEP_S
        return min(self.plant.fast_step_s(self.tractor), self.implement.fast_step_s)

    @property
    def steps_per_tick(self) -> int:
        """Number of physics steps per tick."""
        return round(TICK_S / self.step_s)

    @property
    def vehicle(self) -> Machine:
        """Parameters of the machine simulated by the plant."""
        steering = self.steering
        return Machine(
            self.tractor, steering.valve, steering.cylinder, self.driveline, self.implement, steering.linkage
        )

    @property
    def law(self) -> str:
        """Kind of the guidance law and, if the law has a yaw controller, the kind of the controller."""
        takes = self.guidance.using(self.controller) is not self.guidance
        return f"{self.guidance.kind} with {self.controller.kind}" if takes else self.guidance.kind

    @model_validator(mode="after")
    def _scale_to_machine(self) -> Self:
        ratios = ratios_of(self.tractor, self.driveline, self.implement)
        if any(ratio != 1.0 for ratio in ratios.values()):
            parts = {name: part for name in type(self).model_fields if isinstance(part := getattr(self, name), Spec)}
            self.__dict__.update({name: part.following(ratios) for name, part in parts.items() if name != "tractor"})
        return self

    @model_validator(mode="after")
    def _fill_gains(self) -> Self:
        for key, value in gains_of(self.law, self.guidance, self.gains).items():
            fill(self, key.split("."), value)
        return self

    @model_validator(mode="after")
    def _fill_slip_noise(self) -> Self:
        pulled = getattr(self.implement, "lowered", False) or any(fault.kind == "drawbar" for fault in self.fault)
        if isinstance(self.estimator, EkfFull) and not pulled:
            fill(self, ["estimator", "unseen_slip_walk_rt_s"], 0.0)
        return self

    @model_validator(mode="after")
    def _check_combinations(self) -> Self:
        if errors := _contradictions(self):
            raise ValueError("\n".join(errors))
        return self


def _contradictions(s: Tables) -> list[str]:
    found = []
    if abs(s.steps_per_tick * s.step_s - TICK_S) > 1e-9:
        better = next(TICK_S / n for n in DIVISORS if TICK_S / n <= s.step_s)
        found.append(f"physics_dt_s: {s.step_s:g} does not divide the {TICK_S} s tick; try {better:g}")
    if s.physics != "standard" and s.physics_dt_s is not None:
        found.append(f"physics: {s.physics!r} and physics_dt_s = {s.physics_dt_s:g} both set the step; omit one")
    if s.plant.kind == "bicycle":
        found += _beyond_the_bicycle(s)
    if s.expected_reason and s.expected_outcome not in REASONED:
        found.append(f'expected_reason: only {", ".join(REASONED)} have a reason; set expected_outcome = "stopped"')
    found += clashes(s.fault)
    if s.implement.receiver and s.implement.kind == "none":
        found.append('implement.receiver: the scenario has no implement; set implement.kind = "mounted" or "drawn"')
    found += [
        f"sensors.gnss.{key}: the antenna is on the implement (implement.receiver = true); omit {key}"
        for key in ("configured_ahead_m", "configured_left_m")
        if s.implement.receiver and getattr(s.sensors.gnss, key) is not None
    ]
    found += [
        f"{table}.{why} needs sensors.{name}.enabled = true"
        for table, needs in (("estimator", s.estimator.needs), ("guidance", s.guidance.needs))
        for name, why in needs.items()
        if not attrgetter(name)(s.sensors).enabled
    ]
    return found


def _special(terrain: Terrain) -> str:
    """Return the key of ground properties that vary with position, or an empty string for uniform ground."""
    found = {"patch": terrain.patch, "surface": terrain.surface, "variation": terrain.variation.active}
    return next((key for key, value in found.items() if value), "")


def _beyond_the_bicycle(s: Tables) -> list[str]:
    found = []
    if s.terrain.kind != "flat":
        found.append(
            f"terrain.kind: the bicycle plant supports only flat ground, got {s.terrain.kind!r}; "
            'set terrain.kind = "flat" or plant.kind = "mujoco"'
        )
    elif key := _special(s.terrain):
        found.append(f'terrain.{key}: the bicycle plant supports no ground properties; set plant.kind = "mujoco"')
    if s.implement.machine:
        found.append(
            f"implement.kind: the bicycle plant has no body for an implement, got {s.implement.kind!r}; "
            'set implement.kind = "none" or plant.kind = "mujoco"'
        )
    found += [
        f'fault[{k}].kind: {fault.kind!r} acts on a part that the bicycle plant lacks; set plant.kind = "mujoco"'
        for k, fault in enumerate(s.fault)
        if fault.machine
    ]
    return found
