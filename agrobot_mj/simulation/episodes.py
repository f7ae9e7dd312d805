"""Episodes: consecutive ticks of a run in one compiled call, without Python between the stages.

An episode and the same ticks of a `Loop` give bit-identical results. The ticks of an episode are regular: there are no
faults and events, and the receiver has no latency. The stages are compiled separately and called by address
(`core.calls`); a guidance law or an estimator in Python is called back (`interpreted`). An episode ends before a tick
with an event, such as a change of the brake, the end of the path or a number that is not finite; `Simulation.step` then
performs this tick.
"""

from math import hypot, inf, isfinite, isnan, nan
from typing import Any, NamedTuple, cast

import numpy as np

from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import Followed, Situated, law_form
from agrobot_mj.control.evidence import Sensed
from agrobot_mj.control.pid import STANDSTILL_S, LoopCommand, LoopsState
from agrobot_mj.control.supervision import supervisor_form, tick_link, tracking
from agrobot_mj.control.supervisor import Mode
from agrobot_mj.core.calls import Linked, address_of, caller_of
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.samples import STEP_M, WINDOW_M, reference_in
from agrobot_mj.core.signals import (
    NOMINAL,
    TICK_S,
    Drive,
    Estimate,
    Fix,
    Index,
    Matrix,
    Measurement,
    Quality,
    Reference,
    Truth,
    Vector,
)
from agrobot_mj.estimation.base import CompiledEstimator, Readings, estimator_form
from agrobot_mj.paths.route import references_at
from agrobot_mj.plants.base import PlantCode, TractorMotion, look_form, report_form, steps_form, trouble_of
from agrobot_mj.plants.mujoco.c_api import fail
from agrobot_mj.sensors.gnss import CLEAR
from agrobot_mj.sensors.sensing import Addresses, Laws, SensorReadings, Values, sense
from agrobot_mj.simulation.checks import ABSURD_STEER, is_finite, possible
from agrobot_mj.simulation.columns import COLUMNS, write_row
from agrobot_mj.simulation.interpreted import InterpretedEstimator, InterpretedLaw, interpreted_stages
from agrobot_mj.simulation.log import Rows
from agrobot_mj.simulation.loop import SATURATION_MARGIN, Loop
from agrobot_mj.simulation.low_level import run_loops
from agrobot_mj.simulation.outcomes import LOST_M, Standstill, is_stuck, standstill_after
from agrobot_mj.simulation.receiver import MountedReceiver, advance_receiver, at_axle

HISTORY_S = 6.0
"""Time before a fault in which no episode is performed [s]. In single ticks, the estimator and the supervisor store the
history that delayed fixes require."""
SHORTEST = 5  # Minimum number of ticks for which an episode is faster than single ticks
PAUSE = 10  # Number of single ticks after a tick that is not regular, before an episode is tried again
LONGEST = 200  # Maximum number of ticks in an episode: 10 s of simulated time, about 20 ms of processor time
FIXED, CURVATURE = Quality.FIX, Reference._fields.index("curvature")
COMMON, TRACKING = len(COLUMNS), float(Mode.TRACKING)
Poses = np.ndarray[tuple[int, int, int], np.dtype[np.float64]]


class Code(NamedTuple):
    """Addresses of the compiled stages of a scenario, and of the function that writes the log."""

    sense: int
    estimate: int
    guide: int
    supervise: int
    loops: int
    write: int


class Links(NamedTuple):
    """References to the constant parameters of the stages, and to the random streams of the sensors."""

    sensors: Held[Laws]
    streams: Held[Addresses]
    settings: Held[Any]
    filter: Held[Any]
    guidance: Held[Any]
    supervision: Held[Any]
    loops: Held[Any]


class Columns(NamedTuple):
    """Column numbers of the values reported by the stages; -1 for a value that is not logged."""

    sensed: Index
    guided: Index
    estimated: Index
    implement: Index
    mode: int
    fix_age: int  # Numbers of the columns of the supervisor: mode, and time since the newest accepted fix


class RunNumbers(NamedTuple):
    """Constant parameters of a run, in addition to the parameters of the stages in `Links`."""

    dual: bool  # Whether the receiver has two antennas
    supervises: bool  # Whether the supervisor is active
    timed: bool  # Whether the law follows a moving reference point, as `GuidanceLaw.timed`
    follows: bool  # Whether the law follows the path
    swings: bool  # Whether the antenna is on the implement
    steer_limit: float  # Maximum steering angle [rad]
    saturation: float  # Steering angle above which a command counts as saturated [rad]
    braking: float  # Applied fraction of the brake torque [-]
    measured: Vector  # Array that receives the measurements for an estimator in Python; empty for other estimators
    columns: Columns


class PlannedPath(NamedTuple):
    """Sampled path, and the references of the ticks, for an episode of n ticks."""

    leg: tuple[float, float]  # Arc lengths of the start and end of the leg [m]
    sampled: float  # Arc length up to which the path is sampled [m], or infinity if it ends before
    samples: Matrix
    references: Matrix  # References of all ticks and of the next tick, as rows of `Reference`, shape (n + 1, 7)
    heights: Vector  # Heights of the ground below the references, shape (n,) [m]
    previews: Vector  # Curvatures for `Situated.preview`, shape (n,) [1/m]


class Current(NamedTuple):
    """State of a run between two ticks, after the sensors have been read."""

    truth: Held[Truth]
    motion: TractorMotion
    clear: bool
    ticks: int
    values: Held[Values]
    readings: SensorReadings
    receiver: MountedReceiver
    estimator: Held[Any]
    estimate: Held[Estimate]
    estimated: Vector  # Values of the estimator's columns
    guidance: Held[Any]
    followed: Followed  # Last result of the guidance law
    guided: Vector  # Values of the columns of the guidance law
    supervision: Held[Any]
    loops: LoopsState
    drive: Drive
    pedal: float  # Pedal position measured before the last tick [-]
    standstill: Standstill


_sense, _estimate, _guide, _supervise = (
    caller_of(sense),
    caller_of(estimator_form),
    caller_of(law_form),
    caller_of(supervisor_form),
)
_loops, _write = caller_of(run_loops), caller_of(write_row)
_steps, _look, _report = caller_of(steps_form), caller_of(look_form), caller_of(report_form)
DONE, EVENT, TROUBLE, INVALID, FAILED = range(5)
"""Reasons for the end of an episode: maximum length; event in the next tick; plant trouble, such as a roll-over, after
the last tick (sensors not read); invalid measurement or estimate after the last tick; error of MuJoCo."""


Sensing = tuple[Held[Values], SensorReadings, bool]
"""State of the sensors, measurement, and whether the numbers of the true state are finite."""


class Planned(NamedTuple):
    """Decisions of the control stages in a tick, before the plant moves. `Current` describes uncommented fields."""

    regular: bool  # Whether the episode may perform the tick
    guidance: Held[Any]
    followed: Followed
    guided: Vector
    supervision: Held[Any]
    shown: tuple[float, float, float]  # Values shown by the supervisor, as `SupervisorState.shown`
    loops: LoopsState
    drive: Drive


@jit
def _readings(r: SensorReadings) -> Readings:
    return Readings(r.gnss[4], r.gyro, r.wheel_speed, r.steering_pot, r.imu.roll, r.imu.pitch)


@jit
def _fix(m: SensorReadings, s: RunNumbers) -> Fix:
    """Return the GNSS fix of a measurement, with the position and velocity of the antenna."""
    x, y, vx, vy, t, z = m.gnss
    return Fix(x, y, vx, vy, t, z, wrap(m.heading) if s.dual else nan)


@jit
def _fix_at_axle(receiver: MountedReceiver, m: SensorReadings, s: RunNumbers) -> Fix:
    """Return the GNSS fix of a measurement, converted to the position and velocity of the rear axle."""
    fix, arm = _fix(m, s), receiver.arm
    return fix if arm[0] == 0.0 and arm[1] == 0.0 else at_axle(receiver, _readings(m), fix)


@jit
def _decide(
    now: Current, code: Code, links: Links, s: RunNumbers, path: PlannedPath, r: Reference, preview: float
) -> Planned:
    """Return the decisions of the guidance law, the supervisor and the low-level loops for the current tick.

    `preview` is the path curvature for the feed-forward of the cascade [1/m].
    """
    near, m = now.followed.s, now.readings
    leg, implement = path.leg, (m.implement_gnss.x, m.implement_gnss.y)
    seen = Situated(now.estimate, m.steering_pot, leg[0], leg[1], near, preview, m.gnss[4], m.imu.roll, implement)
    last = now.followed.direction, now.followed.speed
    done, (guidance, found, most, guided) = _guide(
        code.guide, (links.guidance, now.guidance, last, path.samples, seen, r, TICK_S)
    )
    reach = most + STEP_M if isnan(near) else max(most + STEP_M, max(near, leg[0]) + WINDOW_M)
    regular = (
        done and isfinite(found.steer + found.speed) and abs(found.steer) <= ABSURD_STEER and reach <= path.sampled
    )
    regular = regular and not (s.follows and now.loops.brake.standing_s >= STANDSTILL_S)
    steer = min(max(found.steer, -s.steer_limit), s.steer_limit)
    supervision, shown = now.supervision, (0.0, 0.0, 0.0)
    if s.supervises and regular:
        angles = m.imu
        sensed = Sensed(
            m.gnss[4], m.steering_pot, m.pedal_pot, m.gyro, angles.roll, angles.pitch, m.wheel_speed,
            (angles.force_x, angles.force_y, angles.force_z),
        )  # fmt: skip
        fix = _fix(m, s) if s.swings else _fix_at_axle(now.receiver, m, s)
        arguments = links.supervision, now.supervision, path.samples, seen, sensed, fix, FIXED
        done, (supervision, shown, tracks) = _supervise(
            code.supervise, (*arguments, steer, found.speed, now.loops.speed.reference, path.sampled, TICK_S)
        )
        regular = done and tracks
    command = LoopCommand(steer, found.speed, nan, nan, r.vx == 0.0 and r.vy == 0.0)
    done, (loops, (steering, pedal, brake)) = _loops(
        code.loops, (links.loops, now.loops, command, now.estimate, m.steering_pot, m.pedal_pot, TICK_S)
    )
    regular = regular and done and isfinite(steering + pedal) and brake == s.braking
    return Planned(regular, guidance, found, guided, supervision, shown, loops, Drive(steering, pedal, brake))


@jit
def _write_row(
    now: Current, planned: Planned, code: Code, plant: PlantCode, s: RunNumbers, r: Reference, height: float,
    row: Vector, poses: Matrix,
) -> tuple[Standstill, bool]:  # fmt: skip
    """Write a row of the log. Return the new standstill state, and whether a single tick must be performed instead.

    The second result is True if the tick would end the run or has failed.
    """
    m, d, pedal_ref = now.readings, planned.drive, planned.loops.speed.reference
    steer_ref = planned.loops.steering.reference
    saturated = 1.0 if abs(steer_ref) > s.saturation else 0.0
    others = (float(FIXED), m.steering_pot, m.pedal_pot, height, planned.followed.speed, steer_ref, pedal_ref)
    written, here = _write(
        code.write,
        (row, now.truth, _fix(m, s), now.estimate, r, d, now.motion.actuation, (*others, saturated, 0.0)),
    )
    k, done = COMMON, True
    for quantity in range(6):
        for wheel in range(plant.wheels.shape[0]):
            row[k] = plant.wheels[wheel, quantity]
            k += 1
    if plant.report != 0:
        done, report = _report(plant.report, (plant.rig,))
        for i, value in enumerate(report):
            row[s.columns.implement[i]] = value
    for body in range(poses.shape[0]):
        for i in range(3):
            poses[body, i] = plant.positions[body, i]
        for i in range(4):
            poses[body, 3 + i] = plant.quaternions[body, i]
    angles, implement = m.imu, m.implement_gnss
    sensed = (
        m.gnss[5], wrap(m.heading) if s.dual else nan, m.gyro, angles.roll, angles.pitch, angles.force_x,
        angles.force_y, angles.force_z, m.wheel_speed, m.radar_speed, implement.x, implement.y,
    )  # fmt: skip
    for i, value in enumerate(sensed):
        if s.columns.sensed[i] >= 0:
            row[s.columns.sensed[i]] = value
    _scatter(row, s.columns.guided, planned.guided)
    _scatter(row, s.columns.estimated, now.estimated)
    if s.supervises:
        row[s.columns.mode], row[s.columns.fix_age] = TRACKING, planned.shown[0]
    distance = hypot(r.x - here.x, r.y - here.y) if s.timed else 0.0
    standstill = standstill_after(now.standstill, here, distance, pedal_ref, s.follows)
    return standstill, not (written and done) or not distance < LOST_M or is_stuck(standstill, distance)


@jit
def _scatter(row: Vector, columns: Index, values: Vector) -> None:
    for i in range(min(columns.size, values.size)):
        if columns[i] >= 0:
            row[columns[i]] = values[i]


@jit
def _advance_plant(now: Current, drive: Drive, plant: PlantCode) -> tuple[bool, Held[Truth], TractorMotion, bool]:
    """Advance the plant by a tick. Return True on success, the true state, the motion and the new `Current.clear`."""
    volts = drive.steer_voltage, nan if drive.brake > 0.0 else drive.pedal_voltage
    done, (moved, clear) = _steps(plant.steps, (plant.rig, volts, 0, now.clear))
    looked, (truth, motion) = _look(plant.look, (plant.rig, (now.ticks + 1) * TICK_S))
    return done and moved and looked, truth, motion, clear


@jit
def _is_valid(m: SensorReadings, sound: bool, s: RunNumbers) -> bool:
    """Return whether the measurement is valid, so that `checks.Reception` replaces no value.

    `sound` is whether the numbers of the true state are finite.
    """
    angles, valid = m.imu, sound and isfinite(m.steering_pot + m.pedal_pot) and possible(_fix(m, s))
    for value in (m.gyro, angles.roll, angles.pitch, m.wheel_speed):
        valid = valid and abs(value) != inf
    return valid


@jit
def _update_estimate(
    now: Current, values: Held[Values], m: SensorReadings, code: Code, links: Links, s: RunNumbers
) -> tuple[bool, Current]:
    """Update the estimate with the measurement `m`. Return whether the estimate is finite, and the new state."""
    seen, fix = _readings(m), _fix_at_axle(now.receiver, m, s)
    if s.measured.size:
        x, y, vx, vy, t, z = m.gnss
        angles, implement = m.imu, m.implement_gnss
        for k, value in enumerate((
            x, y, vx, vy, t, z, m.heading, m.steering_pot, m.pedal_pot, m.gyro, angles.roll, angles.pitch,
            angles.force_x, angles.force_y, angles.force_z, m.wheel_speed, m.radar_speed, implement.x, implement.y,
        )):  # fmt: skip
            s.measured[k] = value
    done, (estimator, estimate, shown) = _estimate(
        code.estimate, (links.settings, links.filter, now.estimator, seen, fix, FIXED, TICK_S)
    )
    if not (done and is_finite(estimate)):
        return False, now
    e, receiver = fetched(estimate), now.receiver
    if not (receiver.arm[0] == 0.0 and receiver.arm[1] == 0.0):
        receiver = advance_receiver(receiver, seen, e.yaw, e.speed, TICK_S)
    return True, Current(
        now.truth, now.motion, now.clear, now.ticks, values, m, receiver, estimator, estimate, shown, now.guidance,
        now.followed, now.guided, now.supervision, now.loops, now.drive, now.pedal, now.standstill,
    )  # fmt: skip


@stage
def advance(
    now: Current, code: Code, plant: PlantCode, links: Links, s: RunNumbers, path: PlannedPath, values: Matrix,
    poses: Poses, steer: Vector,
) -> tuple[Current, int, int, Sensing]:  # fmt: skip
    """Perform an episode. Return the new state, the number of ticks, the reason for the end and an invalid measurement.

    The state contains the last valid measurement. The last result is valid only if the reason is INVALID. The rows of
    the log are written to `values` and `poses`. `steer` is an empty array, as in `sense`.
    """
    last = now.values, now.readings, True
    for k in range(path.heights.size):
        r = reference_in(path.references, k)
        planned = _decide(now, code, links, s, path, r, path.previews[k])
        if not planned.regular:
            return now, k, EVENT, last
        standstill, ends = _write_row(now, planned, code, plant, s, r, path.heights[k], values[k], poses[k])
        if ends:
            return now, k, EVENT, last
        moved, truth, motion, clear = _advance_plant(now, planned.drive, plant)
        if not moved:
            return now, k, FAILED, last
        now = Current(
            truth, motion, clear, now.ticks + 1, now.values, now.readings, now.receiver, now.estimator,
            now.estimate, now.estimated, planned.guidance, planned.followed, planned.guided, planned.supervision,
            planned.loops, planned.drive, now.readings.pedal_pot, standstill,
        )  # fmt: skip
        if trouble_of(motion, plant.extent) != 0:
            return now, k + 1, TROUBLE, last
        done, (sensors, m, sound) = _sense(code.sense, (links.sensors, now.values, links.streams, truth, CLEAR, steer))
        if not done:
            return now, k, FAILED, last
        valid = _is_valid(m, sound, s)
        if valid:
            valid, now = _update_estimate(now, sensors, m, code, links, s)
        if not valid:
            return now, k + 1, INVALID, (sensors, m, sound)
    return now, path.heights.size, DONE, last


LinkedStages = tuple[Linked, Linked, Linked | None]
"""Compiled estimator, guidance law and supervisor; None replaces an inactive supervisor."""
NO_SAMPLES = np.zeros(0)
SENSED = (
    *("gnss_z", "gnss_heading", "gyro", "imu_roll", "imu_pitch", "imu_force_x", "imu_force_y", "imu_force_z"),
    *("wheel_speed", "radar_speed", "implement_gnss_x", "implement_gnss_y"),
)
"""Columns of the sensors, in the order in which `_write_row` writes them."""
AHEAD_M = 30.0  # Distance up to which the path is sampled ahead of the tractor, in addition to the driven distance [m]


def _code(stages: LinkedStages) -> Code:
    estimator, guidance, supervision = stages
    return Code(
        sense=address_of(sense, sense),
        estimate=address_of(estimator.function, estimator_form),
        guide=address_of(guidance.function, law_form),
        supervise=address_of(supervision.function, supervisor_form) if supervision else 0,
        loops=address_of(run_loops, run_loops),
        write=address_of(write_row, write_row),
    )


class Episodes:
    """Executor that advances the `Loop` of a run by episodes and writes the log to `Rows`."""

    def __init__(self, loop: Loop, rows: Rows) -> None:
        """Prepare the episodes of a run. A run has no episodes if a stage other than law and estimator runs in Python,
        or if an external program computes the law."""
        self.loop, self.rows, self.paused, self.moving = loop, rows, -PAUSE, False
        self.interpreted = interpreted_stages(loop)
        self.possible = {"guidance", "estimator"}.issuperset(self.interpreted) and not loop.guidance.outside
        self.law = InterpretedLaw(loop) if self.possible and "guidance" in self.interpreted else None
        self.filter = InterpretedEstimator(loop) if self.possible and "estimator" in self.interpreted else None
        place = {column: k for k, column in enumerate(rows.columns)}
        parts = loop.guidance, loop.scenario.estimator, loop.plant
        names = SENSED, *([column.name for column in part.columns] for part in parts)
        groups: Any = [np.array([place.get(name, -1) for name in group], dtype=np.int64) for group in names]
        sensed, guided, shown, implement = groups
        self.columns = Columns(
            sensed, guided, shown, implement, place.get("supervisor_state", -1), place.get("fix_age", -1)
        )

    def _stages(self) -> LinkedStages | None:
        """Return the stages for an episode, or None if the next tick is not regular, for example due to a fault."""
        loop, state = self.loop, self.loop.stages
        sensors = state.sensors.sensors
        s, regular = loop.scenario, self.possible and loop.has_sensed and state.conditions is NOMINAL
        regular = regular and loop.plant.conditions == NOMINAL  # not the last tick of a fault
        if not regular or sensors.delivery.pending or loop.plant.trouble() is not None:
            return None
        filters, law = self.filter or cast(CompiledEstimator, s.estimator), self.law
        estimator = filters.compiled_tick(state.estimator)
        guidance = law.compiled_tick(state.guidance) if law else loop.guidance.compiled_tick(state.guidance, s.tractor)
        if estimator is None or guidance is None:
            return None
        if not loop.supervisor.enabled:
            return estimator, guidance, None
        supervision = tick_link(loop.supervisor, state.supervisor, s.tractor, loop.towed, s.sensors.gyro.enabled)
        return supervision and (estimator, guidance, supervision)

    def advance(self, standstill: Standstill, most: int) -> tuple[int, Standstill]:
        """Perform an episode of at most `most` ticks. Return its number of ticks (possibly 0) and the standstill state.

        After plant trouble, the sensors have not been read; after an invalid measurement or estimate, the estimate is
        missing. Raises `mujoco.FatalError` if MuJoCo reports an error.
        """
        rows, self.moving = self.rows, False
        if 0 <= rows.filled - self.paused < PAUSE or (stages := self._stages()) is None:
            return 0, standstill
        found = self._perform(stages, standstill, most)
        if not found[0]:
            self.paused = rows.filled
        return found

    def retry(self) -> None:
        """Permit an episode at the next tick, even if the last attempt was less than PAUSE ticks ago."""
        self.paused = -PAUSE

    def _perform(self, stages: LinkedStages, standstill: Standstill, most: int) -> tuple[int, Standstill]:
        loop, rows, (measured, situation) = self.loop, self.rows, self.loop.now()
        if (parts := loop.plant.code()) is None or measured.fix is None:
            return 0, standstill
        try:
            code = _code(stages)
        except (AttributeError, TypeError):  # a law or an estimator whose function has another form
            self.possible = False
            return 0, standstill
        try:
            planned = self._plan_path(most, stages[1])
        except Exception:  # of a path: raised again at the time at which a single tick requires the reference
            return 0, standstill
        if not (count := len(planned.heights)):
            return 0, standstill
        values: Any = np.full((count, len(rows.columns)), nan)
        poses: Any = np.empty((count, len(rows.poses[0]), 7))
        now, links = self._present(stages, measured, situation, standstill), self._links(stages)
        numbers, self.moving = self._setting(stages), True
        found, done, reason, sensed = advance(now, code, parts, links, numbers, planned, values, poses, NO_SAMPLES)
        rows.extend(values[:done], poses[:done])
        if reason == FAILED:
            fail()
        if done:
            complete = reason in (DONE, EVENT)
            self._resume(found, Reference(*planned.references[done - (not complete)].tolist()), complete)
        if self.law:
            loop.stages.guidance = self.law.end(done)
        if self.filter:
            loop.stages.estimator = self.filter.end(done - (reason in (TROUBLE, INVALID)))
        if reason == INVALID:
            loop.receive(*loop.suite.immediate(loop.stages.sensors.sensors, *sensed))
        self.moving = False
        return done, found.standstill

    def _plan_path(self, most: int, guidance: Linked) -> PlannedPath:
        """Return the path for an episode of at most `most` ticks.

        The episode ends before the last row of the log, the end of the path and the start of the next leg, and
        HISTORY_S before the next fault.
        """
        loop, rows, path, near = self.loop, self.rows, self.loop.scenario.path, guidance.inputs.s
        times: Any = (loop.plant.ticks + np.arange(most + 1)) * TICK_S
        t, ahead = float(times[0]), 0.0 if isnan(near) else near + AHEAD_M
        ahead += 2.0 * path.speed_m_s * most * TICK_S
        samples, legs, sampled = loop.route.sample_until(float(times[-1]), ahead)
        leg = int(np.searchsorted(legs[:, 0], t, "right")) - 1
        low, (until, high) = float(legs[leg, 1]), legs[leg + 1] if leg + 1 < len(legs) else (inf, inf)
        begins = min((fault.start_s for fault in loop.scenario.fault if fault.last_s > t), default=inf)
        end = path.duration_s if path.ends else inf
        count = min(int(np.searchsorted(times, min(until, end))), int(np.searchsorted(times + HISTORY_S, begins)) - 1)
        count = max(min(count, most, len(rows.values) - 1 - rows.filled), 0)
        references, height, preview_s = references_at(path, times[: count + 1]), loop.height, guidance.preview_s
        return PlannedPath(
            leg=(low, float(high)),
            sampled=sampled,
            samples=samples,
            references=references,
            heights=np.array([height(loop.ground, x, y)[0] for x, y in references[:count, :2].tolist()]),
            previews=np.full(count, nan)
            if isnan(preview_s)
            else references_at(path, times[:count] + preview_s)[:, CURVATURE].copy(),
        )

    def _links(self, stages: LinkedStages) -> Links:
        estimator, guidance, supervision = stages
        loop, generators = self.loop, self.loop.stages.sensors.sensors.generators
        return Links(
            *loop.suite.compiled_form(generators, loop.plant.samples.shape[1]),
            *(estimator.law, estimator.inputs, guidance.law, supervision.law if supervision else guidance.law),
            loop.loops.part.law,
        )

    def _setting(self, stages: LinkedStages) -> RunNumbers:
        loop, s = self.loop, self.loop.scenario
        limit = s.tractor.steer_limit
        return RunNumbers(
            dual=s.sensors.gnss.dual_antenna.enabled,
            supervises=stages[2] is not None,
            timed=loop.guidance.timed,
            follows=loop.guidance.follows_path,
            swings=loop.towed.antenna != 0.0,
            steer_limit=limit,
            saturation=limit - SATURATION_MARGIN,
            braking=loop.plant.braking,
            measured=self.filter.measured if self.filter else NO_SAMPLES,
            columns=self.columns,
        )

    def _present(
        self, stages: LinkedStages, measured: Measurement, situation: Situation, standstill: Standstill
    ) -> Current:
        estimator, guidance, supervision = stages
        loop, state, plant = self.loop, self.loop.stages, self.loop.plant
        return Current(
            truth=loop.seen,
            motion=plant.motion,
            clear=plant.clear,
            ticks=plant.ticks,
            values=state.sensors.sensors.values,
            readings=loop.suite.readings_of(measured, state.sensors.sensors.delivery.heading.last),
            receiver=state.receiver,
            estimator=estimator.state,
            estimate=held(situation.estimate),
            estimated=np.array(loop.scenario.estimator.report(state.estimator), dtype=float),
            guidance=guidance.state,
            followed=guidance.inputs,
            guided=NO_SAMPLES,
            supervision=supervision.state if supervision else guidance.state,
            loops=LoopsState(state.speed, state.steering, state.brake),
            drive=Drive(nan, nan),
            pedal=nan,
            standstill=standstill,
        )

    def _resume(self, now: Current, reference: Reference, complete: bool) -> None:
        """Set the states of the loop and the plant after an episode of at least one tick.

        `reference` is the reference at the time of the last measurement. `complete` is whether this measurement belongs
        to the current tick; otherwise the plant has moved since.
        """
        loop, state = self.loop, self.loop.stages
        loop.plant.resume(now.truth, now.motion, now.clear, now.ticks)
        loop.seen, state.wiring = now.truth, now.drive
        if not self.law:
            state.guidance = loop.guidance.state_after_ticks(state.guidance, now.guidance, now.followed, now.guided)
        if loop.supervisor.enabled:
            state.supervisor = tracking(state.supervisor, now.supervision, now.pedal)
        state.speed, state.steering, state.brake = now.loops
        state.receiver = now.receiver
        if not self.filter:
            estimator = cast(CompiledEstimator, loop.scenario.estimator)
            state.estimator = estimator.state_after_ticks(state.estimator, now.estimator, now.estimated)
        sensors, measured = loop.suite.immediate(state.sensors.sensors, now.values, now.readings, True)
        state.sensors = state.sensors._replace(sensors=sensors, steer=measured.steer, pedal=measured.pedal)
        loop.sensed = measured, loop.situation(measured, now.estimate, reference)
        loop.has_sensed = complete
