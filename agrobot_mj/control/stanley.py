"""Stanley's law: the front wheels point along the path, and towards it by the offset of the front axle.

Forward, with the offset e_f of the front axle from where it would be without errors, across the direction in which it
would move there:  delta = delta_ff - (psi - psi_ref) - atan(k e_f / (u_0 + u)) - k_d (r - r_ref),  delta_ff =
atan(L kappa_R) ahead by the steering's lag, r the yaw rate. On an arc the CG, not the front axle, is on the path, and
no error rests. The damping of the yaw rate makes up for the lag of the steering: without it a valve at its rate limit
turns a large error into a weave that lasts. Source: [Hoffmann2007].

In reverse the front axle trails and this feedback is unstable: there the rear axle leads, with delta = delta_ff + h
(psi - psi_ref) - atan(k e_r / (u_0 + |u|)),  stable for h > 0, k > 0: with l = L / h the error obeys e'' + e' / l + k
e / (L |u|) = 0 over the distance.

No integral: a side slope or a steering error leaves an offset of about (angle) u / k unless the estimator knows the
bias.
"""

from math import atan, tan
from typing import ClassVar, Literal

from agrobot_mj.control.base import Situation
from agrobot_mj.control.following import Beside, Following
from agrobot_mj.core.spec import NonNegative, Positive


class Stanley(Following):
    """Stanley's law at the front axle; in reverse at the rear axle."""

    sized: ClassVar = {"yaw_damping_s": {"length": 1}, "reverse_heading_gain": {"length": 0.5}}

    kind: Literal["stanley"] = "stanley"
    gain_per_s: Positive = 0.66
    """k, speed towards the path per offset [1/s]. Estimate (0.3-1): below 1 / (4 lags) of the steering."""
    softening_m_s: NonNegative = 0.89
    """u_0, keeps the law calm at low speed [m/s]. Estimate (0-1)."""
    yaw_damping_s: NonNegative = 0.51
    """k_d, steering angle per yaw rate beside the path's, forward [s]. Estimate (0.2-0.8): lag of the steering."""
    reverse_heading_gain: Positive = 1.5
    """h, steering angle per heading error in reverse [-]. Estimate (1-2): damping 1 at 1 m/s."""
    tunable: ClassVar = {"gain_per_s": (0.1, 2.0), "softening_m_s": (0.0, 1.0), "yaw_damping_s": (0.0, 1.5)}
    """Ranges in which the gains are sought."""

    def steering(self, memory: None, beside: Beside, situation: Situation, dt: float) -> tuple[None, float]:
        """Feed-forward, heading error, offset of the leading axle."""
        machine, k, pace = situation.machine, self.gain_per_s, self.softening_m_s + abs(beside.speed)
        if beside.direction > 0:
            e_f = beside.offset_of(machine.cg_to_front_axle, beside.yaw + beside.steer_here, situation)
            turning = situation.estimate.yaw_rate - beside.speed * tan(beside.steer_here) / machine.wheelbase_m
            return None, beside.steer_ahead - beside.heading - atan(k * e_f / pace) - self.yaw_damping_s * turning
        e_r = beside.offset_of(-machine.cg_to_rear_axle, beside.yaw, situation)
        return None, beside.steer_ahead + self.reverse_heading_gain * beside.heading - atan(k * e_r / pace)
