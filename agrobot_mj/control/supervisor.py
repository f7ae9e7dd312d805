"""Supervisor: decides whether the tractor may continue autonomously, and otherwise performs a controlled stop.

`monitors` lists the monitored signals, which a real guidance computer can measure. Until the heading is known, the
tractor follows the curvature of the path slowly. Without fixes the speed is unknown and the pedal is frozen. If a
signal exceeds its limit, the pedal returns to neutral and the run ends as `stopped`, with the reason. If the pedal is
faulty or the tractor does not come to rest, the power of the pedal valve is cut. Configured in `[supervisor]`.
"""

from collections.abc import Sequence
from enum import IntEnum
from math import copysign, hypot, isfinite, radians
from typing import Literal, NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.control.monitors import CLOSER_M, MonitorSignals, SupervisorLimits
from agrobot_mj.control.pid import clip
from agrobot_mj.core.signals import Column, Command, Measurement
from agrobot_mj.core.spec import NonNegative, Positive

MIN_STEERING_RATE = radians(4.0)
"""Minimum rate of wheels that follow their command, even with a worn valve [rad/s]. Assumed value."""
MIN_PEDAL_RATE = 0.15
"""Minimum rate of a pedal that follows its command [1/s]. Assumed value; limits the lag to `max_pedal_mismatch`."""
STEERING_RATE_S = 0.5
"""Time constant for smoothing the measured steering rate [s]. Assumed value; noise of 0.3 deg causes 0.6 deg/s."""
SLOWING_M_S2 = 0.5
"""Deceleration of the tractor after a decrease of the speed command [m/s2]. Assumed value."""
SPEED_LAG_S = 0.8
"""Delay of the speed after a decrease of the command: pedal, pump and speed loop [s]. Assumed value (0.5-1)."""
STANDING_M_S = 0.15
"""Speed below which the tractor is at rest [m/s]. Assumed value, four times the measurement noise."""
OVERDUE_S = 1.0
"""Maximum time from neutral pedal to standstill [s]. Assumed value, three time constants of the pump."""


class Mode(IntEnum):
    """States of the supervisor, logged in `supervisor_state`."""

    IDLE = 0
    ALIGNING = 1
    TRACKING = 2
    COASTING = 3
    STOPPING = 4


class SupervisorState(NamedTuple):
    """State of a `Supervisor`."""

    mode: Mode = Mode.IDLE
    watched: MonitorSignals = MonitorSignals()
    """Signals computed for the monitors."""
    over_s: tuple[float, ...] = ()
    """Weighted time for which the signal of each monitor has exceeded its limit [s]."""
    readings: tuple[float, float] | None = None
    """Last measured steering angle [rad] and pedal [-]; None before the first tick."""
    rate: float = 0.0
    """Rate of the measured steering angle, smoothed over STEERING_RATE_S [rad/s]."""
    pedal: float = 0.0
    """Pedal reference while coasting and stopping [-]."""
    steer: float = 0.0
    """Last steering command [rad]."""
    neutral_s: float = 0.0
    """Time for which the pedal reference has been neutral during a stop [s]."""
    still_s: float = 0.0
    """Time for which the tractor has been at rest during a stop [s]."""
    released: bool = False
    """Whether the power of the pedal valve has been cut."""
    reason: str = ""
    """Reason for the stop."""


class Supervisor(SupervisorLimits):
    """Limits of autonomous driving, and the controlled stop if a limit is exceeded."""

    enabled: bool = True
    """Whether the supervisor is active. Default: true; false in the scenarios of the paper, which has no supervisor."""
    gyro_axes: Literal["vertical", "body"] = "vertical"
    """Axis of the gyro assumed in dead reckoning, as for the estimator."""
    coasting_after_s: Positive = 0.6
    """Maximum age of the newest fix before the tractor coasts [s]. Assumed value (0.3-1), a few missing fixes."""
    aligning_speed_m_s: Positive = 0.8
    """Speed along the curvature of the path until the heading is known [m/s]. Assumed value (0.5-1.5)."""
    stopping_pedal_rate_per_s: Positive = 0.5
    """Rate at which the pedal returns to neutral [1/s]. Assumed value (0.1-1); 0.5 s from 1.2 m/s to a stop."""
    settle_s: NonNegative = 1.5
    """Time at rest before the run ends as `stopped` [s]. Assumed value (1-3)."""

    def init(self) -> SupervisorState:
        """Return the initial state."""
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
        """Return the new state and the command to the low-level loops for the command of the guidance law.

        `pedal_ref` is the last pedal reference of the speed loop [-].
        """
        if not self.enabled:
            return state, command
        state = self._observe(state, situation, measured, abs(command.speed), pedal_ref, dt)
        monitors = self.monitors(state.watched, situation, measured)
        before = state.over_s or (0.0,) * len(monitors)
        state = state._replace(over_s=tuple(m.over(time, dt) for m, time in zip(monitors, before, strict=True)))
        tripped = [m for m, time in zip(monitors, state.over_s, strict=True) if time > m.lasting_s]
        if state.mode is not Mode.STOPPING:
            mode = Mode.STOPPING if tripped else self._mode(state, situation)
            holding = mode is Mode.COASTING and state.mode is Mode.COASTING
            reason = tripped[0].reason.format(tripped[0].signal) if tripped else ""
            state = state._replace(mode=mode, reason=reason, pedal=state.pedal if holding else measured.pedal)
        if any(monitor.cut for monitor in tripped):
            state = state._replace(released=True)
        return self._commanded(state, situation, measured, command, dt)

    def stopped(self, state: SupervisorState) -> bool:
        """Whether the controlled stop is complete."""
        return state.mode is Mode.STOPPING and state.still_s > self.settle_s

    def _observe(
        self,
        state: SupervisorState,
        situation: Situation,
        measured: Measurement,
        commanded: float,
        pedal_ref: float,
        dt: float,
    ) -> SupervisorState:
        """Return the state with the signals of the monitors, for a commanded speed [m/s] and pedal reference [-]."""
        estimate, watched = situation.estimate, state.watched
        nearest = situation.route.nearest(estimate.x, estimate.y, watched.place, situation.t)
        mismatch, readings = state.steer - situation.steer, (situation.steer, measured.pedal)
        a, b = (now - last for now, last in zip(readings, state.readings or readings, strict=True))
        pressing = pedal_ref - measured.pedal
        rate = state.rate + (a - state.rate * dt) / STEERING_RATE_S
        # no mismatch while the wheels still move towards the command
        coming = copysign(1.0, mismatch) * rate > MIN_STEERING_RATE
        following = coming or abs(mismatch) < radians(self.max_steer_mismatch_deg)
        commanded = commanded if estimate.aligned else max(commanded, self.aligning_speed_m_s)
        behind = watched.allowed - commanded
        offset, evidence = hypot(nearest.x - estimate.x, nearest.y - estimate.y), watched.evidence.after(measured)
        closer = offset < watched.closest - min(CLOSER_M, self.max_cross_track_m / 2)
        watched = MonitorSignals(
            fix_age=estimate.fix_age if isfinite(estimate.fix_age) else 0.0,
            place=nearest.s,
            curvature=nearest.curvature,
            offset=offset,
            closest=offset if closer and estimate.aligned else watched.closest,
            closing_s=0.0 if closer or not estimate.aligned else watched.closing_s + dt,
            mismatch=0.0 if following else mismatch,
            evidence=evidence,
            gyro=watched.gyro.after(measured),
            turn=watched.turn.after(measured, dt),
            attitude=watched.attitude.after(measured, evidence.moving, dt),
            reckoning=watched.reckoning.after(
                measured, situation.machine, self.gyro_axes == "body", dt, situation.towed
            ),
            pedal_mismatch=0.0 if copysign(1.0, pressing) * b > MIN_PEDAL_RATE * dt else pressing,
            pedal_rate=b / dt,
            allowed=max(commanded, watched.allowed - min(SLOWING_M_S2, behind / SPEED_LAG_S) * dt),
            tracked=watched.tracked or estimate.aligned,
            aligning_s=0.0 if estimate.aligned else watched.aligning_s + dt,
        )
        return state._replace(watched=watched, readings=readings, rate=rate)

    def _mode(self, state: SupervisorState, situation: Situation) -> Mode:
        if not situation.estimate.aligned:
            return Mode.ALIGNING
        return Mode.COASTING if state.watched.fix_age > self.coasting_after_s else Mode.TRACKING

    def _commanded(
        self, state: SupervisorState, situation: Situation, measured: Measurement, command: Command, dt: float
    ) -> tuple[SupervisorState, Command]:
        if state.mode is Mode.ALIGNING:
            command = Command(situation.machine.steering_for(state.watched.curvature), self.aligning_speed_m_s)
        elif state.mode is Mode.COASTING:  # the estimated speed drifts, whereas the pedal keeps the speed constant
            command = command._replace(pedal=state.pedal)
        elif state.mode is Mode.STOPPING:
            state = self._stopping(state, situation, measured, dt)
            command = command._replace(pedal=state.pedal, released=state.released)
        return state._replace(steer=command.steer), command

    def _stopping(
        self, state: SupervisorState, situation: Situation, measured: Measurement, dt: float
    ) -> SupervisorState:
        """Return the state after one tick of a stop: pedal towards neutral, power cut if the tractor does not stop."""
        reach = self.stopping_pedal_rate_per_s * dt
        pedal = state.pedal + clip(-state.pedal, -reach, reach)
        # one speed may be wrong: `still` needs one at rest, `released` one in motion
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
        """Log columns of the supervisor mode and the age of the newest accepted fix."""
        if not self.enabled:
            return ()
        return (
            Column("supervisor_state", "-", "0 idle, 1 aligning, 2 tracking, 3 coasting, 4 stopping"),
            Column("fix_age", "s", "time since the newest fix accepted by the estimator"),
        )

    def report(self, state: SupervisorState) -> Sequence[float]:
        """Return the values of `columns` for a state."""
        return (float(state.mode), state.watched.fix_age) if self.enabled else ()
