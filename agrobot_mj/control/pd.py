"""Conventional yaw controller: tau_c = k_P e + k_D de/dt.

The error e is reference minus measured yaw rate [rad/s]. The output tau_c [rad], positive to the left, is limited to
the maximum steering angle. Source: the paper, section III-B. The default k_D = 0 gives a P controller. The paper's
Theorem 2 divides by k_D and therefore does not apply to the P controller.
"""

from math import nan
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.control.base import YawCommand, YawController
from agrobot_mj.control.pid import FilteredRate, clip, slope_after
from agrobot_mj.core.calls import Linked
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, shared, stage
from agrobot_mj.core.signals import Vector
from agrobot_mj.core.spec import NonNegative


class PdGains(NamedTuple):
    """Gains of a `Conventional` controller, as numbers for compiled kernels."""

    kp: float
    kd: float
    filter_s: float  # Time constant of the derivative filter [s]


@shared
def conventional(p: PdGains, slope: FilteredRate, e: float, dt: float) -> tuple[FilteredRate, float]:
    """Return the filtered derivative of the yaw-rate error `e` [rad/s], and the controller output tau_c [rad]."""
    slope = slope_after(slope, e, dt, p.filter_s)
    return slope, p.kp * e + p.kd * slope.rate


@stage
def _tick(
    law: Held[PdGains], state: Held[FilteredRate], e: float, ahead: float, steer: float, dt: float, limit: float
) -> tuple[Held[FilteredRate], YawCommand, Vector]:
    """Return the new state, the command, and an empty array of log values; see `base.controller_form`."""
    slope, tau_c = conventional(fetched(law), fetched(state), e, dt)
    return held(slope), YawCommand(clip(tau_c, -limit, limit), tau_c, 0.0, nan), np.empty(0)


class Conventional(YawController):
    """Base class of the closed-loop yaw controllers with proportional and derivative terms."""

    kp: float = 0.4
    """Proportional gain k_P [rad s/rad]. Assumed value from tuning with `kinematic`; 0.4 with `gains = "paper"`."""
    kd: float = 0.0
    """Derivative gain k_D [rad s2/rad]. Assumed value from tuning; 0 with `gains = "paper"`."""
    derivative_filter_s: NonNegative = 0.2
    """Time constant of the low-pass filter of the error derivative [s]. Assumed value (range 0.1-0.5)."""
    tunable: ClassVar = {"kp": (0.1, 1.5), "kd": (0.0, 0.3)}
    """Search ranges for tuning the gains."""

    def conventional(self, slope: FilteredRate, e: float, dt: float) -> tuple[FilteredRate, float]:
        """Return the filtered derivative of the yaw-rate error `e` [rad/s], and the controller output tau_c [rad]."""
        return conventional(self.gains, slope, e, dt)

    @property
    def gains(self) -> PdGains:
        """Gains as numbers for compiled kernels."""
        return PdGains(self.kp, self.kd, self.derivative_filter_s)


class Pd(Conventional):
    """Conventional PD controller without a network."""

    kind: Literal["pd"] = "pd"
    label: ClassVar = "PD"

    def init(self) -> FilteredRate:
        """Return the initial state of the filtered derivative."""
        return FilteredRate()

    def update(
        self, state: FilteredRate, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[FilteredRate, YawCommand]:
        """Return the new state and the steering command, limited to `steer_limit` [rad], for a yaw-rate error
        [rad/s]."""
        slope, tau_c = self.conventional(state, yaw_rate_error, dt)
        return slope, YawCommand(clip(tau_c, -steer_limit, steer_limit), tau_c)

    def compiled_tick(self, state: FilteredRate) -> Linked:
        """Return the compiled tick function of the controller, its parameters and its state."""
        return Linked(_tick, held(self.gains), held(state))
