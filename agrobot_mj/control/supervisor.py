"""Supervisor: decides whether the tractor may go on driving, and stops it under control if not.

Monitors what a real guidance computer can measure: the age of the last fix, the estimated uncertainty, the innovations,
the estimated distance from the path, and whether the wheels follow the command. While the heading is not yet known it
drives straight on slowly; without fixes it holds the pedal, since the speed is not known then; where a limit is
exceeded it returns the pedal to neutral and ends the run as `stopped`, with the reason. `[supervisor]`.
"""

from collections.abc import Sequence
from enum import IntEnum
from math import copysign, degrees, hypot, isfinite, radians
from typing import NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.control.pid import clip
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Column, Command, Measurement
from agrobot_mj.core.spec import NonNegative, Positive

SLOWEST_STEERING = radians(4.0)
"""Rate at which wheels on their way to the command move, even with a worn valve [rad/s]. Estimate."""
STEERING_RATE_S = 0.5
"""Time over which that rate is smoothed: 0.3 deg of noise then count as 0.6 deg/s [s]. Estimate."""


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
    fix_age: float = 0.0
    """Age of the newest fix that the estimator has accepted [s]."""
    place: float = 0.0
    """Distance of the nearest point along the path [m]."""
    offset: float = 0.0
    """Estimated cross-track error, left positive [m]."""
    measured: float | None = None
    """Last measured steering angle; None before the first tick [rad]."""
    rate: float = 0.0
    """Rate of the measured steering angle, smoothed over STEERING_RATE_S [rad/s]."""
    mismatch_s: float = 0.0
    """Time for which the wheels have not followed the command [s]."""
    aligning_s: float = 0.0
    """Time spent aligning [s]."""
    pedal: float = 0.0
    """Pedal reference while coasting and stopping [-]."""
    steer: float = 0.0
    """Last steering command [rad]."""
    still_s: float = 0.0
    """Time for which the pedal has been in neutral while stopping [s]."""
    reason: str = ""
    """Why it stops."""


class Supervisor(Reporting):
    """Limits of autonomous driving; every default is an estimate of what a cautious maker would set."""

    enabled: bool = True
    """Whether the supervisor acts; off in the scenarios of the paper, which has none."""
    coasting_after_s: Positive = 0.6
    """Age of the newest fix from which the tractor counts as coasting [s]. Estimate: late and lost fixes are normal."""
    max_fix_age_s: Positive = 8.0
    """Age of the newest fix at which it stops [s]. Estimate: dead reckoning drifts by decimetres in that time."""
    max_sigma_m: Positive = 1.0
    """Estimated standard deviation of the position at which it stops [m]. Estimate."""
    max_cross_track_m: Positive = 2.0
    """Cross-track error by the estimate at which it stops [m]. Estimate: a swath's width."""
    max_nis: Positive = 100.0
    """Smoothed NIS of the fixes at which it stops [-]. Estimate: an honest filter has 2."""
    max_steer_mismatch_deg: Positive = 12.0
    """Difference of commanded and measured steering angle that counts as not following [deg]. Estimate."""
    steer_mismatch_s: Positive = 2.0
    """Duration of such a difference at which it stops [s]. Estimate: longest travel from stop to stop."""
    aligning_speed_m_s: Positive = 0.8
    """Speed at which it drives straight on until the heading is known [m/s]. Estimate."""
    max_aligning_s: Positive = 15.0
    """Time after which it gives up aligning and stops [s]. Estimate."""
    stopping_pedal_rate_per_s: Positive = 0.5
    """Rate at which the pedal goes back to neutral [1/s]. Estimate: 1.2 m/s in half a second."""
    settle_s: NonNegative = 1.5
    """Time in neutral after which the run ends as stopped [s]. Estimate."""

    def init(self) -> SupervisorState:
        """Before the first tick."""
        return SupervisorState()

    def update(
        self, state: SupervisorState, situation: Situation, measured: Measurement, command: Command, dt: float
    ) -> tuple[SupervisorState, Command]:
        """State and the command that goes to the low-level loops, from the one of the guidance law."""
        if not self.enabled:
            return state, command
        state = self._observe(state, situation, dt)
        if state.mode is not Mode.STOPPING:
            reason = self._exceeded(state, situation)
            mode = Mode.STOPPING if reason else self._mode(state, situation)
            holding = mode is Mode.COASTING and state.mode is Mode.COASTING
            state = state._replace(mode=mode, reason=reason, pedal=state.pedal if holding else measured.pedal)
        return self._commanded(state, situation, measured, command, dt)

    def stopped(self, state: SupervisorState) -> bool:
        """Whether the controlled stop is over."""
        return state.mode is Mode.STOPPING and state.still_s > self.settle_s

    def _observe(self, state: SupervisorState, situation: Situation, dt: float) -> SupervisorState:
        """Age of the fix, place beside the path, following of the wheels."""
        estimate = situation.estimate
        age = estimate.fix_age if isfinite(estimate.fix_age) else 0.0
        beside = situation.route.nearest(estimate.x, estimate.y, state.place, situation.t)
        mismatch, before = state.steer - situation.steer, state.measured
        moved = 0.0 if before is None else situation.steer - before
        rate = state.rate + (moved - state.rate * dt) / STEERING_RATE_S
        # a jump or a ramp of the command takes its time, as long as the wheels are on their way
        coming = copysign(1.0, mismatch) * rate > SLOWEST_STEERING
        following = coming or abs(mismatch) < radians(self.max_steer_mismatch_deg)
        return state._replace(
            fix_age=age,
            place=beside.s,
            offset=hypot(beside.x - estimate.x, beside.y - estimate.y),
            measured=situation.steer,
            rate=rate,
            mismatch_s=0.0 if following else state.mismatch_s + dt,
        )

    def _exceeded(self, state: SupervisorState, situation: Situation) -> str:
        """Which limit is exceeded, in words; empty where none is."""
        sigma, nis = situation.estimate.position_sigma, situation.estimate.nis_mean
        if state.fix_age > self.max_fix_age_s:
            return f"no GNSS fix for {state.fix_age:.1f} s"
        if sigma > self.max_sigma_m:
            return f"position known to {sigma:.2f} m only"
        if nis > self.max_nis:
            return f"fixes contradict the estimate (NIS {nis:.0f})"
        if state.mode >= Mode.TRACKING and abs(state.offset) > self.max_cross_track_m:
            return f"{abs(state.offset):.2f} m off the path"
        if state.mismatch_s > self.steer_mismatch_s:
            return f"wheels {degrees(abs(state.steer - situation.steer)):.0f} deg off the steering command"
        if state.aligning_s > self.max_aligning_s:
            return f"heading unknown after {state.aligning_s:.0f} s"
        return ""

    def _mode(self, state: SupervisorState, situation: Situation) -> Mode:
        if not situation.estimate.aligned:
            return Mode.ALIGNING
        return Mode.COASTING if state.fix_age > self.coasting_after_s else Mode.TRACKING

    def _commanded(
        self, state: SupervisorState, situation: Situation, measured: Measurement, command: Command, dt: float
    ) -> tuple[SupervisorState, Command]:
        """The command of the mode."""
        if state.mode is Mode.ALIGNING:
            command = Command(0.0, self.aligning_speed_m_s)
            state = state._replace(aligning_s=state.aligning_s + dt)
        elif state.mode is Mode.COASTING:  # the speed estimate may drift: the hydrostat's speed does not
            command = command._replace(pedal=state.pedal)
        elif state.mode is Mode.STOPPING:
            reach = self.stopping_pedal_rate_per_s * dt
            pedal = state.pedal + clip(-state.pedal, -reach, reach)
            still = abs(measured.pedal) < 0.02
            state = state._replace(pedal=pedal, still_s=state.still_s + dt if still else 0.0)
            command = command._replace(pedal=pedal)
        return state._replace(steer=command.steer), command

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
        return (float(state.mode), state.fix_age) if self.enabled else ()
