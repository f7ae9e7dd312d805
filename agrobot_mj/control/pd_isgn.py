"""Baseline for the paper's controller: PD plus the integral of the sign of the PD output.

u = tau_c - tau_n with d tau_n/dt = -alpha sgn(tau_c). This controller equals a network with constant normalised firing
strengths.
"""

from math import nan
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.control.base import YawCommand
from agrobot_mj.control.pd import Conventional, PdGains, conventional
from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.control.t2fnn_laws import sgn
from agrobot_mj.core.calls import Linked
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, shared, stage
from agrobot_mj.core.signals import Vector
from agrobot_mj.core.spec import Positive


class IntegralState(NamedTuple):
    """State of `PdIsgn` between two ticks."""

    slope: FilteredRate = FilteredRate()  # Filtered derivative of the yaw-rate error [rad/s2]
    tau_n: float = 0.0  # Integral of the smoothed sign, subtracted from the PD output [rad]


class IntegralLaw(NamedTuple):
    """Parameters of `PdIsgn` as numbers for compiled kernels."""

    gains: PdGains
    alpha: float
    delta_s: float


@shared
def integral_step(
    p: IntegralLaw, s: IntegralState, e: float, dt: float, limit: float
) -> tuple[IntegralState, YawCommand]:
    """Return the new state and the steering command, limited to `limit` [rad], for the yaw-rate error `e` [rad/s]."""
    slope, tau_c = conventional(p.gains, s.slope, e, dt)
    tau_n = s.tau_n
    command = YawCommand(clip(tau_c - tau_n, -limit, limit), tau_c, tau_n, nan)
    return IntegralState(slope, tau_n - p.alpha * sgn(tau_c, p.delta_s) * dt), command


@stage
def _tick(
    law: Held[IntegralLaw], state: Held[IntegralState], e: float, ahead: float, steer: float, dt: float, limit: float
) -> tuple[Held[IntegralState], YawCommand, Vector]:
    """Return the new state, the command, and an empty array of log values; see `base.controller_form`."""
    after, command = integral_step(fetched(law), fetched(state), e, dt, limit)
    return held(after), command, np.empty(0)


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
        """Return the new state and the steering command, limited to `steer_limit` [rad], for a yaw-rate error
        [rad/s]."""
        return integral_step(self._law, state, yaw_rate_error, dt, steer_limit)

    @property
    def _law(self) -> IntegralLaw:
        return IntegralLaw(self.gains, self.alpha, self.delta_s)

    def compiled_tick(self, state: IntegralState) -> Linked:
        """Return the compiled tick function of the controller, its parameters and its state."""
        return Linked(_tick, held(self._law), held(state))
