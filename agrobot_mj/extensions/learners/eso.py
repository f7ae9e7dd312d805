"""Extended-state observer for Stanley's law or LQR, which estimates and compensates disturbances of the path errors.

The model states are cross-track error e_y and heading error e of the CG, crab angle b and disturbance curvature d. Both
b and d vary slowly. The input is the steering angle delta relative to its feedforward value. The inner law gives the
slip length a and the effective wheelbase L; u is the speed, w the yaw rate relative to the path.

    e_y' = u (e + b) + a w,   e' = w,   w = u (delta / L + d)

An observer with two poles at -omega estimates each disturbance from the difference of a measured error y and its
observed value z: z' = ... + 2 omega (y - z), and the derivative of the disturbance is omega^2 (y - z) / u. The inner
law acts on the course error e + b instead of the heading error e, so that a crab angle causes no offset. -L d is added
to the command. The structure follows [Han2009].
"""

from collections.abc import Sequence
from math import atan, radians, tan
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import STEEP, PathDeviation
from agrobot_mj.control.following import DISTURBANCE_COLUMNS, Following, FollowingState
from agrobot_mj.control.lqr import Lqr
from agrobot_mj.control.pid import clip
from agrobot_mj.control.stanley import Stanley
from agrobot_mj.core.signals import Column

LARGEST_CRAB, LARGEST_CURVATURE = radians(15.0), 0.1
"""Maximum estimated crab angle [rad] and disturbance curvature [1/m]. Assumed values: the crab angle on a side slope of
20 deg, and half of the curvature at full lock."""
MOVING_M_S = 0.3  # Speed below which the observer is not updated [m/s]


class EsoState(NamedTuple):
    """State of the guidance law `Eso` between two ticks."""

    inner: Any
    seen: tuple[float, float] | None = None
    """Cross-track error [m] and heading error [rad] estimated by the observer, or None before the first tick."""
    crab: float = 0.0  # Estimated crab angle b [rad]
    curvature: float = 0.0  # Estimated disturbance curvature d [1/m]


class Eso(Following):
    """Stanley's law or LQR with an observer that compensates crab angle and disturbance curvature."""

    kind: Literal["eso"] = "eso"
    label: ClassVar = "observer (ESO)"
    inner: Annotated[Stanley | Lqr, Field(discriminator="kind")] = Stanley(integral_per_m=0.0)
    """Inner law, selected by its own `kind`. Keys that both laws have must be set in `eso`."""
    bandwidth_per_s: Annotated[float, Field(gt=0, le=5)] = 0.5
    """Bandwidth omega of the observer [1/s]. Assumed value (range 0.2-1): a quarter of the bandwidth of the path loop.
    At higher values, the observer reacts to the lag of the steering."""
    tunable: ClassVar = {"bandwidth_per_s": (0.1, 2.0)}
    """Search range of `bandwidth_per_s` for tuning [1/s]."""

    def memory(self) -> EsoState:
        """Return the initial state of the observer and of the inner law, with zero disturbances."""
        return EsoState(self.inner.memory())

    def rolling(self, situation: Situation) -> tuple[float, float]:
        """Return the slip length (distance from the CG to the point without sideslip) and the effective wheelbase of
        the inner law [m]."""
        return self.inner.rolling(situation)

    def steering(
        self, memory: EsoState, beside: PathDeviation, situation: Situation, dt: float
    ) -> tuple[EsoState, float]:
        """Return the new state and the steering angle [rad]: the angle of the inner law plus the compensation of
        disturbances."""
        memory = self.observe(memory, beside, situation, dt)
        against = -atan(self.rolling(situation)[1] * memory.curvature)
        course = beside._replace(heading=beside.heading + memory.crab, yaw=beside.yaw - memory.crab)
        seen = situation._replace(steer=situation.steer - against)
        inner, wanted = self.inner.steering(memory.inner, course, seen, dt)
        return memory._replace(inner=inner), wanted + against

    def observe(self, memory: EsoState, beside: PathDeviation, situation: Situation, dt: float) -> EsoState:
        """Return the updated observer state. At low speed or large heading error, disturbances are held constant."""
        now = beside.cross_track, beside.heading
        if memory.seen is None or abs(beside.heading) > STEEP or abs(situation.estimate.speed) < MOVING_M_S:
            return memory._replace(seen=now)
        (z_y, z), u, omega = memory.seen, beside.speed, self.bandwidth_per_s
        a, L = self.rolling(situation)
        w = u * ((tan(situation.steer - beside.bias) - tan(beside.steer_here)) / L + memory.curvature)
        r_y, r = now[0] - z_y, now[1] - z
        z_y += dt * (u * (now[1] + memory.crab) + a * w + 2 * omega * r_y)
        z += dt * (w + 2 * omega * r)
        crab, curvature = memory.crab + dt * omega**2 / u * r_y, memory.curvature + dt * omega**2 / u * r
        bounds = LARGEST_CRAB, LARGEST_CURVATURE
        crab, curvature = (clip(x, -most, most) for x, most in zip((crab, curvature), bounds, strict=True))
        return EsoState(memory.inner, (z_y, z), crab, curvature)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of all path-following laws, followed by the columns of the estimated disturbances."""
        return (*super().columns, *DISTURBANCE_COLUMNS)

    def report(self, state: FollowingState) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        return (*super().report(state), state.memory.crab, state.memory.curvature)
