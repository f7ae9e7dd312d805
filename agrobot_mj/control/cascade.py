"""Guidance in cascade: a law that sets a yaw-rate reference, and a yaw controller that follows it.

Position error -> law -> speed and yaw-rate references -> yaw controller -> steering angle, plus the angle that the law
knows beforehand (`feedforward`).
"""

from collections.abc import Sequence
from math import isfinite, nan, radians
from typing import Any, NamedTuple

from agrobot_mj.control.base import YAW_COLUMNS, GuidanceLaw, Situation, YawCommand, YawController
from agrobot_mj.control.pid import clip
from agrobot_mj.control.speed_network import SpeedNetworkState
from agrobot_mj.core.errors import NotFiniteError
from agrobot_mj.core.signals import Column, Command

SPEED_COLUMNS = (
    Column("speed_tau_c", "m/s", "output of the proportional law on the speed"),
    Column("speed_tau_n", "m/s", "output of the network on the speed; the speed command is raised by tau_c - tau_n"),
)
"""Signals of the second network, where there is one."""


UNDER_WAY = radians(5.0)
"""Lag of the wheels behind their command beyond which integrals are held [rad]. Assumed value."""


class CascadeState(NamedTuple):
    """Memory of a `Cascade`."""

    controller: Any
    yaw_rate_ref: float = nan
    """Last reference [rad/s]."""
    e_yaw_rate: float = nan
    """Last reference less the estimated yaw rate [rad/s]."""
    command: YawCommand = YawCommand(0.0)
    """Last command of the yaw controller."""
    feedforward: float = 0.0
    """Last angle added to it [rad]."""
    speed: SpeedNetworkState = SpeedNetworkState()
    """State of the network on the speed, at rest without one."""


class Cascade(GuidanceLaw):
    """A law and a yaw controller; not a kind of its own."""

    kind: str = "cascade"
    law: Any
    """The outer law, a `kinematic.CascadeLaw`."""
    controller: YawController
    """The yaw controller."""

    def init(self) -> CascadeState:
        """State at rest."""
        return CascadeState(self.controller.init())

    def update(self, state: CascadeState, situation: Situation, dt: float) -> tuple[CascadeState, Command]:
        """Outer law, then yaw controller."""
        speed_ref, yaw_rate_ref = self.law.setpoints(situation)
        if not isfinite(speed_ref + yaw_rate_ref):
            raise NotFiniteError(
                f"speed {speed_ref} m/s and yaw rate {yaw_rate_ref} rad/s, made by the guidance law ({self.law.kind})"
            )
        e_yaw_rate = yaw_rate_ref - situation.estimate.yaw_rate
        limit = situation.steer_limit(self.law.lateral_acceleration_m_s2)
        scaled = self.law.gain_scale(situation) * e_yaw_rate
        controller, command = self.controller.update(state.controller, situation.t, scaled, dt, limit)
        if not isfinite(command.steer + command.tau_c + command.tau_n):
            steer, tau_c, tau_n, _ = command
            maker = f"made by the controller ({self.controller.kind})"
            raise NotFiniteError(f"steer {steer} rad, tau_c {tau_c} rad, tau_n {tau_n} rad, {maker}")
        ahead = self.law.feedforward(situation)
        steer = clip(command.steer + ahead, -limit, limit)
        excess = command.tau_c - command.tau_n + ahead - steer or _behind(steer - situation.steer)
        if excess:
            controller = self.controller.relieve(controller, excess)
        speed, network = state.speed, self.law.speed_network
        if network:
            speed, speed_ref = network.update(speed, speed_ref, situation.estimate.speed, dt)
        return CascadeState(controller, yaw_rate_ref, e_yaw_rate, command, ahead, speed), Command(steer, speed_ref)

    def feedback(self, state: CascadeState, command: Command) -> float:
        """Angle of the yaw controller [rad]."""
        return state.command.steer

    @property
    def follows_path(self) -> bool:
        """Whether the yaw controller closes the loop."""
        return self.controller.closed_loop

    @property
    def columns(self) -> tuple[Column, ...]:
        """The paper's signals, those of the law and those of the controller."""
        speed = SPEED_COLUMNS if self.law.speed_network else ()
        return (*YAW_COLUMNS, *self.law.columns, *self.controller.columns, *speed)

    def report(self, state: CascadeState) -> Sequence[float]:
        """Values of `columns`."""
        c = state.command
        own = (state.yaw_rate_ref, state.e_yaw_rate, c.tau_c, c.tau_n, c.q)
        speed = (state.speed.tau_c, state.speed.tau_n) if self.law.speed_network else ()
        return (*own, *self.law.report(state), *self.controller.report(state.controller), *speed)


def _behind(lag: float) -> float:
    """How far the wheels are behind their command, 0 where it is little [rad]."""
    return lag if abs(lag) > UNDER_WAY else 0.0
