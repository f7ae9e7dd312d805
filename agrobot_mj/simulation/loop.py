"""The experiment: build the stages of a scenario, and run them tick by tick.

One tick (20 Hz) reads from top to bottom in `Loop.tick`: plant truth -> sensors -> filters -> path reference ->
kinematic law -> speed cascade and yaw controller -> low-level loops -> valve voltages. Then the plant takes its steps.
Scripted faults change the `Conditions` under which sensors measure and the plant moves.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from math import hypot, radians
from typing import Any, NamedTuple, Protocol

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.kernels import bound
from agrobot_mj.core.signals import TICK_S, Command, Drive, Estimate, Measurement, Reference, Truth
from agrobot_mj.faults import Script, loadings
from agrobot_mj.metrics.summary import metrics
from agrobot_mj.plants import Bicycle, BicyclePlant, MujocoPlant, RunningPlant
from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import COLUMNS, Log, Rows
from agrobot_mj.simulation.outcomes import Watch
from agrobot_mj.terrain import height_and_gradient

CHUNK_TICKS = 200
"""Watchers hear of new rows every 10 s of simulated time ..."""
LONG_TICKS, LONG_CHUNK_TICKS = 12_000, 1200
"""... beyond 10 min every 60 s, since each chunk of a recording costs memory until its end ..."""
TELL_S = 5.0
"""... and, where a run is slow, after this much wall time [s]."""
SATURATION_MARGIN = radians(0.01)
"""How close to its limit a steering command counts as saturated [rad]."""


class Watcher(Protocol):
    """Follows a run as it goes: a recording, a progress bar."""

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Before the first tick; `rows` fills as the run goes."""

    def advance(self, first: int) -> None:
        """Rows `first` to `rows.filled` are new."""

    def finish(self, log: Log) -> None:
        """After the last tick; metrics are known."""

    def fail(self, error: BaseException) -> None:
        """Instead of `finish`, where an error ends the run."""


class Loop:
    """The stages of one scenario and their states."""

    def __init__(self, scenario: Scenario) -> None:
        s = self.scenario = scenario
        self.plant, self.ground = build_plant(scenario), scenario.terrain.ground()
        self.height = bound(height_and_gradient, self.ground, 0.0, 0.0)
        self.l_r, self.limit = s.tractor.cg_to_rear_axle, s.tractor.steer_limit
        self.script = Script(s.fault, s.seed)
        self.faults, self.conditions = self.script.update(self.script.init(), 0.0, TICK_S)
        self.truth = self.plant.reset(s.path.at(0.0), self.conditions)
        truth = self.truth
        self.sensor_state = s.sensors.init(s.seed)
        self.estimation = s.estimator.init(truth.rear_x, truth.rear_y, truth.yaw, s.tractor)
        self.speed_state = s.speed.init()
        self.controller_state: Any = s.controller.init()
        self.steering, self.steer_ref = s.steering.loop.init(), 0.0

    def tick(self) -> tuple[Drive, tuple[float, ...]]:
        """Sense, estimate, decide; returns the valve voltages and the row of the log."""
        s, truth = self.scenario, self.truth
        self.sensor_state, measured = s.sensors.measure(self.sensor_state, truth, self.conditions, TICK_S)
        self.estimation, estimate = s.estimator.update(self.estimation, measured, TICK_S)
        reference = s.path.at(truth.t)
        speed_ref, yaw_rate_ref = s.guidance.references(estimate, reference, self.l_r)
        e_yaw_rate = yaw_rate_ref - estimate.yaw_rate
        self.controller_state, command = s.controller.update(
            self.controller_state, truth.t, e_yaw_rate, TICK_S, self.limit
        )
        self.steer_ref = s.steering.loop.reference(self.steer_ref, command.steer, TICK_S)
        command = Command(self.steer_ref, *command[1:])
        self.speed_state, (pedal_ref, pedal_voltage) = s.speed.update(
            self.speed_state, speed_ref, estimate.speed, measured.pedal, TICK_S
        )
        self.steering, steer_voltage = s.steering.loop.update(self.steering, command.steer, measured.steer, TICK_S)
        drive = Drive(steer_voltage, pedal_voltage)
        z_ref = self.height(self.ground, reference.x, reference.y)[0]
        setpoints = Setpoints(speed_ref, yaw_rate_ref, e_yaw_rate, pedal_ref, z_ref)
        faults = self.script.active(truth.t)
        return drive, row(truth, measured, estimate, reference, setpoints, command, drive, self.limit, faults)

    def advance(self, drive: Drive) -> None:
        """Let the plant take its steps, and the faults act on what follows."""
        self.truth = self.plant.advance(drive, self.conditions)
        self.faults, self.conditions = self.script.update(self.faults, self.truth.t, TICK_S)


class Setpoints(NamedTuple):
    """What the outer loops ask for."""

    speed: float
    """[m/s]."""
    yaw_rate: float
    """[rad/s]."""
    e_yaw_rate: float
    """Reference less measured [rad/s]."""
    pedal: float
    """[-]."""
    z: float
    """Height of the ground under the reference [m]."""


def build_plant(scenario: Scenario) -> RunningPlant:
    """The running plant of a scenario. Raises `ScenarioError` when its numbers make no tractor."""
    s = scenario
    common = (
        s.tractor,
        s.steering.valve,
        s.steering.cylinder,
        s.driveline,
        s.terrain.ground(),
        s.physics_dt_s,
        s.steps_per_tick,
    )
    try:
        if isinstance(s.plant, Bicycle):
            return BicyclePlant(s.plant, *common)
        plant = MujocoPlant(s.plant, *common)
        for k, payload in loadings(s.fault):
            plant.weigh(payload, f"fault[{k}]")
        return plant
    except ValueError as error:
        raise ScenarioError(f"{s.name or 'scenario'}: {error}") from None


def row(
    truth: Truth,
    measured: Measurement,
    estimate: Estimate,
    reference: Reference,
    setpoints: Setpoints,
    command: Command,
    drive: Drive,
    limit: float,
    faults: int,
) -> tuple[float, ...]:
    """One row in the order of `log.COLUMNS`, less the plant's own three; `faults` counts those that act."""
    t, p, fix = truth, estimate.covariance, measured.fix
    e_longitudinal, e_lateral = to_heading(reference.yaw, reference.x - t.x, reference.y - t.y)
    dx, dy = t.rear_x - estimate.rear_x, t.rear_y - estimate.rear_y
    p_xx, p_xy, p_yy = float(p[0, 0]), float(p[0, 1]), float(p[1, 1])
    nees = (p_yy * dx * dx - 2 * p_xy * dx * dy + p_xx * dy * dy) / (p_xx * p_yy - p_xy * p_xy)
    return (
        *(t.t, reference.x, reference.y, setpoints.z, reference.yaw, reference.curvature),
        *(t.x, t.y, t.z, t.yaw, t.pitch, t.roll, t.speed, t.lateral_speed, t.yaw_rate, t.rear_x, t.rear_y),
        *(estimate.x, estimate.y, estimate.yaw, estimate.speed, estimate.yaw_rate, estimate.steer_bias),
        *(estimate.rear_x, estimate.rear_y, p_xx, p_xy, p_yy, float(p[2, 2]), nees, estimate.nis),
        *(fix.x if fix else np.nan, fix.y if fix else np.nan, float(measured.quality), float(faults)),
        *(e_longitudinal, e_lateral, setpoints.speed, setpoints.yaw_rate, setpoints.e_yaw_rate),
        *(command.tau_c, command.tau_n, command.q, command.steer, t.steer, measured.steer),
        *(float(abs(command.steer) > limit - SATURATION_MARGIN), drive.steer_voltage),
        *(setpoints.pedal, t.pedal, measured.pedal, drive.pedal_voltage),
    )


def run(
    scenario: Scenario,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario to its end; writes nothing by itself.

    The same scenario gives bit-identical signals on the same machine. `should_stop` is asked every tick; once it says
    yes the run ends as `aborted`. Raises `ScenarioError` when the scenario's numbers make no tractor.
    """
    loop = Loop(scenario)
    plant = loop.plant
    rows = Rows(scenario.ticks, plant.wheels().size, len(plant.scene.bodies), scenario.controller.columns)
    for watcher in watchers:
        watcher.start(scenario, plant.scene, rows)
    try:
        outcome, wall = _drive(loop, rows, watchers, should_stop)
        log = _finish(Log(scenario, rows, plant.scene, outcome, wall), plant.warnings())
        for watcher in watchers:
            watcher.finish(log)
    except BaseException as error:
        for watcher in watchers:
            watcher.fail(error)
        raise
    return log


def _drive(loop: Loop, rows: Rows, watchers: tuple[Watcher, ...], should_stop: Callable[[], bool]) -> tuple[str, float]:
    """Tick by tick to the end; returns the outcome and the wall time [s]."""
    plant, ticks, controller = loop.plant, loop.scenario.ticks, loop.scenario.controller
    watch = Watch(plant, loop.truth)
    began, told, outcome = time.perf_counter(), 0, "completed"
    due = began + TELL_S
    for k in range(ticks):
        drive, values = loop.tick()
        report = controller.report(loop.controller_state)
        rows.append(values + plant.actuation(), plant.wheels(), plant.poses(), report)
        trouble = watch.trouble(loop.truth, _off(values)) or ("aborted" if should_stop() else None)
        if trouble:
            outcome = trouble
            break
        if k + 1 < ticks:
            loop.advance(drive)
            if plant.trouble() == "diverged":  # nothing that a sensor or a filter could work with
                outcome = "diverged"
                break
        if rows.filled - told >= chunk_ticks(rows.filled) or time.perf_counter() > due:
            for watcher in watchers:
                watcher.advance(told)
            told, due = rows.filled, time.perf_counter() + TELL_S
    wall = time.perf_counter() - began
    for watcher in watchers:
        watcher.advance(told)
    return outcome, wall


def chunk_ticks(filled: int) -> int:
    """After how many new rows watchers hear of them, when `filled` rows are there."""
    return CHUNK_TICKS if filled <= LONG_TICKS else LONG_CHUNK_TICKS


_E_LONGITUDINAL, _E_LATERAL = COLUMNS.index("e_longitudinal"), COLUMNS.index("e_lateral")


def _off(values: tuple[float, ...]) -> float:
    """Distance from the reference [m]."""
    return hypot(values[_E_LONGITUDINAL], values[_E_LATERAL])


def _finish(log: Log, warnings: int) -> Log:
    simulated = log.rows.filled * TICK_S
    numbers = {
        "outcome": log.outcome,
        **metrics(log),
        "physics_warnings": warnings,
        "real_time_factor": simulated / max(log.wall_s, 1e-9),
        "wall_s": log.wall_s,
    }
    return replace(log, metrics=numbers)
