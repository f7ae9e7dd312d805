"""Stanley's law: the front wheels point along the path, and towards it by the offset of the front axle.

Forward, with the offset e_f of the front axle from where it would be without errors, across the direction in which it
would move there:  delta = delta_ff - (psi - psi_ref) - atan(k e_f / (u_0 + u)) - k_d (r - r_ref),  delta_ff =
atan(L kappa_R) ahead by the steering's lag, r the yaw rate. On an arc the CG, not the front axle, is on the path, and
no error rests. The damping of the yaw rate makes up for the lag T of the steering: with k_d = T the angle of the front
axle's way obeys T theta' = -theta - k e_f / u on a machine of any length. Without it a valve at its rate limit turns a
large error into a weave that lasts. Source: [Hoffmann2007].

In reverse the front axle trails and this feedback is unstable: there the rear axle leads, with delta = delta_ff + h
(psi - psi_ref) - atan(k e_r / (u_0 + |u|)),  stable for h > 0, k > 0: with l = L / h the error obeys e'' + e' / l + k
e / (L |u|) = 0 over the distance.

Without more a side slope, a steering error or a valve's dead band leaves an offset of about (angle) u / k. The angle v
takes it away:  v = -k_i integral of (e_f' + u sin(atan(k e_f / (u_0 + u)))) dt,  what the front axle does beside what
the offset is to make it do. It rests on the way onto a line: at a steep angle, while the wheels are behind the command
or the command at a limit, and until the heading is known, when others steer. It is not used in reverse.
"""

from math import atan, radians, sin, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.following import LARGEST_BIAS, STEEP, Beside, Integrating
from agrobot_mj.control.pid import clip
from agrobot_mj.core.spec import NonNegative, Positive

BEHIND = radians(3.0)
"""Angle by which the wheels are behind the command above which the integral rests [rad]. Assumed value."""


class StanleyState(NamedTuple):
    """Memory of `Stanley`."""

    integral: float = 0.0
    """v [rad]."""
    offset: float | None = None
    """e_f of the last tick [m]; None before the first one forward."""


class Stanley(Integrating):
    """Stanley's law at the front axle; in reverse at the rear axle."""

    sized: ClassVar = {"reverse_heading_gain": {"length": 0.5}}

    kind: Literal["stanley"] = "stanley"
    label: ClassVar = "Stanley"
    gain_per_s: Positive = 0.91
    """k, speed towards the path per offset [1/s]. Assumed value (0.3-1): below 1 / (4 lags) of the steering."""
    softening_m_s: NonNegative = 0.99
    """u_0, keeps the law calm at low speed [m/s]. Assumed value (0-1)."""
    yaw_damping_s: NonNegative = 0.54
    """k_d, steering angle per yaw rate beside the path's, forward [s]. Assumed value (0.2-0.8): lag of the steering."""
    reverse_heading_gain: Positive = 1.5
    """h, steering angle per heading error in reverse [-]. Assumed value (1-2): damping 1 at 1 m/s."""
    integral_per_m: Annotated[float, Field(ge=0, le=1)] = 0.083
    """k_i, angle per way of the front axle that it cannot explain, forward [rad/m]; 0: none. Assumed value (0-0.3)."""
    tunable: ClassVar = {
        "gain_per_s": (0.1, 2.0),
        "softening_m_s": (0.0, 1.0),
        "yaw_damping_s": (0.0, 1.5),
        "integral_per_m": (0.02, 0.5),
    }
    """Ranges in which the gains are sought."""

    def memory(self) -> StanleyState:
        """No offset known."""
        return StanleyState()

    def steering(
        self, memory: StanleyState, beside: Beside, situation: Situation, dt: float
    ) -> tuple[StanleyState, float]:
        """Feed-forward, heading error, offset of the leading axle."""
        machine, k, pace = situation.machine, self.gain_per_s, self.softening_m_s + abs(beside.speed)
        if beside.direction < 0:
            e_r = beside.offset_of(-machine.cg_to_rear_axle, beside.yaw, situation)
            wanted = beside.steer_ahead + self.reverse_heading_gain * beside.heading - atan(k * e_r / pace)
            return StanleyState(memory.integral), wanted
        e_f = beside.offset_of(machine.cg_to_front_axle, beside.yaw + beside.steer_here, situation)
        towards = atan(k * e_f / pace)
        turning = situation.estimate.yaw_rate - beside.speed * tan(beside.steer_here) / machine.wheelbase_m
        wanted = beside.steer_ahead - beside.heading - towards - self.yaw_damping_s * turning + memory.integral
        if not situation.estimate.aligned:
            return StanleyState(memory.integral), wanted
        steered = clip(wanted + beside.bias, -beside.limit, beside.limit)
        follows = steered == wanted + beside.bias and abs(steered - situation.steer) < BEHIND
        unexplained = 0.0
        if follows and memory.offset is not None and abs(beside.heading) < STEEP:
            unexplained = e_f - memory.offset + situation.estimate.speed * sin(towards) * dt
        integral = clip(memory.integral - self.integral_per_m * unexplained, -LARGEST_BIAS, LARGEST_BIAS)
        return StanleyState(integral, e_f), wanted
