"""PI controller of the yaw rate: delta = k_P e + k_I integral(e dt).

The error e is reference minus measured yaw rate [rad/s]. The integral is stored as an angle. The growth of the integral
is stopped while the total steering command, including feed-forward, exceeds the steering limit, and while the wheels
are still turning to the commanded angle. The integral is frozen at large errors, which occur during an approach to the
path.

With a worn valve (40 % of the flow, dead band wider by 0.8 V) the lag of the valve causes a limit cycle at high k_I;
see docs/reference/guidance_tables.md.
"""

from math import nan
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.control.base import YawCommand, YawController, excess_of
from agrobot_mj.control.pid import clip
from agrobot_mj.core.calls import Linked
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, shared, stage
from agrobot_mj.core.signals import Vector
from agrobot_mj.core.spec import NonNegative

TRANSIENT_RAD_S = 0.3
"""Minimum yaw-rate error that indicates an approach to the path and freezes the integral [rad/s]. Assumed value."""


class PiState(NamedTuple):
    """State of `Pi` between two ticks."""

    integral: float = 0.0  # Integral part of the command [rad]
    before: float = 0.0  # Integral part of the command one tick earlier [rad]


class PiGains(NamedTuple):
    """Gains of `Pi` as numbers for compiled kernels."""

    kp: float
    ki: float


@shared
def pi_step(p: PiGains, s: PiState, e: float, dt: float, limit: float) -> tuple[PiState, YawCommand]:
    """Return the new state and the steering command, limited to `limit` [rad], for the yaw-rate error `e` [rad/s]."""
    step = p.ki * e * dt if abs(e) < TRANSIENT_RAD_S else 0.0
    tau_c, integral = p.kp * e, s.integral + step
    steer = clip(tau_c + integral, -limit, limit)
    return PiState(integral, s.integral), YawCommand(steer, tau_c, -integral, nan)


@shared
def without_windup(s: PiState, excess: float) -> PiState:
    """Return the state without the last integral step, if this step has the same sign as `excess` [rad]."""
    return PiState(s.before, s.before) if excess * (s.integral - s.before) > 0 else s


@stage
def _tick(
    law: Held[PiGains], state: Held[PiState], e: float, ahead: float, steer: float, dt: float, limit: float
) -> tuple[Held[PiState], YawCommand, Vector]:
    """Return the new state, the command, and an empty array of log values; see `base.controller_form`."""
    after, command = pi_step(fetched(law), fetched(state), e, dt, limit)
    excess = excess_of(command, ahead, clip(command.steer + ahead, -limit, limit), steer)
    return held(without_windup(after, excess)), command, np.empty(0)


class Pi(YawController):
    """PI yaw controller with anti-windup."""

    kind: Literal["pi"] = "pi"
    label: ClassVar = "PI"
    kp: NonNegative = 0.7
    """Proportional gain k_P [rad s/rad]. Assumed value from tuning with `kinematic`; above 1.5, limit cycles occur."""
    ki: NonNegative = 0.2
    """Integral gain k_I [rad/rad]. Assumed value from tuning; with k_P = 0.4, a k_I of 0.2 causes limit cycles of worn
    valves."""
    tunable: ClassVar = {"kp": (0.1, 1.5), "ki": (0.0, 1.5)}
    """Search ranges for tuning the gains."""

    def init(self) -> PiState:
        """Return the initial state, with an integral of zero."""
        return PiState()

    def update(
        self, state: PiState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[PiState, YawCommand]:
        """Return the new state and the steering command, limited to `steer_limit` [rad], for a yaw-rate error
        [rad/s]."""
        return pi_step(PiGains(self.kp, self.ki), state, yaw_rate_error, dt, steer_limit)

    def relieve(self, state: PiState, excess: float) -> PiState:
        """Return the state without the last integral step, if this step has the same sign as `excess` [rad]."""
        return without_windup(state, excess)

    def compiled_tick(self, state: PiState) -> Linked:
        """Return the compiled tick function of the controller, its parameters and its state."""
        return Linked(_tick, held(PiGains(self.kp, self.ki)), held(state))
