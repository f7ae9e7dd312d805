"""One tick of the simulation, and the stages of the tick.

One tick (20 Hz): plant truth -> sensors -> estimator -> guidance (kinematic law and yaw controller, or another law) ->
supervisor -> steering and speed loops -> valve voltages. The plant then performs its physics steps. Scripted faults
change the `Conditions` of sensors and plant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import isnan, nan, radians
from operator import attrgetter
from typing import Any, NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.control.following import Following
from agrobot_mj.control.pid import BrakeState, SpeedState
from agrobot_mj.control.supervisor import Mode, Supervisor, SupervisorState
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import bound, fetched, held
from agrobot_mj.core.learned import Learned
from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import (
    NEUTRAL_V,
    SOUND,
    TICK_S,
    Column,
    Command,
    Conditions,
    Distortion,
    Drive,
    Estimate,
    Measurement,
    Reference,
    Truth,
)
from agrobot_mj.estimation.base import CompiledEstimator
from agrobot_mj.faults import Script, loadings
from agrobot_mj.paths.base import start_of
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.plants import Bicycle, BicyclePlant, Clock, MujocoPlant, RunningPlant
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.sensors import SensorState, Suite
from agrobot_mj.simulation.checks import Reception, Stage, check_report, read_only, steerable
from agrobot_mj.simulation.columns import Tick
from agrobot_mj.simulation.feasibility import naming
from agrobot_mj.simulation.low_level import LowLevelLoops
from agrobot_mj.simulation.receiver import MountedReceiver
from agrobot_mj.terrain import height_and_gradient


class Wiring(NamedTuple):
    """State of the steering and pedal signal lines between two ticks, with voltages relative to neutral [V]."""

    steer: SignalLine = SignalLine(0.0)
    pedal: SignalLine = SignalLine(0.0)

    @classmethod
    def after(cls, drive: Drive) -> "Wiring":
        """Return the state of the lines after they have transmitted the voltages in `drive` without a fault."""
        return cls(SignalLine(drive.steer_voltage - NEUTRAL_V), SignalLine(drive.pedal_voltage - NEUTRAL_V))

    def transmit(self, drive: Drive, conditions: Conditions, dt: float) -> "tuple[Wiring | Drive, Drive]":
        """Return the state of the lines after a tick of `dt` [s], and the voltages received by the valves."""
        if conditions.valve == conditions.pedal_valve == SOUND:
            return drive, drive
        steer, steer_voltage = _transmit(self.steer, drive.steer_voltage, conditions.valve, dt)
        pedal, pedal_voltage = _transmit(self.pedal, drive.pedal_voltage, conditions.pedal_valve, dt)
        return Wiring(steer, pedal), drive._replace(steer_voltage=steer_voltage, pedal_voltage=pedal_voltage)


def _transmit(line: SignalLine, voltage: float, distortion: Distortion, dt: float) -> tuple[SignalLine, float]:
    """Return the new state of a line and the received voltage [V], limited to the valve range, or NaN without power."""
    line, arrived = line.transmit(voltage - NEUTRAL_V, distortion, dt)
    return line, arrived if isnan(arrived) else NEUTRAL_V + min(max(arrived, -NEUTRAL_V), NEUTRAL_V)


SATURATION_MARGIN = radians(0.01)
"""Margin to the steering limit [rad] below which a steering command counts as saturated."""


@dataclass
class Stages:
    """States of all stages of the on-board computer between two ticks."""

    faults: Any
    conditions: Conditions  # Faults and disturbances of the current tick
    sensors: Reception
    receiver: MountedReceiver  # GNSS antenna as configured in the on-board computer
    estimator: Any
    guidance: Any
    supervisor: SupervisorState
    speed: SpeedState
    steering: Any
    brake: BrakeState
    wiring: Wiring | Drive  # Signal lines to the valves, or the last voltages of fault-free lines


class Loop:
    """Stages of a scenario and their states. A run alternates `tick` (`sense`, `decide` and `act`) and `advance`."""

    def __init__(self, scenario: Scenario, seen: Held[Truth] | None = None) -> None:
        """Create the stages in their initial state. `seen` is the true state of a saved run that is restored next."""
        s = self.scenario = scenario
        self.plant, ground = build_plant(scenario), scenario.terrain.ground()
        self.ground, self.height = ground, bound(height_and_gradient, ground, 0.0, 0.0)
        self.route, self.guidance = SampledRoute(s.path), s.guidance.using(s.controller)
        self.supervisor = s.supervisor if self.guidance.follows_path else Supervisor(enabled=False)
        self.script, self.towed = Script(s.fault, s.seed), s.implement.towed(s.tractor)
        self.suite = Suite(s.sensors, TICK_S)
        method = "update_held" if type(s.estimator).update is CompiledEstimator.update else "update"
        self.estimator = Stage("the estimator", s.estimator.kind, s.estimator, Estimate, read_only, method)
        self.fetches = type(self.guidance).update is not Following.update
        """Whether the guidance law needs the estimate as a named tuple instead of a `Held` reference."""
        self.path = Stage("the path", s.path.kind, s.path, Reference, method="at")
        self.law = Stage("the guidance law", s.guidance.kind, self.guidance, Command, partial(steerable, s))
        faults, conditions = self.script.update(self.script.init(), 0.0, TICK_S)
        self.seen: Held[Truth] = seen or held(self.plant.reset(start_of(s.path), conditions))
        truth, self.has_sensed = self.truth, False
        self.sensed: tuple[Measurement, Situation] | None = None
        self.stages = Stages(
            faults=faults,
            conditions=conditions,
            sensors=Reception(s.sensors.init(s.seed)),
            receiver=MountedReceiver(self._arm(), s.tractor.wheelbase_m, truth.yaw, t=truth.t),
            estimator=s.estimator.init(truth.rear_x, truth.rear_y, truth.yaw, s.tractor),
            guidance=self.guidance.init(),
            supervisor=self.supervisor.init(),
            speed=s.speed.init(),
            steering=s.steering.loop.init(),
            brake=BrakeState(),
            wiring=Wiring(),
        )
        parts: dict[str, Any] = {"guidance": self.guidance, "supervisor": self.supervisor, "estimator": s.estimator}
        parts |= {"sensors.sensors": self.suite, "steering": s.steering.loop}
        self.reporting = [(p, attrgetter(at)) for at, p in parts.items() if type(p).report is not Reporting.report]
        """Control components that report log columns, each with a function that selects its state from `stages`."""
        self.loops = Stage("the low-level loops", "steering.loop, speed", LowLevelLoops(s), Drive, method="drive")

    def _arm(self) -> tuple[float, float]:
        """Return the configured distances [m] of the GNSS antenna ahead and to the left of the rear axle."""
        s = self.scenario
        if behind := self.towed.antenna:
            return -behind, 0.0
        return s.sensors.gnss.configured_position(s.tractor.antenna_ahead_m, s.tractor.antenna_left_m)

    def tick(self, command: Command | None = None) -> Tick:
        """Compute a tick up to the valve voltages, with an external `command` or, by default, with the guidance law.

        Call `advance` afterwards. Raises `NotFiniteError` with the name of the stage that returned a non-finite number.
        """
        measured, situation = self.now()
        return self.act(measured, situation, self.decide(measured, situation) if command is None else command)

    def now(self) -> tuple[Measurement, Situation]:
        """Return the measurement and the guidance inputs of the current tick. The sensors are read once per tick."""
        if self.sensed is None or not self.has_sensed:
            self.sensed, self.has_sensed = self.sense(), True
        return self.sensed

    @property
    def truth(self) -> Truth:
        """True state of the plant at the current time."""
        return fetched(self.seen)

    def sense(self) -> tuple[Measurement, Situation]:
        """Read the sensors and update the estimate. Return the measurement and the guidance inputs."""
        s, state = self.scenario, self.stages
        state.sensors, measured = state.sensors.after(s, self.suite, self.seen, state.conditions)
        return self._estimate(measured)

    def receive(self, sensors: SensorState, measured: Measurement) -> None:
        """Continue a tick whose sensors have been read: check the measurement and update the estimate."""
        state = self.stages
        state.sensors, measured = state.sensors.check_measurement(self.scenario, sensors, measured, self.seen)
        self.sensed, self.has_sensed = self._estimate(measured), True

    def _estimate(self, measured: Measurement) -> tuple[Measurement, Situation]:
        """Update the estimate. Return the measurement and the guidance inputs."""
        state = self.stages
        fixed = state.receiver.at_rear_axle(measured)
        state.estimator, estimate = self.estimator.update(state.estimator, fixed, TICK_S)
        state.receiver = state.receiver.after(measured, estimate, TICK_S)
        return measured, self.situation(measured, estimate, self.path.ask(measured.t))

    def situation(self, measured: Measurement, estimate: Held[Estimate], reference: Reference) -> Situation:
        """Return the guidance inputs of a tick."""
        x, y = measured.readings["implement_gnss"]
        seen = measured.steer, measured.roll, (x, y)
        machine = self.scenario.tractor
        return Situation(measured.t, estimate, reference, self.route, machine, *seen, self.towed)

    def decide(self, measured: Measurement, situation: Situation) -> Command:
        """Return the command of the guidance law, or of the supervisor if it intervenes.

        The steering valve stays in neutral while the brake holds a tractor that follows a path.
        """
        state = self.stages
        seen = situation.fetched() if self.fetches else situation
        state.guidance, command = self.law.update(state.guidance, seen, TICK_S)
        braked = state.brake.share and self.guidance.follows_path
        if braked and state.brake.after(command, situation.reference, TICK_S).stands:
            command = command._replace(steer=situation.steer, steer_voltage=NEUTRAL_V)
        # an antenna on the implement swings with the hitch angle, for which the supervisor accounts
        at_axle = measured if self.towed.antenna else state.receiver.at_rear_axle(measured)
        state.supervisor, command = self.supervisor.update(
            state.supervisor, situation, at_axle, command, state.speed.reference, TICK_S
        )
        return command

    def act(self, measured: Measurement, situation: Situation, command: Command) -> Tick:
        """Run the low-level loops, which convert the command to valve voltages. Return all messages of the tick."""
        state, reference = self.stages, situation.reference
        drive = self.loops.ask(state, measured, situation, command)
        return Tick(
            truth=self.seen,
            measured=measured,
            estimate=situation.estimate,
            reference=reference,
            z_ref=self.height(self.ground, reference.x, reference.y)[0],
            command=command,
            steer_ref=state.steering.reference,
            pedal_ref=state.speed.reference,
            drive=drive._replace(pedal_voltage=nan) if command.released else drive,
            saturated=abs(state.steering.reference) > self.scenario.tractor.steer_limit - SATURATION_MARGIN,
            faults=self.script.active(measured.t) if self.script.faults else 0,
            actuation=self.plant.actuation(),
        )

    def advance(self, drive: Drive) -> None:
        """Advance the plant by one tick with the output `drive` of the low-level loops, and apply the faults of the
        next tick."""
        state, self.has_sensed = self.stages, False
        if not self.script.faults:
            state.wiring, self.seen = drive, self.plant.advance_held(drive, state.conditions)
            return
        lines = state.wiring if isinstance(state.wiring, Wiring) else Wiring.after(state.wiring)
        state.wiring, arrived = lines.transmit(drive, state.conditions, TICK_S)
        self.seen = self.plant.advance_held(arrived, state.conditions)
        state.faults, state.conditions = self.script.update(state.faults, self.truth.t, TICK_S)

    @property
    def follows_path(self) -> bool:
        """Whether the tractor follows its reference: the law follows a path, and no supervisor stop is active."""
        return self.guidance.follows_path and self.stages.supervisor.mode is not Mode.STOPPING

    @property
    def stop_reason(self) -> str:
        """Reason for the stop by the supervisor, or an empty string if there is no stop."""
        state = self.stages.supervisor
        return state.reason if self.supervisor.is_stopped(state) else ""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns reported by the simulation stages and the plant, in addition to the signals of every log."""
        return (*(column for part, _ in self.reporting for column in part.columns), *self.plant.columns)

    def report(self) -> Sequence[float]:
        """Return the values of `columns` in the current tick."""
        values: list[float] = []
        for part, state_in in self.reporting:
            values.extend(part.report(state_in(self.stages)))
        values.extend(self.plant.report())
        return values

    def learned(self) -> Learned:
        """Return the values learned by the guidance law and the steering loop."""
        state = self.stages
        return {**self.guidance.learned(state.guidance), **self.scenario.steering.loop.learned(state.steering)}

    def check_reports(self) -> None:
        """Raise `ScenarioError` unless law, estimator and sensors report one number for each of their columns."""
        state = self.stages
        for stage, remembered in ((self.law, state.guidance), (self.estimator, state.estimator)):
            check_report(stage.maker, stage.part.columns, stage.part.report(remembered))
        for name, reading in state.sensors.sensors.readings.items():
            sensor = getattr(self.scenario.sensors, name)
            check_report(f"the sensor ({name})", sensor.columns, sensor.report(reading))


def build_plant(scenario: Scenario, steps: int | None = None) -> RunningPlant:
    """Build and return the plant of a scenario with `steps` physics steps per tick. Default: the steps of the scenario.

    Raises `ScenarioError` for infeasible tractor parameters.
    """
    s = scenario
    ground, clock = s.terrain.ground(), Clock(s.step_s, steps or s.steps_per_tick)
    with naming(s.name):
        if isinstance(s.plant, Bicycle):
            return BicyclePlant(s.plant, s.vehicle, ground, clock)
        return MujocoPlant(s.plant, s.vehicle, ground, clock, s.seed, loadings(s.fault))
