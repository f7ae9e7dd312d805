"""PI controller of the yaw rate: delta = k_P e + k_I integral(e dt).

The error e is reference minus measured yaw rate [rad/s]. The integral is stored as an angle. The growth of the integral
is stopped while the total steering command, including feed-forward, exceeds the steering limit, and while the wheels
are still turning to the commanded angle. The integral is frozen at large errors, which occur during an approach to the
path.

With a worn valve (40 % of the flow, dead band wider by 0.8 V) the lag of the valve causes a limit cycle at high k_I;
see docs/reference/guidance_tables.md.
"""

from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.control.base import YawCommand, YawController
from agrobot_mj.control.pid import clip
from agrobot_mj.core.spec import NonNegative

TRANSIENT_RAD_S = 0.3
"""Minimum yaw-rate error that indicates an approach to the path and freezes the integral [rad/s]. Assumed value."""


class PiState(NamedTuple):
    """State of `Pi` between two ticks."""

    integral: float = 0.0  # Integral part of the command [rad]
    before: float = 0.0  # Integral part of the command one tick earlier [rad]


class Pi(YawController):
    """PI yaw controller with anti-windup."""

    kind: Literal["pi"] = "pi"
    label: ClassVar = "PI"
    kp: NonNegative = 0.7
    """Proportional gain k_P [rad s/rad]. Assumed value from tuning with `kinematic`; above 1.5, limit cycles occur."""
    ki: NonNegative = 0.2
    """Integral gain k_I [rad/rad]. Assumed value from tuning; 0.2 causes limit cycles of worn valves at k_P 0.4."""
    tunable: ClassVar = {"kp": (0.1, 1.5), "ki": (0.0, 1.5)}
    """Search ranges for tuning the gains."""

    def init(self) -> PiState:
        """Return the initial state, with an integral of zero."""
        return PiState()

    def update(
        self, state: PiState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[PiState, YawCommand]:
        """Return the new state and the steering command for a yaw-rate error [rad/s], at most `steer_limit` [rad]."""
        step = self.ki * yaw_rate_error * dt if abs(yaw_rate_error) < TRANSIENT_RAD_S else 0.0
        tau_c, integral = self.kp * yaw_rate_error, state.integral + step
        steer = clip(tau_c + integral, -steer_limit, steer_limit)
        return PiState(integral, state.integral), YawCommand(steer, tau_c, -integral)

    def relieve(self, state: PiState, excess: float) -> PiState:
        """Return the state without the last integral step, if this step has the same sign as `excess` [rad]."""
        winding = excess * (state.integral - state.before) > 0
        return state._replace(integral=state.before) if winding else state
