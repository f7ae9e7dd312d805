"""Baseline for the paper's controller: PD plus the integral of the sign of the PD output.

u = tau_c - tau_n with d tau_n/dt = -alpha sgn(tau_c). This controller equals a network with constant normalised firing
strengths.
"""

from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.control.base import YawCommand
from agrobot_mj.control.pd import Conventional
from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.control.t2fnn_laws import sgn
from agrobot_mj.core.spec import Positive


class IntegralState(NamedTuple):
    """State of `PdIsgn` between two ticks."""

    slope: FilteredRate = FilteredRate()  # Filtered derivative of the yaw-rate error [rad/s2]
    tau_n: float = 0.0  # Integral of the smoothed sign, subtracted from the PD output [rad]


class PdIsgn(Conventional):
    """PD controller plus the integral of the sign of its output, a baseline for the fuzzy neural networks."""

    kind: Literal["pd_isgn"] = "pd_isgn"
    label: ClassVar = "PD + integral of sgn"
    alpha: Positive = 0.02
    """Rate of the integral [rad/s]. Assumed value from tuning; 0.02 with `gains = "paper"`, as in `T2Fnn`."""
    delta_s: Positive = 0.05
    """Smoothing width of the sign function [rad]. Paper."""
    tunable: ClassVar = {**Conventional.tunable, "alpha": (0.005, 0.5)}
    """Search ranges for tuning the gains."""

    def init(self) -> IntegralState:
        """Return the initial state, with an integral of zero."""
        return IntegralState()

    def update(
        self, state: IntegralState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[IntegralState, YawCommand]:
        """Return the new state and the steering command for a yaw-rate error [rad/s], at most `steer_limit` [rad]."""
        slope, tau_c = self.conventional(state.slope, yaw_rate_error, dt)
        tau_n = state.tau_n
        command = YawCommand(clip(tau_c - tau_n, -steer_limit, steer_limit), tau_c, tau_n)
        return IntegralState(slope, tau_n - self.alpha * sgn(tau_c, self.delta_s) * dt), command
