"""Stanley law: the front wheels are aligned with the path and, if the front axle is offset, turned towards it.

Forward:  delta = delta_ff - (psi - psi_ref) - atan(k e_f / (u_0 + u)) - k_d (r - r_ref),  with the heading psi, speed u
and yaw rate r. e_f is the lateral offset of the front axle from its position if the tractor followed the path exactly.
The feed-forward angle delta_ff = atan(L kappa_R) uses the curvature kappa_R of the rear axle, previewed by the steering
lag. On an arc the CG (not the front axle) is on the path without steady-state error. The yaw-rate damping compensates
the lag T of the steering: with k_d = T the course theta of the front axle satisfies T theta' = -theta - k e_f / u on a
machine of any length. Without damping, large errors cause sustained oscillation if the valve is at its rate limit.
Source: [Hoffmann2007].

In reverse the front axle trails and this feedback is unstable. The law then uses the rear axle:  delta = delta_ff + h
(psi - psi_ref) - atan(k e_r / (u_0 + |u|)).  This law is stable for h > 0, k > 0: with l = L / h the error satisfies
e'' + e' / l + k e / (L |u|) = 0 with respect to distance.

Side slopes, steering errors and valve dead bands would cause an offset of u / k per radian of angle error. In forward
travel the integral v removes the offset:  v = -k_i integral of (e_f' + u sin(atan(k e_f / (u_0 + u)))) dt,  the
measured minus the expected motion of the front axle. v is frozen during an approach at a large angle, while the wheels
lag the command, while the command is at its limit, and until the heading is known (until then the supervisor steers).
"""

from math import atan, isnan, nan, radians, sin, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import (
    MAX_STEER_BIAS,
    STEEP,
    CommandLimits,
    Followed,
    PathDeviation,
    Situated,
    deviated_on,
    integral_columns,
    limited_commands,
    offset_of,
)
from agrobot_mj.control.following import Integrating
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.signals import Matrix, Reference, Vector
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters

WHEEL_LAG = radians(3.0)
"""Difference between commanded and measured steering angle above which the integral is frozen [rad]. Assumed value."""


class StanleyState(NamedTuple):
    """State of `Stanley` between two ticks."""

    integral: float = 0.0  # Steering angle v of the integral term [rad]
    offset: float = nan
    """Offset e_f of the front axle at the last tick [m]. NaN if that tick was in reverse or the heading was unknown."""


class Gains(NamedTuple):
    """Gains of the Stanley law and dimensions of the tractor, as numbers for compiled kernels."""

    k: float  # Approach speed per offset of the front axle [1/s]
    softening: float  # Softening speed [m/s], which reduces the gain at low speed
    damping: float  # Steering angle per yaw-rate error in forward travel [s]
    reverse: float  # Steering angle per heading error in reverse [-]
    integral: float  # Steering angle per unexpected motion of the front axle [rad/m]
    front: float  # Distance from the CG to the front axle [m]
    rear: float  # Distance from the CG to the rear axle [m]
    wheelbase: float  # Wheelbase of the tractor [m]


class StanleyLaw(NamedTuple):
    """Parameters of `Stanley` as numbers for compiled kernels."""

    limits: CommandLimits
    gains: Gains


@jit
def steering(
    gains: Gains, memory: StanleyState, deviation: PathDeviation, pose: tuple[float, float, float], speed: float,
    yaw_rate: float, aligned: bool, steer: float, dt: float,
) -> tuple[StanleyState, float]:  # fmt: skip
    """Return the new state and the steering angle [rad]; `pose` contains x, y [m] and yaw [rad] of the CG."""
    pace, ahead = gains.softening + abs(deviation.speed), deviation.steer_ahead
    if deviation.direction < 0:
        e_r = offset_of(deviation, -gains.rear, deviation.yaw, pose)
        wanted = ahead + gains.reverse * deviation.heading - atan(gains.k * e_r / pace)
        return StanleyState(memory.integral, nan), wanted
    e_f = offset_of(deviation, gains.front, deviation.yaw + deviation.steer_here, pose)
    towards = atan(gains.k * e_f / pace)
    turning = yaw_rate - deviation.speed * tan(deviation.steer_here) / gains.wheelbase
    wanted = ahead - deviation.heading - towards - gains.damping * turning + memory.integral
    if not aligned:
        return StanleyState(memory.integral, nan), wanted
    steered = min(max(wanted + deviation.bias, -deviation.limit), deviation.limit)
    follows = steered == wanted + deviation.bias and abs(steered - steer) < WHEEL_LAG
    unexplained = 0.0
    if follows and not isnan(memory.offset) and abs(deviation.heading) < STEEP:
        unexplained = e_f - memory.offset + speed * sin(towards) * dt
    integral = memory.integral - gains.integral * unexplained
    return StanleyState(min(max(integral, -MAX_STEER_BIAS), MAX_STEER_BIAS), e_f), wanted


@stage
def _tick(
    p: Held[StanleyLaw], memory: Held[StanleyState], last: tuple[float, float], samples: Matrix, seen: Situated,
    r: Reference, dt: float,
) -> tuple[Held[StanleyState], Followed, float, Vector]:  # fmt: skip
    """Return the new state, the command, the arc length [m] up to which the path must be sampled, and log values.
    `last` contains the last direction of travel and the last speed command [m/s]."""
    p, e = fetched(p), fetched(seen.estimate)
    deviation, most = deviated_on(p.limits, last[0], samples, seen, r, (p.gains.rear, p.gains.wheelbase))
    pose = e.x, e.y, e.yaw
    rest = deviation, pose, e.speed, e.yaw_rate, e.aligned, seen.steer, dt
    after, wanted = steering(p.gains, fetched(memory), *rest)
    found = limited_commands(p.limits, deviation, r, seen, wanted, last[1], dt)
    return held(after), found, most, integral_columns(found, after.integral)


_steering = stage(steering)


class Stanley(Integrating):
    """Stanley law, which steers by the offset of the front axle or, in reverse, of the rear axle."""

    sized: ClassVar = {"reverse_heading_gain": {"length": 0.5}}

    kind: Literal["stanley"] = "stanley"
    label: ClassVar = "Stanley"
    compiled = staticmethod(_tick)
    gain_per_s: Positive = 0.91
    """Gain k: lateral approach speed divided by the lateral offset of the axle [1/s]. Assumed value (range 0.3-1),
    below 1 / (4 T) for a steering lag T."""
    softening_m_s: NonNegative = 0.99
    """Softening speed u_0 [m/s], which reduces the gain at low speed. Assumed value (range 0-1)."""
    yaw_damping_s: NonNegative = 0.54
    """Damping k_d: steering angle divided by the yaw-rate error in forward travel [s]. Assumed value (range 0.2-0.8),
    equal to the steering lag."""
    reverse_heading_gain: Positive = 1.5
    """Gain h: steering angle per heading error in reverse [-]. Assumed value (range 1-2): critical damping at 1 m/s."""
    integral_per_m: Annotated[float, Field(ge=0, le=1)] = 0.083
    """Integral gain k_i [rad/m]: steering angle per metre of measured minus expected lateral motion of the front axle.
    Used in forward travel. Assumed value (range 0-0.3)."""
    tunable: ClassVar = {
        "gain_per_s": (0.1, 2.0),
        "softening_m_s": (0.0, 1.0),
        "yaw_damping_s": (0.0, 1.5),
        "integral_per_m": (0.02, 0.5),
    }
    """Search ranges for tuning the gains."""

    def memory(self) -> StanleyState:
        """Return the initial state, with an integral of zero."""
        return StanleyState()

    def steering(
        self, memory: StanleyState, deviation: PathDeviation, situation: Situation, dt: float
    ) -> tuple[StanleyState, float]:
        """Return the new state and the steering angle [rad], to which the steering limit is not yet applied."""
        e = situation.estimate
        pose, gains = (e.x, e.y, e.yaw), self.gains(situation.machine)
        return _steering(gains, memory, deviation, pose, e.speed, e.yaw_rate, e.aligned, situation.steer, dt)

    def gains(self, m: TractorParameters) -> Gains:
        """Return the gains of the law and the dimensions of the tractor as numbers for compiled kernels."""
        gains = self.gain_per_s, self.softening_m_s, self.yaw_damping_s, self.reverse_heading_gain, self.integral_per_m
        return Gains(*gains, m.cg_to_front_axle, m.cg_to_rear_axle, m.wheelbase_m)

    def parameters(self, limits: CommandLimits, machine: TractorParameters) -> StanleyLaw:
        """Return the parameters of the compiled tick function for the given command limits and tractor."""
        return StanleyLaw(limits, self.gains(machine))
