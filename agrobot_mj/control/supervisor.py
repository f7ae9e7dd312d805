"""Supervisor: decides whether the tractor may go on driving, and stops it under control if not.

`monitors` says what is watched: what a real guidance computer can measure. While the heading is not yet known it drives
slowly by the curvature of the path; without fixes it holds the pedal, since the speed is not known then; where a limit
is exceeded it returns the pedal to neutral and ends the run as `stopped`, with the reason. A pedal that is in doubt
itself, or with which the tractor does not come to rest, loses the power of its valve. `[supervisor]`.
"""

from collections.abc import Sequence
from enum import IntEnum
from math import copysign, hypot, isfinite, radians
from typing import Literal, NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.control.monitors import CLOSER_M, SupervisorLimits, Watched
from agrobot_mj.control.pid import clip
from agrobot_mj.core.signals import Column, Command, Measurement
from agrobot_mj.core.spec import NonNegative, Positive

SLOWEST_STEERING = radians(4.0)
"""Rate at which wheels on their way to the command move, even with a worn valve [rad/s]. Assumed value."""
SLOWEST_PEDAL = 0.15
"""Rate at which a pedal on its way to its reference moves [1/s]. Assumed value: behind a slower ramp it lags by less
than `max_pedal_mismatch`."""
STEERING_RATE_S = 0.5
"""Time over which that rate is smoothed: 0.3 deg of noise then count as 0.6 deg/s [s]. Assumed value."""
SLOWING_M_S2 = 0.5
"""Deceleration at which a tractor follows a falling speed command [m/s2]. Assumed value."""
BEHIND_S = 0.8
"""Time by which its speed lags behind a falling command: pedal, pump and speed loop [s]. Assumed value (0.5-1)."""
STANDING_M_S = 0.15
"""Speed below which the tractor counts as standing [m/s]. Assumed value: four times the noise of a reading."""
OVERDUE_S = 1.0
"""Longest time in which the tractor comes to rest once the pedal is in neutral [s]. Assumed value: three lags of the
pump."""


class Mode(IntEnum):
    """States of the supervisor, as logged in `supervisor_state`."""

    IDLE = 0
    ALIGNING = 1
    TRACKING = 2
    COASTING = 3
    STOPPING = 4


class SupervisorState(NamedTuple):
    """Memory of a `Supervisor`."""

    mode: Mode = Mode.IDLE
    watched: Watched = Watched()
    """Signals that the monitors need."""
    over_s: tuple[float, ...] = ()
    """Time for which the signal of each monitor has been above its limit [s]."""
    readings: tuple[float, float] | None = None
    """Last readings of steering [rad] and pedal [-]; None before the first tick."""
    rate: float = 0.0
    """Rate of the measured steering angle, smoothed over STEERING_RATE_S [rad/s]."""
    pedal: float = 0.0
    """Pedal reference while coasting and stopping [-]."""
    steer: float = 0.0
    """Last steering command [rad]."""
    neutral_s: float = 0.0
    """Time for which the pedal reference has been in neutral while stopping [s]."""
    still_s: float = 0.0
    """Time for which the tractor has stood while stopping [s]."""
    released: bool = False
    """Whether the pedal valve has lost its power."""
    reason: str = ""
    """Why it stops."""


class Supervisor(SupervisorLimits):
    """Supervisor: limits, and what is done when one is exceeded."""

    enabled: bool = True
    """Whether the supervisor acts; off in the scenarios of the paper, which has none."""
    gyro_axes: Literal["vertical", "body"] = "vertical"
    """Axis that the gyro is believed to have, for dead reckoning, as for the estimator."""
    coasting_after_s: Positive = 0.6
    """Age of the newest fix from which the tractor coasts [s]. Assumed value (0.3-1): a few fixes are late or lost."""
    aligning_speed_m_s: Positive = 0.8
    """Speed at which it drives by the curvature of the path until the heading is known [m/s]. Assumed value
    (0.5-1.5)."""
    stopping_pedal_rate_per_s: Positive = 0.5
    """Rate at which the pedal goes back to neutral [1/s]. Assumed value (0.1-1): 1.2 m/s in half a second."""
    settle_s: NonNegative = 1.5
    """Time at rest after which the run ends as stopped [s]. Assumed value (1-3)."""

    def init(self) -> SupervisorState:
        """Before the first tick."""
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
        """State and the command that goes to the low-level loops, from the one of the guidance law.

        `pedal_ref` is the pedal position that the speed loop asked for last [-].
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
        """Whether the controlled stop is over."""
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
        """What the monitors need to know, at a commanded speed [m/s] and pedal [-]."""
        estimate, watched = situation.estimate, state.watched
        beside = situation.route.nearest(estimate.x, estimate.y, watched.place, situation.t)
        mismatch, readings = state.steer - situation.steer, (situation.steer, measured.pedal)
        a, b = (now - last for now, last in zip(readings, state.readings or readings, strict=True))
        pressing = pedal_ref - measured.pedal
        rate = state.rate + (a - state.rate * dt) / STEERING_RATE_S
        # a jump or a ramp of the command takes its time, as long as the wheels are on their way
        coming = copysign(1.0, mismatch) * rate > SLOWEST_STEERING
        following = coming or abs(mismatch) < radians(self.max_steer_mismatch_deg)
        commanded = commanded if estimate.aligned else max(commanded, self.aligning_speed_m_s)
        behind = watched.allowed - commanded
        offset, evidence = hypot(beside.x - estimate.x, beside.y - estimate.y), watched.evidence.after(measured)
        closer = offset < watched.closest - min(CLOSER_M, self.max_cross_track_m / 2)
        watched = Watched(
            fix_age=estimate.fix_age if isfinite(estimate.fix_age) else 0.0,
            place=beside.s,
            curvature=beside.curvature,
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
            pedal_mismatch=0.0 if copysign(1.0, pressing) * b > SLOWEST_PEDAL * dt else pressing,
            pedal_rate=b / dt,
            allowed=max(commanded, watched.allowed - min(SLOWING_M_S2, behind / BEHIND_S) * dt),
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
        elif state.mode is Mode.COASTING:  # the speed estimate may drift: the hydrostat's speed does not
            command = command._replace(pedal=state.pedal)
        elif state.mode is Mode.STOPPING:
            state = self._stopping(state, situation, measured, dt)
            command = command._replace(pedal=state.pedal, released=state.released)
        return state._replace(steer=command.steer), command

    def _stopping(
        self, state: SupervisorState, situation: Situation, measured: Measurement, dt: float
    ) -> SupervisorState:
        """The next tick of a controlled stop: the pedal on its way to neutral, without power where that is no help."""
        reach = self.stopping_pedal_rate_per_s * dt
        pedal = state.pedal + clip(-state.pedal, -reach, reach)
        # either may be wrong: while one of them stands it may be over, while one of them drives it may not be
        speeds = [v for v in (abs(situation.estimate.speed), abs(measured.wheel_speed)) if v == v]
        neutral = state.neutral_s + dt if pedal == 0.0 else 0.0
        released = state.released or (neutral > OVERDUE_S and max(speeds) > STANDING_M_S)
        still = abs(measured.pedal) < 0.02 or (released and min(speeds) < STANDING_M_S)
        still = still and released == state.released  # from the cut on it is counted anew
        return state._replace(
            pedal=pedal, neutral_s=neutral, released=released, still_s=state.still_s + dt if still else 0.0
        )

    @property
    def columns(self) -> tuple[Column, ...]:
        """State of the supervisor, and the age of the fix that it sees."""
        if not self.enabled:
            return ()
        return (
            Column("supervisor_state", "-", "0 idle, 1 aligning, 2 tracking, 3 coasting, 4 stopping"),
            Column("fix_age", "s", "age of the newest fix that the estimator has accepted"),
        )

    def report(self, state: SupervisorState) -> Sequence[float]:
        """Values of `columns`."""
        return (float(state.mode), state.watched.fix_age) if self.enabled else ()
