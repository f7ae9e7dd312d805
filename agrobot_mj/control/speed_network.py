"""Network for speed control, as suggested in section III-B of [Kayacan2015].

The network is in parallel with a proportional controller:  u_command = u_ref + tau_c - tau_n,  tau_c = k_P (u_ref - u).
The inputs of the network are u_ref - u [m/s] and the filtered derivative of this error [m/s2]; the network is trained
on tau_c [m/s]. Because the speed loop already has an integral, the network has little to learn.
"""

from typing import NamedTuple

from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.control.t2fnn import T2Fnn, T2FnnState
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class SpeedNetworkState(NamedTuple):
    """State of `SpeedNetwork` between two ticks."""

    slope: FilteredRate = FilteredRate()  # Filtered derivative of the speed error [m/s2]
    network: T2FnnState | None = None
    """State of the network, or None before the first speed error."""
    tau_c: float = 0.0  # Last output of the proportional controller [m/s]
    tau_n: float = 0.0  # Last output of the network [m/s]


class SpeedNetwork(Spec):
    """Proportional speed controller in parallel with the paper's fuzzy neural network."""

    kp: NonNegative = 0.2
    """Proportional gain k_P [-]. Assumed value (range 0.05-0.5); a value of 1 would double the gain of the speed
    loop."""
    derivative_filter_s: NonNegative = 0.2
    """Time constant of the low-pass filter of the error derivative [s]. Assumed value, equal to the default of the yaw
    controller."""
    bound_m_s: Positive = 0.3
    """Maximum correction of the speed command [m/s]. Assumed value (range 0.1-0.6): half of
    `CascadeLaw.saturation_m_s`."""
    network: T2Fnn = T2Fnn(alpha=0.01)
    """Fuzzy neural network and its learning laws; the learning rate alpha has the unit [m/s2] here."""

    def update(
        self, state: SpeedNetworkState, wanted: float, speed: float, dt: float
    ) -> tuple[SpeedNetworkState, float]:
        """Return the new state and the corrected speed command [m/s]. The network learns while the last correction was
        within its limit."""
        e = wanted - speed
        slope, tau_c = state.slope.after(e, dt, self.derivative_filter_s), self.kp * e
        network = state.network or self.network.init(e, slope.rate)
        free = abs(state.tau_c - state.tau_n) < self.bound_m_s
        network, tau_n = self.network.update(network, e, slope.rate, tau_c, dt, free)
        correction = clip(tau_c - tau_n, -self.bound_m_s, self.bound_m_s)
        return SpeedNetworkState(slope, network, tau_c, tau_n), wanted + correction
