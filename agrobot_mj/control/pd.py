"""The conventional yaw controller: tau_c = k_P e + k_D de/dt.

Error e = reference less measured yaw rate [rad/s], output tau_c [rad], left positive, clipped at the steering's
limit. Source: the paper, section III-B. With k_D = 0, the default, it is a P controller, and the paper's Theorem 2,
which divides by k_D, says nothing.
"""

from typing import ClassVar, Literal

from agrobot_mj.control.base import YawCommand, YawController
from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.core.spec import NonNegative


class Conventional(YawController):
    """Gains that all closed-loop yaw controllers share."""

    kp: float = 0.4
    """Proportional gain k_P [rad s/rad]. Assumed value: searched, with `kinematic`; 0.4 with `gains = "paper"`."""
    kd: float = 0.0
    """Derivative gain k_D [rad s2/rad]. Assumed value: searched; 0 with `gains = "paper"`."""
    derivative_filter_s: NonNegative = 0.2
    """Time constant of the filter of the derivative of the error [s]. Assumed value (0.1-0.5)."""
    tunable: ClassVar = {"kp": (0.1, 1.5), "kd": (0.0, 0.3)}
    """Ranges in which the gains are sought."""

    def conventional(self, slope: FilteredRate, e: float, dt: float) -> tuple[FilteredRate, float]:
        """The filtered derivative of the error and tau_c [rad]."""
        slope = slope.after(e, dt, self.derivative_filter_s)
        return slope, self.kp * e + self.kd * slope.rate


class Pd(Conventional):
    """The conventional controller alone."""

    kind: Literal["pd"] = "pd"
    label: ClassVar = "PD"

    def init(self) -> FilteredRate:
        """At rest: no error so far."""
        return FilteredRate()

    def update(
        self, state: FilteredRate, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[FilteredRate, YawCommand]:
        """Command from the error [rad/s] after dt [s]; `steer_limit` [rad]."""
        slope, tau_c = self.conventional(state, yaw_rate_error, dt)
        return slope, YawCommand(clip(tau_c, -steer_limit, steer_limit), tau_c)
