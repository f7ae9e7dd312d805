"""A run that is stepped from outside, tick by tick: `Simulation`.

>>> sim = Simulation("side_slope", {"seed": 3})
>>> m = sim.reset()
>>> while not sim.done:
...     m = sim.step(steer=0.05, speed=1.2)

`step()` without a command lets the scenario's own guidance drive; `run` is built on that. A command is one of steering
angle, valve voltage, yaw rate or curvature, beside a speed. `drive` is for a program that the guidance stands for.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from math import hypot, nan
from pathlib import Path
from typing import Any

from agrobot_mj.control.base import Situation
from agrobot_mj.core.contracts import check_argument, without_exit
from agrobot_mj.core.copying import independent
from agrobot_mj.core.errors import CommandError, NotFiniteError
from agrobot_mj.core.randomness import branch, generators
from agrobot_mj.core.signals import TICK_S, Estimate, Measurement, Quality, Reference, Truth
from agrobot_mj.metrics import RunView, commanded_progress, metrics, progress_of
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.columns import COLUMNS, Tick, row
from agrobot_mj.simulation.commands import command_of
from agrobot_mj.simulation.diagnosis import diagnosis
from agrobot_mj.simulation.guard import Guard
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.outcomes import Watch, past_end
from agrobot_mj.simulation.snapshot import Snapshot, loop_state, require_same_scenario, set_loop_state

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
        self.identity, self._guard = str(self.scenario.identity), Guard()
        with self._guard:
            self._begin()

    def _begin(self, saved: Snapshot | None = None) -> None:
        """Begin a run at its start, or the one of a state that is about to be restored."""
        with without_exit():
            loop = Loop(self.scenario, saved and saved.loop.truth)
        plant = loop.plant
        rows = Rows(self.scenario.ticks, plant.wheels().size, len(plant.scene.bodies), loop.columns)
        self._measured = SampledRoute(self.scenario.path)  # not the law's, whose samples no metric may add to
        self.loop, self.rows, self._watch, self.outcome, self.reason = loop, rows, Watch(plant), "", ""
        self._broken_off = False
        if not saved and plant.trouble() == "diverged":  # while it settled
            self._diverge(f"the plant ({self.scenario.plant.kind}) diverged while it came to rest at the start")

    def __copy__(self) -> "Simulation":
        """Return an independent simulation in the same state."""
        return self.__deepcopy__({})

    def __deepcopy__(self, memo: dict[int, Any]) -> "Simulation":
        """As `copy.copy`, for attributes of a subclass by deep copies."""
        rebuild, arguments, others = self.__reduce__()
        sim: Simulation = rebuild(*arguments)
        memo[id(self)] = sim
        vars(sim).update(deepcopy(others, memo))
        return sim

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the class, the state of `save`, and attributes of a subclass."""
        others = {name: value for name, value in vars(self).items() if name not in OWN}
        with self._guard:
            if not self.done:
                self._now()
            return _resumed, (type(self), self._save()), others

    def reset(self) -> Measurement:
        """Place the tractor at the start again; returns the first measurement."""
        with self._guard:
            if self.loop.sensed is not None or self.rows.filled:
                self._begin()
            if not self.done:
                self._sense()
            return self._last()

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
        all left positive; without any the scenario's guidance drives. `speed` [m/s] is the guidance's or, with a
        steering command, the reference's by default. The supervisor watches only the scenario's own guidance. A step
        completes or does not happen: signals are held back until its end, and an error of a law leaves the state before
        it. Raises `CommandError` for an invalid command, after the end, and while another thread uses the simulation.
        """
        wanted = {"steer": steer, "curvature": curvature, "yaw_rate": yaw_rate, "steer_voltage": steer_voltage}
        given = {k: v for k, v in wanted.items() if v is not None}
        with self._guard:
            return self._step(given, speed)

    def _step(self, given: dict[str, float], speed: float | None) -> Measurement:
        """As `step`. An error after the row is written ends the use of this state, as half a tick is done."""
        self._require_whole()
        if self.done:
            raise CommandError(f"the run has ended ({self.outcome}); call reset()")
        filled, stages = self.rows.filled, vars(self.loop.stages)
        before = dict(stages)
        try:
            command = command_of(self.loop, given, speed) if given or speed is not None else None
            self._finish_tick(self.loop.tick(command), led=command is None)
        except NotFiniteError as error:
            self._diverge(str(error))
        except BaseException:
            self._broken_off = self.rows.filled > filled
            stages.update(before)
            raise
        return self._last()

    def drive(self, request: Any) -> Measurement:
        """One tick under a program outside; what the sensors measure at its end.

        `request` is of the type of the guidance's state. Raises `CommandError` where the guidance drives by itself, and
        for a step after the end; TypeError for another request.
        """
        guidance, message = self.scenario.guidance, type(self.loop.guidance.init())
        if not guidance.outside:
            raise CommandError(f'guidance.kind: "{guidance.kind}" drives by itself; give step() a command of your own')
        check_argument("request", request, isinstance(request, message), f"of type {message.__name__}")
        with self._guard:
            self.loop.stages.guidance = request
            return self._step({}, None)

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
        if rows.filled == self.scenario.ticks or (led and past_end(self.scenario.path, t)):
            self._complete()
            return
        loop.advance(tick.drive)
        if plant.trouble() == "diverged":  # nothing that a sensor or a filter could work with
            self._diverge(f"the state of the plant ({self.scenario.plant.kind}) is not finite, or faster than 100 m/s")
            return
        self._sense()

    def _complete(self) -> None:
        """End the run: completed if enough was driven of the path, or of what a guidance without one has commanded."""
        view = RunView(Log(self.scenario, self.rows, self.loop.plant.scene, "", 0.0), self._measured)
        progress = progress_of(view) if self.loop.guidance.follows_path else commanded_progress(view)
        self.outcome = "completed" if progress.enough else "unfinished"
        if not progress.enough:
            self.reason = f"drove {progress.driven:.1f} of {progress.length:.1f} m"

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

    def _require_whole(self) -> None:
        if self._broken_off:
            raise CommandError("an error broke the last step off; call reset(), or restore() a state saved before")

    def _last(self) -> Measurement:
        """The last measurement of the sensors."""
        return NOTHING if self.done and self.loop.sensed is None else self._now()[0]

    def _seen(self) -> tuple[Measurement, Situation]:
        """As `_now`, for callers from outside: the sensors are not read while a step is under way."""
        if self.done or self.loop.has_sensed:
            return self._now()
        with self._guard:
            return self._now()

    def _now(self) -> tuple[Measurement, Situation]:
        """What is sensed in this tick; what was sensed last where the run has ended."""
        if not self.done:
            return self.loop.now()
        if self.loop.sensed is None:
            raise CommandError(f"the run ended before anything was sensed: {self.reason}")
        return self.loop.sensed

    def save(self) -> Snapshot:
        """The state now, from which `restore` goes on to the last bit; costs less than half a tick."""
        with self._guard:
            self._now()
            return self._save()

    def _save(self) -> Snapshot:
        self._require_whole()
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
        with self._guard:
            self._restore(state)
            return self._last()

    def _restore(self, state: Snapshot) -> None:
        self._broken_off = True
        set_loop_state(self.loop, independent(state.loop))
        self.rows.restore(state.rows)
        self._watch.standstill, (self.outcome, self.reason) = state.standstill, state.ending
        self._broken_off = False

    def branch(self, number: int) -> None:
        """Let all noise go on otherwise from here: every random generator of the stages by a stream of this number.

        The past, what it was drawn of once (the ground, a bias) and the values that wander stay. Raises TypeError for
        what is no whole number.
        """
        check_argument("number", number, isinstance(number, int), "a whole number")
        with self._guard:
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
        return self._last() if self.done else self._seen()[0]

    @property
    def situation(self) -> Situation:
        """All that a guidance law may know now."""
        return self._seen()[1]

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
        with self._guard:
            return self._log(wall_s)

    def _log(self, wall_s: float) -> Log:
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


OWN = {"scenario", "identity", "loop", "rows", "outcome", "reason", "_watch", "_measured", "_guard", "_broken_off"}
"""Attributes of a simulation that its state decides."""


def _resumed(cls: type[Simulation], state: Snapshot) -> Simulation:
    """A simulation of a class in a saved state."""
    sim = cls.__new__(cls)
    sim.scenario, sim.identity, sim._guard = state.scenario, str(state.scenario.identity), Guard()
    with sim._guard:
        sim._begin(state)
        sim._restore(state)
    return sim
