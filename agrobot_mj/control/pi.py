"""PI on the yaw rate: delta = k_P e + k_I integral(e dt).

Error e = reference less measured yaw rate [rad/s]. The integral is kept as an angle. It takes no step further while
the whole steering command, with the feed-forward of the guidance law, is beyond the steering's limit or the wheels are
still on their way to it, and rests while e is that of a way onto a path rather than of a disturbance.

On a worn valve (40 % of the flow, 0.8 V more dead band) a fast integral winds the valve's lag into a limit cycle; see
docs/reference/guidance_tables.md.
"""

from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.control.base import YawCommand, YawController
from agrobot_mj.control.pid import clip
from agrobot_mj.core.spec import NonNegative

TRANSIENT_RAD_S = 0.3
"""Yaw-rate error that is the way onto a path rather than a disturbance: the integral rests [rad/s]. Assumed value."""


class PiState(NamedTuple):
    """Memory of `Pi`."""

    integral: float = 0.0
    """Share of the integral in the command [rad]."""
    before: float = 0.0
    """Share of the integral one tick earlier [rad]."""


class Pi(YawController):
    """PI with anti-windup."""

    kind: Literal["pi"] = "pi"
    label: ClassVar = "PI"
    kp: NonNegative = 0.7
    """k_P [rad s/rad]. Assumed value: searched, with `kinematic`; limit cycles begin at about 1.5."""
    ki: NonNegative = 0.2
    """k_I [rad/rad]. Assumed value: searched; 0.2 at k_P 0.4 limit-cycles on a worn valve."""
    tunable: ClassVar = {"kp": (0.1, 1.5), "ki": (0.0, 1.5)}
    """Ranges in which the gains are sought."""

    def init(self) -> PiState:
        """At rest."""
        return PiState()

    def update(
        self, state: PiState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[PiState, YawCommand]:
        """Command from the error [rad/s] after `dt` [s]; `steer_limit` [rad]."""
        step = self.ki * yaw_rate_error * dt if abs(yaw_rate_error) < TRANSIENT_RAD_S else 0.0
        tau_c, integral = self.kp * yaw_rate_error, state.integral + step
        steer = clip(tau_c + integral, -steer_limit, steer_limit)
        return PiState(integral, state.integral), YawCommand(steer, tau_c, -integral)

    def relieve(self, state: PiState, excess: float) -> PiState:
        """The integral of the tick before, if the last step pushed further in the direction of the excess."""
        winding = excess * (state.integral - state.before) > 0
        return state._replace(integral=state.before) if winding else state
