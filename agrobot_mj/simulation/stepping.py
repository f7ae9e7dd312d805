"""Simulation that the caller advances tick by tick.

>>> sim = Simulation("side_slope", {"seed": 3})
>>> m = sim.reset()
>>> while not sim.done:
...     m = sim.step(steer=0.05, speed=1.2)

Without arguments, `step()` uses the guidance law of the scenario, as in `run`. A command consists of a speed and one
steering value: angle, valve voltage, yaw rate or curvature. `drive` is for external guidance programs.
"""

from collections.abc import Mapping
from copy import deepcopy
from math import hypot, nan
from pathlib import Path
from typing import Any

from agrobot_mj.control.base import Situation
from agrobot_mj.core.contracts import check_argument, without_exit
from agrobot_mj.core.copying import independent
from agrobot_mj.core.errors import CommandError, NotFiniteError
from agrobot_mj.core.interrupts import deferring
from agrobot_mj.core.randomness import branch, generators
from agrobot_mj.core.signals import Estimate, Measurement, Quality, Reference, Truth
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.columns import COLUMNS, Tick, row
from agrobot_mj.simulation.commands import command_of
from agrobot_mj.simulation.episodes import LONGEST, SHORTEST, Episodes
from agrobot_mj.simulation.evaluation import Evaluation
from agrobot_mj.simulation.guard import Guard
from agrobot_mj.simulation.log import Log, Rows, SavedRows
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.outcomes import Watch, past_end
from agrobot_mj.simulation.snapshot import Snapshot, loop_state, require_same_scenario, set_loop_state

NOTHING = Measurement(0.0, None, Quality.NONE, nan, nan, nan)
"""Measurement returned for a run that ended before the first measurement."""


class Simulation:
    """Simulation of one scenario, advanced tick by tick with its guidance law or with external commands."""

    def __init__(self, scenario: str | Path | Scenario, overrides: Mapping[str, Any] | None = None) -> None:
        """Create the simulation of a scenario given by name, path or object, with overrides by dotted key. Raises
        `ScenarioError` or TypeError for invalid arguments."""
        if isinstance(scenario, Scenario):
            self.scenario = scenario if overrides is None else scenario.changed(overrides)
        else:
            self.scenario = load_scenario(scenario, overrides)
        self.identity, self._guard = str(self.scenario.identity), Guard()
        with deferring():  # signals take effect while the tractor settles
            self._begin()

    def _begin(self, saved: Snapshot | None = None) -> None:
        """Start a run in its initial state, or prepare a run for the state `saved`, which is restored next."""
        with without_exit():
            loop = Loop(self.scenario, saved and saved.loop.seen)
        plant = loop.plant
        rows = Rows(self.scenario.ticks, plant.wheel_signals, len(plant.scene.bodies), loop.columns)
        self._evaluation, self._episodes = Evaluation(self.scenario, loop, rows), Episodes(loop, rows)
        self.loop, self.rows, self._watch, self.outcome, self.reason = loop, rows, Watch(plant), "", ""
        self._broken_off = False
        if not saved and plant.trouble() == "diverged":  # during settling
            self._diverge(f"the plant ({self.scenario.plant.kind}) diverged while settling at the start")

    def __copy__(self) -> "Simulation":
        """Return an independent simulation in the same state, as `__deepcopy__` does."""
        return self.__deepcopy__({})

    def __deepcopy__(self, memo: dict[int, Any]) -> "Simulation":
        """Return an independent simulation in the same state, with deep copies of the attributes of subclasses."""
        rebuild, arguments, others = self.__reduce__()
        sim: Simulation = rebuild(*arguments)
        memo[id(self)] = sim
        vars(sim).update(deepcopy(others, memo))
        return sim

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the class, the saved state and the attributes of subclasses for pickling."""
        others = {name: value for name, value in vars(self).items() if name not in OWN}
        with self._guard:
            if not self.done:
                self._now()
            return resume_simulation, (type(self), self._save()), others

    def reset(self) -> Measurement:
        """Set the simulation to its initial state. Return the first measurement."""
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
        """Advance one tick with a command. Return the measurement at the end of the tick.

        At most one of `steer` [rad], `curvature` [1/m], `yaw_rate` [rad/s] and `steer_voltage` [V, 0-12, neutral at 6]
        may be given, all positive to the left. Without a steering argument the guidance law of the scenario steers.
        Default of `speed` [m/s]: the speed of the guidance law or, with a steering argument, of the reference. The
        supervisor is active only while the guidance law steers.

        A step is atomic: system signals are delayed until its end, and after an error of a guidance law the previous
        state is restored. Raises `CommandError` for an invalid command, after the end of the run, and while another
        thread uses the simulation.
        """
        given = {}
        if not steer is curvature is yaw_rate is steer_voltage is None:
            wanted = {"steer": steer, "curvature": curvature, "yaw_rate": yaw_rate, "steer_voltage": steer_voltage}
            given = {k: v for k, v in wanted.items() if v is not None}
        with self._guard:
            return self._step(given, speed)

    def _step(self, given: dict[str, float], speed: float | None) -> Measurement:
        """Perform `step` without exclusive access. After an error that follows the log row, the state is incomplete."""
        self._require_whole()
        if self.done:
            raise CommandError(f"the run has ended ({self.outcome}); call reset()")
        filled, stages = self.rows.filled, vars(self.loop.stages)
        before = dict(stages)
        try:
            command = command_of(self.loop, given, speed) if given or speed is not None else None
            tick = self.loop.tick(command)
            self.loop.law.pending = None  # of a tick with an external command
            self._finish_tick(tick, led=command is None)
        except NotFiniteError as error:
            self._diverge(str(error))
        except BaseException:
            self._broken_off = self.rows.filled > filled
            stages.update(before)
            raise
        return self._last()

    def advance(self, ticks: int = LONGEST) -> Measurement:
        """Advance by at least one and at most `ticks` ticks with the guidance law; return the measurement at the end.

        The result is bit-identical to the result of repeated slower calls of `step()` without arguments.
        Ticks with faults or events are performed one at a time. Raises the errors of `step`.
        """
        check_argument("ticks", ticks, isinstance(ticks, int), "a whole number")
        with self._guard:
            self._require_whole()
            if self.done or not self._perform_episode(min(ticks, LONGEST)):
                return self._step({}, None)
            if not (self.done or self.loop.has_sensed):
                self._read_sensors()
            return self._last()

    def _perform_episode(self, most: int) -> int:
        """Perform an episode of at most `most` ticks and return the number of its ticks. The result is 0 if no episode
        is possible, or if `most` is below SHORTEST."""
        if most < SHORTEST:
            return 0
        try:
            count, self._watch.standstill = self._episodes.advance(self._watch.standstill, most)
            return count
        except NotFiniteError as error:
            self._diverge(str(error))
            return 1
        except BaseException:
            self._broken_off = self._episodes.moving
            raise

    def drive(self, request: Any) -> Measurement:
        """Advance one tick with the output of an external program. Return the measurement at the end of the tick.

        `request` has the type of the state of the guidance law. Raises `CommandError` if the law is not external and
        after the end of the run, and TypeError for a request of another type.
        """
        guidance, message = self.scenario.guidance, type(self.loop.guidance.init())
        if not guidance.outside:
            raise CommandError(f'guidance.kind: "{guidance.kind}" has no external program; pass a command to step()')
        check_argument("request", request, isinstance(request, message), f"of type {message.__name__}")
        with self._guard:
            self.loop.stages.guidance = request
            return self._step({}, None)

    def _finish_tick(self, tick: Tick, led: bool) -> None:
        """Write the log row, advance the plant unless the run has ended, and read the sensors. `led` is True if the
        command comes from the guidance law."""
        loop, plant, rows = self.loop, self.loop.plant, self.rows
        try:
            values, t = row(tick)
            rows.append(values, plant.wheels(), plant.poses(), loop.report())
        except (TypeError, ValueError, OverflowError):
            loop.check_reports()
            raise
        r = tick.reference
        led = led and loop.follows_path
        distance = hypot(r.x - t.x, r.y - t.y) if loop.guidance.timed else 0.0
        self.outcome = self._watch.trouble(t, distance, tick.pedal_ref, led) or ""
        if self.outcome:
            return
        if loop.stop_reason:
            self.outcome, self.reason = "stopped", loop.stop_reason
            return
        if rows.filled == len(rows.values) or (led and past_end(self.scenario.path, t)):
            self.outcome, self.reason = self._evaluation.ending()
            return
        loop.advance(tick.drive)
        self._read_sensors()

    def _read_sensors(self) -> None:
        """Read the sensors after the plant has moved, unless the plant has diverged."""
        if self.loop.plant.trouble() == "diverged":  # sensors and filters need finite numbers
            self._diverge(f"the state of the plant ({self.scenario.plant.kind}) is not finite or exceeds 100 m/s")
            return
        self._sense()

    def _sense(self) -> None:
        try:
            self.loop.now()
        except NotFiniteError as error:
            self._diverge(str(error))

    def _diverge(self, reason: str) -> None:
        """End the run as `diverged`. An empty log receives one row with t = 0 and missing values."""
        self.outcome, self.reason = "diverged", reason
        plant, unknown = self.loop.plant, [nan] * (len(COLUMNS) - 1)
        if not self.rows.filled:
            self.rows.append([0.0, *unknown], plant.wheels(), 0.0 * self.rows.poses[0], [nan] * len(self.loop.columns))

    def _require_whole(self) -> None:
        if self._broken_off:
            raise CommandError("an error interrupted the last step; call reset(), or restore() with an earlier state")

    def _last(self) -> Measurement:
        """Return the last measurement, or `NOTHING` if the run ended before the first measurement."""
        return NOTHING if self.done and self.loop.sensed is None else self._now()[0]

    def _observe(self) -> tuple[Measurement, Situation]:
        """Return the measurement and guidance inputs, as `_now` does, with exclusive access while sensors are read."""
        if self.done or self.loop.has_sensed:
            return self._now()
        with self._guard:
            return self._now()

    def _now(self) -> tuple[Measurement, Situation]:
        """Return the measurement and guidance inputs of the current tick or, after the end, of the last tick."""
        if not self.done:
            return self.loop.now()
        if self.loop.sensed is None:
            raise CommandError(f"the run ended before the first measurement: {self.reason}")
        return self.loop.sensed

    def save(self, rows: SavedRows | None = None) -> Snapshot:
        """Return a snapshot, from which `restore` continues bit-identically.

        Saving takes less computing time than half a tick. `rows` replaces the copy of the log in the snapshot.
        """
        with self._guard:
            self._now()
            return self._save(rows)

    def _save(self, rows: SavedRows | None = None) -> Snapshot:
        self._require_whole()
        return Snapshot(
            scenario=self.scenario,
            loop=independent(loop_state(self.loop)),
            rows=rows or self.rows.save(),
            standstill=self._watch.standstill,
            ending=(self.outcome, self.reason),
        )

    def restore(self, state: Snapshot) -> Measurement:
        """Continue from a state saved by any simulation of the same scenario. Return the measurement in this state.

        A state can be restored any number of times. Raises `CommandError` for another scenario, and TypeError for an
        object of another type.
        """
        check_argument("state", state, isinstance(state, Snapshot), "a return value of save()")
        require_same_scenario(state, self.scenario)
        with self._guard:
            self._restore(state)
            return self._last()

    def _restore(self, state: Snapshot) -> None:
        self._broken_off = True
        set_loop_state(self.loop, independent(state.loop))
        self.rows.restore(state.rows)
        self._watch.standstill, (self.outcome, self.reason) = state.standstill, state.ending
        self._broken_off, self._evaluation.progress = False, None
        self._episodes.retry()

    def branch(self, number: int) -> None:
        """Continue with different noise: the random generators of all stages switch to the streams with index `number`.

        Past signals, constant random values (ground, biases) and current values of random walks do not change. Raises
        TypeError unless `number` is an integer.
        """
        check_argument("number", number, isinstance(number, int), "a whole number")
        with self._guard:
            for generator in generators(vars(self.loop.stages)):
                branch(generator, number)

    def abort(self) -> None:
        """End the run as `aborted`. Has no effect on a run that has ended."""
        self.outcome = self.outcome or "aborted"

    @property
    def done(self) -> bool:
        """Whether the run has ended. The attribute `outcome` then contains the result."""
        return self.outcome != ""

    @property
    def measurement(self) -> Measurement:
        """Last measurement of all sensors."""
        return self._last() if self.done else self._observe()[0]

    @property
    def situation(self) -> Situation:
        """Inputs of the guidance law at the current time."""
        return self._observe()[1].fetched()

    @property
    def truth(self) -> Truth:
        """True state of the plant at the current time."""
        return self.loop.truth

    @property
    def estimate(self) -> Estimate:
        """Estimated state at the current time."""
        return self.situation.estimate

    @property
    def reference(self) -> Reference:
        """Desired state on the path at the current time."""
        return self.situation.reference

    @property
    def path(self) -> SampledRoute:
        """Sampled path, with methods for the nearest point and the curvature ahead."""
        return self.loop.route

    def log(self, wall_s: float = 0.0) -> Log:
        """Return the log of the run so far, with metrics; `wall_s` is the wall time of the run [s].

        The outcome in the log of an unfinished run is `aborted`.
        """
        check_argument("wall_s", wall_s, hasattr(wall_s, "__float__"), "a number")
        with self._guard:
            return self._evaluation.log(self.outcome, self.reason, wall_s, self.identity)


OWN = {
    *("scenario", "identity", "loop", "rows", "outcome", "reason"),
    *("_watch", "_evaluation", "_episodes", "_guard", "_broken_off"),
}
"""Names of the attributes of `Simulation` itself. All other attributes belong to subclasses and are copied deeply."""


def resume_simulation(cls: type[Simulation], state: Snapshot) -> Simulation:
    """Return a simulation of the class `cls` in the state of a snapshot."""
    sim = cls.__new__(cls)
    sim.scenario, sim.identity, sim._guard = state.scenario, str(state.scenario.identity), Guard()
    with sim._guard:
        sim._begin(state)
        sim._restore(state)
    return sim
