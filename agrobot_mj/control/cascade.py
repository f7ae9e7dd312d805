"""Cascaded guidance: an outer law sets a yaw-rate reference, and a yaw controller follows this reference.

The outer law maps the position error to references of speed and yaw rate. The yaw controller maps the yaw-rate error to
a steering angle, to which the feed-forward angle of the outer law (`feedforward`) is added.
"""

from collections.abc import Sequence
from math import isfinite, nan
from typing import Any, NamedTuple

from agrobot_mj.control.base import YAW_COLUMNS, GuidanceLaw, Situation, YawCommand, YawController, excess_of
from agrobot_mj.control.pid import clip
from agrobot_mj.control.speed_network import SpeedNetworkState
from agrobot_mj.core.calls import Linked
from agrobot_mj.core.contracts import check_update, one_line
from agrobot_mj.core.errors import NotFiniteError, ScenarioError
from agrobot_mj.core.held import Held
from agrobot_mj.core.signals import Column, Command
from agrobot_mj.machine.tractor import TractorParameters


def _is_finite(command: YawCommand, name: str, kind: str) -> bool:
    """Return whether the numbers of a command are finite, except `q`. Raises `ScenarioError` for a wrong type."""
    try:
        isfinite(command.q)  # raises an error unless the field is a number
        return isfinite(command.steer + command.tau_c + command.tau_n)
    except (TypeError, ValueError, OverflowError):
        raise ScenarioError(f"{name} ({kind}) returned a non-numeric command: {one_line(command)}") from None


SPEED_COLUMNS = (
    Column("speed_tau_c", "m/s", "output of the proportional speed controller"),
    Column("speed_tau_n", "m/s", "output of the speed network; tau_c - tau_n is added to the speed command"),
)
"""Log columns of the speed network, present if `speed_network` is configured."""


class CascadeState(NamedTuple):
    """State of a `Cascade` between two ticks."""

    controller: Any
    yaw_rate_ref: float = nan  # Last yaw-rate reference [rad/s]
    e_yaw_rate: float = nan  # Last yaw-rate reference minus estimated yaw rate [rad/s]
    command: YawCommand = YawCommand(0.0)  # Last command of the yaw controller
    feedforward: float = 0.0  # Last feed-forward angle [rad]
    speed: SpeedNetworkState = SpeedNetworkState()  # State of the speed network; unchanged without a speed network


class Cascade(GuidanceLaw):
    """Guidance law that combines an outer law and a yaw controller, created by `CascadeLaw.using`."""

    kind: str = "cascade"
    law: Any
    """Outer law (a `kinematic.CascadeLaw`), which sets the references of speed and yaw rate."""
    controller: YawController
    """Yaw controller of the inner loop."""

    def init(self) -> CascadeState:
        """Return the initial state of the yaw controller and the speed network."""
        return CascadeState(self.controller.init())

    def update(self, state: CascadeState, situation: Situation, dt: float) -> tuple[CascadeState, Command]:
        """Return the new state and the command, computed by the outer law and then by the yaw controller."""
        speed_ref, yaw_rate_ref = self.law.setpoints(situation)
        if not isfinite(speed_ref + yaw_rate_ref):
            raise NotFiniteError(
                f"speed {speed_ref} m/s or yaw rate {yaw_rate_ref} rad/s of the guidance law ({self.law.kind}) is not "
                "finite"
            )
        e_yaw_rate = yaw_rate_ref - situation.estimate.yaw_rate
        limit = situation.steer_limit(self.law.lateral_acceleration_m_s2)
        scaled = self.law.gain_scale(situation) * e_yaw_rate
        found = self.controller.update(state.controller, situation.t, scaled, dt, limit)
        names = "the controller", self.controller.kind
        controller, command = check_update(found, YawCommand, *names, "update")
        if not _is_finite(command, *names):
            steer, tau_c, tau_n, _ = command
            raise NotFiniteError(
                f"steer {steer} rad, tau_c {tau_c} rad or tau_n {tau_n} rad of the controller "
                f"({self.controller.kind}) is not finite"
            )
        ahead = self.law.feedforward(situation)
        steer = clip(command.steer + ahead, -limit, limit)
        if excess := excess_of(command, ahead, steer, situation.steer):
            controller = self.controller.relieve(controller, excess)
        speed, network = state.speed, self.law.speed_network
        if network:
            speed, speed_ref = network.update(speed, speed_ref, situation.estimate.speed, dt)
        return CascadeState(controller, yaw_rate_ref, e_yaw_rate, command, ahead, speed), Command(steer, speed_ref)

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python method `update`."""
        return bool(self.controller.interpreted or self.law.interpreted or self.law.speed_network)

    def compiled_tick(self, state: CascadeState, machine: TractorParameters) -> Linked | None:
        """Return the function and data for ticks in compiled code, or None if the next tick needs Python."""
        from agrobot_mj.control import cascade_tick  # imports this module

        return cascade_tick.tick_link(self, state, machine)

    def state_after_ticks(self, state: CascadeState, found: Held[Any], followed: Any, shown: Any) -> CascadeState:
        """Return the state after ticks in compiled code; `found` is their last state."""
        from agrobot_mj.control import cascade_tick

        return cascade_tick.state_after_ticks(self, state, found)

    def feedback(self, state: CascadeState, command: Command) -> float:
        """Return the steering angle of the yaw controller [rad] in the last tick, without feed-forward."""
        return state.command.steer

    @property
    def follows_path(self) -> bool:
        """Whether the law follows the path, which requires a yaw controller with feedback."""
        return self.controller.closed_loop

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the cascade, the outer law and the yaw controller."""
        speed = SPEED_COLUMNS if self.law.speed_network else ()
        return (*YAW_COLUMNS, *self.law.columns, *self.controller.columns, *speed)

    def report(self, state: CascadeState) -> Sequence[float]:
        """Return the values of the log columns for a state of the cascade."""
        c = state.command
        own = (state.yaw_rate_ref, state.e_yaw_rate, c.tau_c, c.tau_n, c.q)
        speed = (state.speed.tau_c, state.speed.tau_n) if self.law.speed_network else ()
        return (*own, *self.law.report(state), *self.controller.report(state.controller), *speed)
