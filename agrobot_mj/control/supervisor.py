"""Supervisor, which monitors autonomous driving and performs a controlled stop if a signal exceeds its limit.

`monitors` lists the monitored signals, which a real guidance computer can measure. Until the heading is known, the
tractor slowly follows the curvature of the path. Without fixes the speed is unknown and the pedal is frozen. During a
controlled stop the pedal returns to neutral; the run ends as `stopped`, with the reason. If the pedal is faulty or the
tractor does not come to rest, the power of the pedal valve is cut. The scenario table is `[supervisor]`.
"""

from collections.abc import Sequence
from enum import IntEnum
from math import copysign, isfinite, isnan, nan, radians, sqrt
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.control.base import Situation
from agrobot_mj.control.evidence import Sensed, sensor_numbers
from agrobot_mj.control.monitors import (
    CLOSER_M,
    CUTTING,
    REASONS,
    Limits,
    MonitorSignals,
    SupervisorLimits,
    checks,
    over,
)
from agrobot_mj.control.pid import clip
from agrobot_mj.control.reckoning import Reckoning
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.signals import Column, Command, Estimate, Fix, Measurement, PathPoint, Vector
from agrobot_mj.core.spec import NonNegative, Positive

MIN_STEERING_RATE = radians(4.0)
"""Minimum steering rate of wheels that follow their command, even with a worn valve [rad/s]. Assumed value."""
MIN_PEDAL_RATE = 0.15
"""Minimum rate of a pedal that moves towards its command [1/s]. Assumed value."""
STEERING_RATE_S = 0.5
"""Time constant for smoothing the measured steering rate [s]. Assumed value: 0.3 deg of noise then cause 0.6 deg/s."""
SLOWING_M_S2 = 0.5  # Deceleration of the tractor after a decrease of the speed command [m/s2]. Assumed value.
SPEED_LAG_S = 0.8
"""Delay of the tractor speed after a lower speed command [s]. Assumed value (range 0.5-1) for pedal, pump and speed
loop."""
STANDING_M_S = 0.15  # Speed below which the tractor is at rest [m/s]. Assumed value, four times the measurement noise.
OVERDUE_S = 1.0  # Maximum time from neutral pedal to standstill [s]. Assumed value, three time constants of the pump.


class Mode(IntEnum):
    """Operating modes of the supervisor, logged as numbers in the column `supervisor_state`."""

    IDLE = 0
    ALIGNING = 1
    TRACKING = 2
    COASTING = 3
    STOPPING = 4


class SupervisorState(NamedTuple):
    """State of a `Supervisor` between two ticks."""

    mode: Mode = Mode.IDLE
    watched: Held[MonitorSignals] | None = None
    """Monitored signals, or None before the first tick."""
    shown: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Time since the newest accepted fix [s], and arc length [m] and curvature [1/m] of the nearest path point."""
    over_s: Vector = np.zeros(len(REASONS))
    """Weighted time for which each monitor's signal has exceeded its limit [s], shape (monitors,)."""
    pedal: float = 0.0  # Pedal reference while coasting and stopping [-]
    steer: float = 0.0  # Last steering command [rad]
    neutral_s: float = 0.0  # Time since the pedal reference reached neutral during a stop [s]
    still_s: float = 0.0  # Time with a neutral pedal or, after the power cut, at rest during a stop [s]
    released: bool = False  # Whether the power of the pedal valve has been cut
    reason: str = ""  # Reason for the stop
    limits: Held[Limits] | None = None  # Limits of the monitors, or None before the first tick
    reckoning: Reckoning = Reckoning()  # Dead reckoning by wheels and gyro


class Supervisor(SupervisorLimits):
    """Supervisor of autonomous driving: monitors, and a controlled stop after a signal exceeds its limit."""

    enabled: bool = True
    """Whether the supervisor is active. Default: true, but false in scenarios of the paper, which has no supervisor."""
    gyro_axes: Literal["vertical", "body"] = "vertical"
    """Axis of the gyro assumed in dead reckoning: `vertical`, or `body` for an axis fixed to the tractor."""
    coasting_after_s: Positive = 0.6
    """Maximum time since the newest fix before the tractor coasts with a constant pedal position [s]. Assumed value
    (range 0.3-1): the duration of a few missing fixes."""
    aligning_speed_m_s: Positive = 0.8
    """Speed while the heading is unknown and the tractor follows the path curvature [m/s]. Assumed value (range
    0.5-1.5)."""
    stopping_pedal_rate_per_s: Positive = 0.5
    """Rate of the pedal's return to neutral [1/s]. Assumed value (range 0.1-1): a return at 1.2 m/s takes 0.5 s."""
    settle_s: NonNegative = 1.5
    """Time at rest before the run ends with the outcome `stopped` [s]. Assumed value (range 1-3)."""

    def init(self) -> SupervisorState:
        """Return the initial state, in the mode IDLE."""
        return SupervisorState()

    def update(
        self,
        state: SupervisorState,
        situation: Situation,
        measured: Measurement,
        command: Command,
        pedal_ref: float,
        dt: float,
    ) -> tuple[SupervisorState, Command]:
        """Return the new state and the command to the low-level loops, given the `command` of the guidance law.

        `pedal_ref` is the last pedal reference of the speed loop [-]. If not `enabled`, nothing is changed.
        """
        if not self.enabled:
            return state, command
        estimate, situation = held(situation.estimate), situation.fetched()
        e, (m, fix, quality), machine = situation.estimate, sensor_numbers(measured), situation.machine
        limits, watched = state.limits or held(self.limits(machine)), state.watched or held(MonitorSignals())
        nearest = situation.route.nearest(e.x, e.y, state.shown[1], situation.t)
        reckoning = state.reckoning.after(m, fix, quality, machine, self.gyro_axes == "body", dt, situation.towed)
        wanted = MonitoredCommand(state.steer, abs(command.speed), pedal_ref, self.aligning_speed_m_s)
        reckoned = reckoning.distance, reckoning.sigma
        watched, shown, over_s, first, signal, cut = update_monitors(
            limits, watched, state.over_s, nearest, estimate, m, fix, quality, situation.steer, wanted, reckoned, dt
        )
        mode, reason, pedal, steer = state.mode, state.reason, state.pedal, state.steer
        if mode is not Mode.STOPPING:
            late = Mode.COASTING if shown[0] > self.coasting_after_s else Mode.TRACKING
            mode = Mode.STOPPING if first >= 0 else late if e.aligned else Mode.ALIGNING
            reason = REASONS[first].format(signal) if first >= 0 else ""
            pedal = pedal if mode is state.mode is Mode.COASTING else measured.pedal
        rest = state.neutral_s, state.still_s, state.released or cut, reason, limits, reckoning
        return self._command(
            SupervisorState(mode, watched, shown, over_s, pedal, steer, *rest), situation, measured, command, dt
        )

    def is_stopped(self, state: SupervisorState) -> bool:
        """Return whether a controlled stop is complete: the time `still_s` of the state exceeds `settle_s`."""
        return state.mode is Mode.STOPPING and state.still_s > self.settle_s

    def _command(
        self, state: SupervisorState, situation: Situation, measured: Measurement, command: Command, dt: float
    ) -> tuple[SupervisorState, Command]:
        if state.mode is Mode.ALIGNING:
            command = Command(situation.machine.steering_for(state.shown[2]), self.aligning_speed_m_s)
        elif state.mode is Mode.COASTING:  # the estimated speed drifts, whereas the pedal keeps the speed constant
            command = command._replace(pedal=state.pedal)
        elif state.mode is Mode.STOPPING:
            state = self._stopping(state, situation, measured, dt)
            command = command._replace(pedal=state.pedal, released=state.released)
        return state._replace(steer=command.steer), command

    def _stopping(
        self, state: SupervisorState, situation: Situation, measured: Measurement, dt: float
    ) -> SupervisorState:
        """Return the state after a tick of a controlled stop. The pedal returns to neutral. If the tractor does not
        come to rest, the power of the pedal valve is cut."""
        reach = self.stopping_pedal_rate_per_s * dt
        pedal = state.pedal + clip(-state.pedal, -reach, reach)
        # one of both speeds may be wrong: `still` requires one speed at rest, `released` one speed in motion
        speeds = [v for v in (abs(situation.estimate.speed), abs(measured.wheel_speed)) if v == v]
        neutral = state.neutral_s + dt if pedal == 0.0 else 0.0
        released = state.released or (neutral > OVERDUE_S and max(speeds) > STANDING_M_S)
        still = abs(measured.pedal) < 0.02 or (released and min(speeds) < STANDING_M_S)
        still = still and released == state.released  # restart the count after the cut
        return state._replace(
            pedal=pedal, neutral_s=neutral, released=released, still_s=state.still_s + dt if still else 0.0
        )

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the supervisor mode and of the time since the newest accepted fix."""
        if not self.enabled:
            return ()
        return (
            Column("supervisor_state", "-", "0 idle, 1 aligning, 2 tracking, 3 coasting, 4 stopping"),
            Column("fix_age", "s", "time since the newest fix accepted by the estimator"),
        )

    def report(self, state: SupervisorState) -> Sequence[float]:
        """Return the values of the log columns for a state of the supervisor."""
        return (float(state.mode), state.shown[0]) if self.enabled else ()


class MonitoredCommand(NamedTuple):
    """Commands that the monitors compare with the measurements."""

    steer: float  # Last steering command [rad]
    speed: float  # Absolute commanded speed [m/s]
    pedal: float  # Last pedal reference of the speed loop [-]
    aligning: float  # Commanded speed until the heading is known [m/s]


@stage
def update_monitors(
    most: Held[Limits], w: Held[MonitorSignals], over_s: Vector, nearest: PathPoint, estimate: Held[Estimate],
    m: Sensed, fix: Fix, quality: int, steer: float, wanted: MonitoredCommand, reckoned: tuple[float, float], dt: float,
) -> tuple[Held[MonitorSignals], tuple[float, float, float], Vector, int, float, bool]:  # fmt: skip
    """Return the monitor signals after a tick, `SupervisorState.shown`, and the new `SupervisorState.over_s` [s].

    Also return the index of the first monitor that requires a stop (or -1), the signal of this monitor, and whether a
    monitor cuts the power of the pedal valve.
    """
    most, e = fetched(most), fetched(estimate)
    w = _next_signals(most, fetched(w), nearest, e, m, fix, quality, steer, wanted, dt)
    found = checks(most, w, e, m, fix, steer, reckoned)
    after, first, signal, cut = np.zeros(len(found)), -1, nan, False
    for k in range(len(found)):
        check = found[k]
        after[k] = over(check, over_s[k], dt)
        if after[k] > check[2]:
            cut = cut or k in CUTTING
            if first < 0:
                first, signal = k, check[0]
    return held(w), (w.fix_age, w.place, w.curvature), after, first, signal, cut


@jit
def _next_signals(
    most: Limits, w: MonitorSignals, nearest: PathPoint, e: Estimate, m: Sensed, fix: Fix, quality: int, steer: float,
    wanted: MonitoredCommand, dt: float,
) -> MonitorSignals:  # fmt: skip
    evidence, first = w.evidence.after(m, fix, quality), isnan(w.readings[0])
    mismatch, pressing = wanted.steer - steer, wanted.pedal - m.pedal
    a, b = (0.0, 0.0) if first else (steer - w.readings[0], m.pedal - w.readings[1])
    rate = w.rate + (a - w.rate * dt) / STEERING_RATE_S
    # no mismatch while the wheels still move towards the command
    coming = copysign(1.0, mismatch) * rate > MIN_STEERING_RATE
    following = coming or abs(mismatch) < radians(most.max_steer_mismatch_deg)
    pressed = copysign(1.0, pressing) * b > MIN_PEDAL_RATE * dt
    commanded = wanted.speed if e.aligned else max(wanted.speed, wanted.aligning)
    behind, east, north = w.allowed - commanded, nearest.x - e.x, nearest.y - e.y
    offset = sqrt(east * east + north * north)
    closer = offset < w.closest - min(CLOSER_M, most.max_cross_track_m / 2)
    return MonitorSignals(
        e.fix_age if isfinite(e.fix_age) else 0.0,
        nearest.s,
        nearest.curvature,
        offset,
        offset if closer and e.aligned else w.closest,
        0.0 if closer or not e.aligned else w.closing_s + dt,
        0.0 if following else mismatch,
        evidence,
        w.gyro.after(m),
        w.turn.after(m, fix, quality, dt),
        w.attitude.after(m, evidence.moving, dt),
        0.0 if pressed else pressing,
        b / dt,
        max(commanded, w.allowed - min(SLOWING_M_S2, behind / SPEED_LAG_S) * dt),
        w.tracked or e.aligned,
        0.0 if e.aligned else w.aligning_s + dt,
        (steer, m.pedal),
        rate,
    )
