"""Common parts of the path-following laws: deviation from the path, speed command and steering limits.

The CG follows a path that has the curvature kappa at the arc length s. The rear axle is l_r behind the CG. If the rear
axle rolls without sideslip, the heading of the tractor differs from the path tangent by the sideslip beta of the CG:

  d(beta)/ds = kappa - sin(beta) / l_r  in the direction of travel.

On an arc, sin(beta) = l_r kappa. The path of the rear axle has the curvature tan(beta) / l_r. This curvature requires
the steering angle delta = atan(L tan(beta) / l_r), with the wheelbase L. In forward travel beta depends on the path
behind the tractor, and in reverse on the path ahead (the bounded solution). The required steering angle is therefore
continuous at a step of the curvature.

Errors are in the frame of the heading, positive to the left, in both directions of travel. The curvature is the
rotation of the heading per distance along the heading, so that delta and kappa also have the same sign in reverse.
"""

from collections.abc import Sequence
from math import nan
from typing import Annotated, Any, ClassVar, NamedTuple, cast

from pydantic import Field

from agrobot_mj.control.base import GuidanceLaw, Situation
from agrobot_mj.control.deviation import (
    MAX_HEADING_CHANGE,
    CommandLimits,
    Followed,
    PathDeviation,
    Situated,
    direction_of,
    limited_commands,
    lookback,
    path_deviation,
)
from agrobot_mj.core.calls import Linked
from agrobot_mj.core.contracts import is_compiled
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, stage
from agrobot_mj.core.signals import Column, Command, Vector
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters

DISTURBANCE_COLUMNS = (
    Column("heading_disturbance", "rad", "estimated crab angle or heading bias b, left positive"),
    Column("curvature_disturbance", "1/m", "estimated curvature d added to that of the steering angle, left positive"),
)
"""Log columns of the estimated heading and curvature disturbances."""


_lookback, _deviated, _followed = stage(lookback), stage(path_deviation), stage(limited_commands)


class FollowingLaw(NamedTuple):
    """Parameters of a path-following law that has no compiled tick function."""

    limits: CommandLimits


class Following(GuidanceLaw):
    """Base class of the path-following laws, which steer by the nearest path point. Subclasses define `steering`."""

    saturation_m_s: NonNegative = 0.6
    """Maximum speed correction towards the moving reference point [m/s]. Assumed value, equal to the default of
    `kinematic`."""
    gain_per_m: Positive = 0.4
    """Slope of the speed correction versus the lag behind the reference, divided by `saturation_m_s` [1/m]. Assumed
    value, equal to the default of `kinematic`."""
    lateral_acceleration_m_s2: Positive = 2.0
    """Maximum lateral acceleration that a command may require [m/s2]. Assumed value (range 1-3); the tractor tips at
    6.8 m/s2."""
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    """Preview time of the feed-forward angle [s]. Assumed value (range 0.3-0.5): the steering reaches 63 % of a step
    after 0.38 s."""
    approach_deg: Annotated[float, Field(gt=0, le=80)] = 35.0
    """Maximum angle of approach to a distant path [deg]. Assumed value; larger angles require tighter turns."""
    compensate_steer_bias: bool = True
    """Whether to compensate the steering bias reported by the estimator."""
    holds_lane_change: ClassVar = True
    compiled: ClassVar[Any] = None
    """Compiled function of one tick on a sampled path, or None for a law that is not compiled."""

    def memory(self) -> Any:
        """Return the initial state of the steering law, without values that depend on the tractor."""
        return None

    def steering(self, memory: Any, deviation: PathDeviation, situation: Situation, dt: float) -> tuple[Any, float]:
        """Return the new state of the steering law and the unclipped steering angle [rad] after a tick of `dt` [s]."""
        raise NotImplementedError

    def init(self) -> "FollowingState":
        """Return the initial state of the law before the first tick."""
        return FollowingState(self.memory())

    def update(self, state: "FollowingState", situation: Situation, dt: float) -> tuple["FollowingState", Command]:
        """Return the new state and the command with limited steering angle and speed."""
        route: Any = situation.route
        t, law, memory = situation.t, state.law, state.memory
        if law is None:
            law, memory = self._law(situation.machine), self.begin(memory, situation.machine)
        near, (low, high) = route.distance_at(t) if state.s is None else state.s, route.leg(t)
        seen = Situated(held(situation.estimate), situation.steer, low, high, near)
        last, r = (state.direction, nan if state.speed is None else state.speed), situation.reference
        while type(law) is not FollowingLaw and hasattr(route, "around"):
            samples = route.around(max(near, low))
            after, found, most, reported = self.compiled(law, held(memory), last, samples, seen, r, dt)
            if not route.grows(most):  # the curvatures ahead required no further samples
                break
        else:
            limits, situation, memory, reported = fetched(law).limits, situation.fetched(), fetched(memory), None
            deviation = self._deviation(limits, last[0], situation, seen)
            after, wanted = self.steering(memory, deviation, situation, dt)
            found = _followed(limits, deviation, r, seen, wanted, last[1], dt)
        return FollowingState(after, *found, law, reported), Command(found.steer, found.speed)  # type: ignore[call-arg]

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python method `update`."""
        return not is_compiled(self, "update", "steering", "rolling", "report", "columns")

    def compiled_tick(self, state: "FollowingState", machine: TractorParameters) -> Linked | None:
        """Return the compiled tick function, its parameters and its state, or None before the first tick of the law."""
        if state.reported is None:
            return None
        return Linked(self.compiled, state.law, state.memory, cast(Any, Followed)(*state[1:9]))

    def state_after_ticks(
        self, state: "FollowingState", found: Held[Any], followed: Followed, shown: Vector
    ) -> "FollowingState":
        """Return the state of the law after ticks in compiled code; see `GuidanceLaw.state_after_ticks`."""
        return FollowingState(found, *followed, state.law, shown)

    def feedback(self, state: "FollowingState", command: Command) -> float:
        """Return the steering command [rad] without feed-forward and steering-bias compensation."""
        return command.steer - state.steer_ahead - state.bias

    def rolling(self, situation: Situation) -> tuple[float, float]:
        """Return the slip length and the effective wheelbase [m].

        The slip length is the distance from the CG to the point without sideslip, which is the rear axle if the tyres
        do not slip. The effective wheelbase is the small-angle ratio of steering angle to curvature at the point
        without sideslip.
        """
        return situation.machine.cg_to_rear_axle, situation.machine.wheelbase_m

    def begin(self, memory: Any, machine: TractorParameters) -> Any:
        """Return the initial state `memory`, completed with values that depend on the tractor."""
        return memory

    def parameters(self, limits: CommandLimits, machine: TractorParameters) -> Any:
        """Return the parameters of the function `compiled`, starting with `limits`."""
        return FollowingLaw(limits)

    def _law(self, machine: TractorParameters) -> Any:
        speed = self.saturation_m_s, self.gain_per_m, self.lateral_acceleration_m_s2, self.preview_s
        reach = machine.wheelbase_m, machine.steer_limit, MAX_HEADING_CHANGE
        limits = CommandLimits(*speed, self.compensate_steer_bias, *reach)
        if is_compiled(self, "update", "steering", "rolling"):
            return held(self.parameters(limits, machine))
        return FollowingLaw(limits)

    def _deviation(self, limits: CommandLimits, last: float, situation: Situation, seen: Situated) -> PathDeviation:
        """Return the deviation from the path for a route without samples or for a law that is not compiled."""
        route, rolling, e = situation.route, self.rolling(situation), situation.estimate
        place = route.nearest(e.x, e.y, seen.near, situation.t)
        direction = direction_of(situation.reference, last, place)
        curvatures = route.curvatures(_lookback(limits, place, direction, seen, rolling[0]))
        return _deviated(limits, place, direction, rolling, curvatures, seen)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of arc length, cross-track error, heading error and feed-forward angle."""
        return (
            Column("path_s", "m", "arc length of the path point nearest to the estimated CG"),
            Column("e_cross_track_hat", "m", "estimated cross-track error of the CG, left of the heading positive"),
            Column("e_heading_hat", "rad", "estimated heading minus heading of a tractor on the path, left positive"),
            Column("steer_feedforward", "rad", "feed-forward steering angle for the path curvature"),
        )

    def report(self, state: "FollowingState") -> Sequence[float]:
        """Return the values of the log columns for a state of the law."""
        return (nan if state.s is None else state.s, state.cross_track, state.heading, state.steer_ahead)


class Integrating(Following):
    """Base class of the path-following laws with an integral term, stored as the angle `integral` in their state."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of `Following` and the log column of the integral term."""
        return (*super().columns, Column("steer_integral", "rad", "steering angle of the integral term"))

    def report(self, state: "FollowingState") -> Sequence[float]:
        """Return the values of the log columns for a state of the law."""
        if state.reported is not None:
            return state.reported.tolist()
        return (*super().report(state), state.memory.integral)


class FollowingState(NamedTuple):
    """State of a `Following` law between two ticks."""

    memory: Any  # State of the steering law, as a reference if the law is compiled
    s: float | None = None  # Arc length of the nearest path point [m], or None before the first tick
    steer: float | None = None  # Last steering command [rad], or None before the first tick
    direction: float = 0.0  # Last direction of travel: 1 forward, -1 reverse, 0 unknown
    cross_track: float = nan  # Last cross-track error [m]
    heading: float = nan  # Last heading error [rad]
    steer_ahead: float = nan  # Last feed-forward steering angle [rad]
    bias: float = 0.0  # Last steering-bias compensation [rad]
    speed: float | None = None  # Last speed command [m/s], or None before the first tick
    law: Any = None  # Parameters of the law, or None before the first tick
    reported: Vector | None = None  # Values of the log columns, or None if the law is not compiled
