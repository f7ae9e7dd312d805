"""The paper's network a second time, on the speed: section III-B says that it could be there.

In parallel with a proportional law, as on the yaw rate:  u_command = u_ref + tau_c - tau_n,  tau_c = k_P (u_ref - u),
where the network has the inputs u_ref - u [m/s] and its filtered derivative [m/s2] and learns from tau_c [m/s]. The
speed loop behind it has an integral of its own, so that little is left to learn.
"""

from typing import NamedTuple

from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.control.t2fnn import T2Fnn, T2FnnState
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class SpeedNetworkState(NamedTuple):
    """Memory of `SpeedNetwork`."""

    slope: FilteredRate = FilteredRate()
    """Filtered derivative of the speed error [m/s]."""
    network: T2FnnState | None = None
    """State of the network; None before the first error, around which its sets are placed."""
    tau_c: float = 0.0
    """Last output of the proportional law [m/s]."""
    tau_n: float = 0.0
    """Last output of the network [m/s]."""


class SpeedNetwork(Spec):
    """A proportional law on the speed and the paper's network beside it."""

    kp: NonNegative = 0.2
    """k_P [-]. Assumed value (0.05-0.5): above, it doubles the gain of the speed loop."""
    derivative_filter_s: NonNegative = 0.2
    """Time constant of the filter of the error's derivative [s]. Assumed value: as the yaw controller's."""
    bound_m_s: Positive = 0.3
    """Largest correction of the speed [m/s]. Assumed value (0.1-0.6): half the kinematic law's saturation."""
    network: T2Fnn = T2Fnn(alpha=0.01)
    """The network and its learning laws; alpha is a rate of speed [m/s2]."""

    def update(
        self, state: SpeedNetworkState, wanted: float, speed: float, dt: float
    ) -> tuple[SpeedNetworkState, float]:
        """Speed command [m/s] from the wanted and the estimated speed [m/s]; it learns while the bound leaves room."""
        e = wanted - speed
        slope, tau_c = state.slope.after(e, dt, self.derivative_filter_s), self.kp * e
        network = state.network or self.network.init(e, slope.rate)
        free = abs(state.tau_c - state.tau_n) < self.bound_m_s
        network, tau_n = self.network.update(network, e, slope.rate, tau_c, dt, free)
        correction = clip(tau_c - tau_n, -self.bound_m_s, self.bound_m_s)
        return SpeedNetworkState(slope, network, tau_c, tau_n), wanted + correction
