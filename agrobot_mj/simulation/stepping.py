"""A run that is stepped from outside, tick by tick: `Simulation`.

>>> sim = Simulation("side_slope", {"seed": 3})
>>> m = sim.reset()
>>> while not sim.done:
...     m = sim.step(steer=0.05, speed=1.2)

`step()` without a command lets the scenario's own guidance drive; `run` is built on that. A command is one of steering
angle, valve voltage, yaw rate or curvature, beside a speed. `drive` is for a program that the guidance stands for.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import atan, hypot, isfinite, nan
from pathlib import Path
from typing import Any

from agrobot_mj.control.base import Situation
from agrobot_mj.core.contracts import check_argument, without_exit
from agrobot_mj.core.copying import independent
from agrobot_mj.core.errors import CommandError, NotFiniteError
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.randomness import branch, generators
from agrobot_mj.core.signals import TICK_S, Command, Estimate, Measurement, Quality, Reference, Truth
from agrobot_mj.metrics import RunView, metrics, progress_of
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.checks import ABSURD_STEER, limited
from agrobot_mj.simulation.columns import COLUMNS, Tick, row
from agrobot_mj.simulation.diagnosis import diagnosis
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.outcomes import Watch
from agrobot_mj.simulation.snapshot import Snapshot, loop_state, require_same_scenario, set_loop_state

LEAST_SPEED = 0.1
"""Least speed by which a yaw rate is divided to give a curvature, for a tractor slower than this [m/s]."""
NOTHING = Measurement(0.0, None, Quality.NONE, nan, nan, nan)
"""Measurement of a run that ended before anything was sensed."""


class Simulation:
    """One scenario, driven tick by tick by its own guidance or from outside."""

    def __init__(self, scenario: str | Path | Scenario, overrides: Mapping[str, Any] | None = None) -> None:
        """A scenario by name, path or object, with overrides by dotted key.

        Raises `ScenarioError`, TypeError.
        """
        if isinstance(scenario, Scenario):
            self.scenario = scenario if overrides is None else scenario.changed(overrides)
        else:
            self.scenario = load_scenario(scenario, overrides)
        self.identity = str(self.scenario.identity)
        self._begin()

    def _begin(self) -> None:
        with without_exit():
            self.loop = Loop(self.scenario)
        plant, loop = self.loop.plant, self.loop
        self.rows = Rows(self.scenario.ticks, plant.wheels().size, len(plant.scene.bodies), loop.columns)
        self._watch, self.outcome, self.reason = Watch(plant), "", ""
        self._measured = SampledRoute(self.scenario.path)  # not the law's, whose samples no metric may add to
        if self._watch.plant.trouble() == "diverged":  # while it settled
            self._diverge(f"the plant ({self.scenario.plant.kind}) diverged while it came to rest at the start")

    def reset(self) -> Measurement:
        """Place the tractor at the start again; returns the first measurement."""
        if self.loop.sensed is not None or self.rows.filled:
            self._begin()
        if not self.done:
            self._sense()
        return self.measurement

    def step(
        self,
        steer: float | None = None,
        speed: float | None = None,
        *,
        curvature: float | None = None,
        yaw_rate: float | None = None,
        steer_voltage: float | None = None,
    ) -> Measurement:
        """One tick under a command; what the sensors measure at its end.

        At most one of `steer` [rad], `curvature` [1/m], `yaw_rate` [rad/s] and `steer_voltage` [V, 0-12, neutral at 6],
        all left positive; without any the scenario's guidance drives. `speed` [m/s] is the guidance's or, beside
        a steering command, the reference's where it is left out. The supervisor watches the scenario's own guidance
        alone. Raises `CommandError` for a command that is
        not finite or not one, and for a step after the end; TypeError for what is no number.
        """
        if self.done:
            raise CommandError(f"the run has ended ({self.outcome}); call reset()")
        wanted = {"steer": steer, "curvature": curvature, "yaw_rate": yaw_rate, "steer_voltage": steer_voltage}
        given = {k: v for k, v in wanted.items() if v is not None}
        try:
            command = self._command(given, speed) if given or speed is not None else None
            self._finish_tick(self.loop.tick(command), led=command is None)
        except NotFiniteError as error:
            self._diverge(str(error))
        return self.measurement

    def drive(self, request: Any) -> Measurement:
        """One tick under a program outside; what the sensors measure at its end.

        `request` is what the program asks of the scenario's guidance: an `Actuation` of `agopengps`, a
        `VelocityRequest` of `cmd_vel`. Raises `CommandError` where the guidance drives by itself, and for a step after
        the end; TypeError for another request.
        """
        guidance, message = self.scenario.guidance, type(self.loop.guidance.init())
        if not guidance.outside:
            raise CommandError(f'guidance.kind: "{guidance.kind}" drives by itself; give step() a command of your own')
        check_argument("request", request, isinstance(request, message), f"of type {message.__name__}")
        self.loop.stages.guidance = request
        return self.step()

    def _command(self, given: dict[str, float], speed: float | None) -> Command:
        """The command that the arguments of `step` mean; there is at least one."""
        numbers = given if speed is None else {**given, "speed": speed}
        for name, value in numbers.items():
            check_argument(name, value, hasattr(value, "__float__"), "a number")  # text does not have it
            if not isfinite(value):
                raise CommandError(f"{name}: must be a finite number, got {value}")
        if len(given) > 1:
            raise CommandError(f"{' and '.join(given)}: give one of them")
        if not given:
            return self.loop.decide(*self._now())._replace(speed=float(numbers["speed"]))
        situation, ((kind, value),) = self.situation, given.items()
        r = situation.reference
        along = to_heading(r.yaw, r.vx, r.vy)[0] if speed is None else float(speed)
        if kind == "steer_voltage":
            return Command(situation.steer, along, value)
        if kind == "yaw_rate":
            u = situation.estimate.speed
            value /= u if abs(u) > LEAST_SPEED else (LEAST_SPEED if u >= 0 else -LEAST_SPEED)
        machine = situation.machine
        angle = value if kind == "steer" else atan(machine.wheelbase_m * value)
        if abs(angle) > ABSURD_STEER:
            raise CommandError(f"{kind}: is in radians and must be within a right angle, got {value}")
        return limited(Command(angle, along), machine.steer_limit)

    def _finish_tick(self, tick: Tick, led: bool) -> None:
        """Write the row, advance the plant unless the run is over, and read the sensors again.

        `led` says whether the command is the guidance's own.
        """
        loop, plant, rows = self.loop, self.loop.plant, self.rows
        try:
            rows.append(row(tick), plant.wheels(), plant.poses(), loop.report())
        except (TypeError, ValueError):
            loop.check_reports()
            raise
        r, t = tick.reference, tick.truth
        led = led and loop.follows_path
        self.outcome = self._watch.trouble(t, hypot(r.x - t.x, r.y - t.y), tick.pedal_ref, led) or ""
        if self.outcome:
            return
        if loop.stop_reason:
            self.outcome, self.reason = "stopped", loop.stop_reason
            return
        if rows.filled == self.scenario.ticks:
            self._complete()
            return
        loop.advance(tick.drive)
        if plant.trouble() == "diverged":  # nothing that a sensor or a filter could work with
            self._diverge(f"the state of the plant ({self.scenario.plant.kind}) is not finite, or faster than 100 m/s")
            return
        self._sense()

    def _complete(self) -> None:
        """End the run at its planned end: completed if enough of the path was driven, by a guidance that follows it."""
        self.outcome = "completed"
        if self.loop.guidance.follows_path:
            log = Log(self.scenario, self.rows, self.loop.plant.scene, "", 0.0)
            progress = progress_of(RunView(log, self._measured))
            if not progress.enough:
                self.outcome, self.reason = "unfinished", f"drove {progress.driven:.1f} of {progress.length:.1f} m"

    def _sense(self) -> None:
        try:
            self.loop.now()
        except NotFiniteError as error:
            self._diverge(str(error))

    def _diverge(self, reason: str) -> None:
        """End the run, since nothing could work with its numbers; its first row may be one that knows only t = 0."""
        self.outcome, self.reason = "diverged", reason
        plant, unknown = self.loop.plant, [nan] * (len(COLUMNS) - 1)
        if not self.rows.filled:
            self.rows.append([0.0, *unknown], plant.wheels(), 0.0 * self.rows.poses[0], [nan] * len(self.loop.columns))

    def _now(self) -> tuple[Measurement, Situation]:
        """What is sensed in this tick; what was sensed last where the run has ended."""
        if not self.done:
            return self.loop.now()
        if self.loop.sensed is None:
            raise CommandError(f"the run ended before anything was sensed: {self.reason}")
        return self.loop.sensed

    def save(self) -> Snapshot:
        """The state now, from which `restore` goes on to the last bit; costs less than half a tick."""
        self._now()
        return Snapshot(
            scenario=self.scenario,
            loop=independent(loop_state(self.loop)),
            rows=self.rows.save(),
            standstill=self._watch.standstill,
            ending=(self.outcome, self.reason),
        )

    def restore(self, state: Snapshot) -> Measurement:
        """Go on from a state of `save`, of this or another simulation of the same scenario; the measurement there.

        A state may be restored any number of times. Raises `CommandError` if it belongs to another scenario, TypeError
        if it is none.
        """
        check_argument("state", state, isinstance(state, Snapshot), "what save() has returned")
        require_same_scenario(state, self.scenario)
        set_loop_state(self.loop, independent(state.loop))
        self.rows.restore(state.rows)
        self._watch.standstill, (self.outcome, self.reason) = state.standstill, state.ending
        return self.measurement

    def branch(self, number: int) -> None:
        """Let all noise go on otherwise from here: every random generator of the stages by a stream of this number.

        The past, what it was drawn of once (the ground, a bias) and the values that wander stay. Raises TypeError for
        what is no whole number.
        """
        check_argument("number", number, isinstance(number, int), "a whole number")
        for generator in generators(vars(self.loop.stages)):
            branch(generator, number)

    def abort(self) -> None:
        """End the run here, with the outcome `aborted`; a run that has ended keeps its own."""
        self.outcome = self.outcome or "aborted"

    @property
    def done(self) -> bool:
        """Whether the run has ended; `outcome` says how."""
        return self.outcome != ""

    @property
    def measurement(self) -> Measurement:
        """The last measurement of the sensors."""
        return NOTHING if self.done and self.loop.sensed is None else self._now()[0]

    @property
    def situation(self) -> Situation:
        """All that a guidance law may know now."""
        return self._now()[1]

    @property
    def truth(self) -> Truth:
        """The true state of the plant now."""
        return self.loop.truth

    @property
    def estimate(self) -> Estimate:
        """The present estimate."""
        return self.situation.estimate

    @property
    def reference(self) -> Reference:
        """The present reference of the path."""
        return self.situation.reference

    @property
    def path(self) -> SampledRoute:
        """The path: nearest points, curvature ahead."""
        return self.loop.route

    def log(self, wall_s: float = 0.0) -> Log:
        """The run so far, with its metrics; `wall_s` is the time that it took [s]. Raises TypeError."""
        check_argument("wall_s", wall_s, hasattr(wall_s, "__float__"), "a number")
        plant, outcome = self.loop.plant, self.outcome or "aborted"
        log = Log(
            self.scenario, self.rows, plant.scene, outcome, wall_s, ruts=plant.ruts(), learned=self.loop.learned()
        )
        found = metrics(log, route=self._measured)
        numbers = {
            "outcome": outcome,
            **({"stop_reason": self.reason} if self.reason else {}),
            **({"rejected_readings": rejected} if (rejected := dict(self.loop.stages.sensors.rejected)) else {}),
            **found,
            **diagnosis(log, RunView(log, self._measured), found),
            "physics_warnings": plant.warnings(),
            "real_time_factor": self.rows.filled * TICK_S / max(wall_s, 1e-9),
            "wall_s": wall_s,
            "identity": self.identity,
        }
        return replace(log, metrics=numbers)
