"""What path-following laws share: where the tractor is beside the path, how fast to go, and the limits of the steering.

The path is that of the CG. A tractor whose rear axle rolls without sideslip then heads beside the path's tangent, by
the sideslip beta of the CG:  d(beta)/ds = kappa - sin(beta) / l_r  in the direction of travel, on an arc sin(beta) =
l_r kappa. The rear axle runs on a curvature tan(beta) / l_r, which the wheelbase turns into the steering angle delta
= atan(L tan(beta) / l_r). Forward, beta follows from the path behind, in reverse from the path ahead (the bounded
solution), so that a step of curvature gives a steering angle that the tractor can follow.

Errors are in the frame of the heading, left positive, in both directions of travel; the curvature is the turn of the
heading per metre along the heading, so that delta has the sign of kappa in reverse too.
"""

from collections.abc import Sequence
from math import asin, atan, cos, inf, isnan, log, nan, pi, radians, sin, sqrt, tan, tanh
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import SLOWEST_M_S, GuidanceLaw, Route, Situation
from agrobot_mj.control.pid import clip
from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.signals import Column, Command, PathPoint
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters

LARGEST_BIAS = radians(10.0)
"""Largest estimated steering bias that is corrected [rad]."""
ASTRAY_M, ASTRAY = 0.3, radians(20.0)
"""Cross-track [m] and heading error [rad] above which the speed correction fades, to zero at twice these. Assumed
value."""
TURNING_S = 1.0
"""Time until the wheels have turned from a limit to straight ahead [s]. Assumed value: half of stop to stop."""
STEEP = radians(10.0)
"""Heading error above which the tractor is approaching the path rather than following it [rad]. Assumed value."""
SWING = radians(6.0)
"""Turn of the heading beyond which the tractor waits for wheels that still turn to their command [rad]. Assumed
value."""
RISE_M_S2 = 1.0
"""Fastest rise of the speed command, so that a path is followed before haste begins [m/s2]. Assumed value."""
LAGS = tuple(-log(1 - (k + 0.5) / 8) for k in range(8))
"""Quantiles of the exponential distribution: distances, in l_r, at which the curvature is averaged for beta."""
DISTURBANCE_COLUMNS = (
    Column("heading_disturbance", "rad", "estimated crab angle or heading bias b of the law, left positive"),
    Column("curvature_disturbance", "1/m", "estimated curvature d beside that of the steering, left positive"),
)
"""Columns of the laws that estimate what slip does to the way."""


class Following(GuidanceLaw):
    """Base of the laws that follow the path by its nearest point; a law gives `steering`."""

    saturation_m_s: NonNegative = 0.6
    """Largest speed spent on catching up with the time-based reference [m/s]. Assumed value, that of the kinematic
    law."""
    gain_per_m: Positive = 0.4
    """Slope of this correction relative to its saturation [1/m]. Assumed value, that of the kinematic law."""
    lateral_acceleration_m_s2: Positive = 2.0
    """Largest lateral acceleration that a command may ask for [m/s2]. Assumed value (1-3): the tractor tips at 6.8."""
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    """Time by which the feed-forward angle is taken ahead [s]. Assumed value (0.3-0.5): the loop's own 63 % time is
    0.38."""
    approach_deg: Annotated[float, Field(gt=0, le=80)] = 35.0
    """Largest angle at which it heads for a path far away [deg]. Assumed value: steeper, the turn onto it is
    tighter."""
    compensate_steer_bias: bool = True
    """Whether a steering bias that the estimator knows is added to the command."""
    holds_lane_change: ClassVar = True

    def memory(self) -> Any:
        """State of the law itself before the first tick."""
        return None

    def steering(self, memory: Any, beside: "Beside", situation: Situation, dt: float) -> tuple[Any, float]:
        """Memory after a tick of `dt` [s] and wanted steering angle [rad]; what is out of reach will be clipped."""
        raise NotImplementedError

    def init(self) -> "FollowingState":
        """Before the first tick."""
        return FollowingState(self.memory())

    def update(self, state: "FollowingState", situation: Situation, dt: float) -> tuple["FollowingState", Command]:
        """Place beside the path, steering law, limits."""
        beside = self._beside(state, situation, dt)
        memory, wanted = self.steering(state.memory, beside, situation, dt)
        steer = clip(wanted + beside.bias, -beside.limit, beside.limit)
        speed = self._speed(beside, situation, steer)
        if state.speed is not None:
            highest = max(abs(state.speed), SLOWEST_M_S) + RISE_M_S2 * dt
            speed = clip(speed, -highest, highest)
        state = FollowingState(
            memory,
            beside.place.s,
            steer,
            beside.direction,
            beside.cross_track,
            beside.heading,
            beside.steer_ahead,
            beside.bias,
            speed,
        )
        return state, Command(steer, speed)

    def feedback(self, state: "FollowingState", command: Command) -> float:
        """Command without its feed-forward and the correction of the steering bias [rad]."""
        return command.steer - state.steer_ahead - state.bias

    def slip_length(self, situation: Situation) -> float:
        """Distance of the CG from the point of the tractor that has no sideslip [m]; l_r unless the tyres slip."""
        return situation.machine.cg_to_rear_axle

    def effective_wheelbase(self, situation: Situation) -> float:
        """Steering angle per curvature of that point, small angles [m]; L unless the tyres slip."""
        return situation.machine.wheelbase_m

    def _beside(self, state: "FollowingState", situation: Situation, dt: float) -> "Beside":
        estimate, r, route, t = situation.estimate, situation.reference, situation.route, situation.t
        leg = route.leg(t)
        near = route.passed(t) if state.s is None else state.s
        place = route.nearest(estimate.x, estimate.y, near, t)
        along = to_heading(r.yaw, r.vx, r.vy)[0]
        direction = _sign(along if abs(along) > 1e-6 else state.direction or place.direction)
        l_r, L = self.slip_length(situation), self.effective_wheelbase(situation)
        beta = sideslip(route, place.s, direction, leg, l_r)
        later = sideslip(route, place.s + abs(estimate.speed) * self.preview_s, direction, leg, l_r)
        bias = estimate.steer_bias if self.compensate_steer_bias and not isnan(estimate.steer_bias) else 0.0
        return Beside(
            place=place,
            leg=leg,
            direction=direction,
            speed=direction * max(abs(estimate.speed), SLOWEST_M_S),
            yaw=place.yaw - beta,
            cross_track=place.offset,
            heading=wrap(estimate.yaw - place.yaw + beta),
            steer_here=atan(L * tan(beta) / l_r),
            steer_ahead=atan(L * tan(later) / l_r),
            bias=clip(bias, -LARGEST_BIAS, LARGEST_BIAS),
            limit=situation.steer_limit(self.lateral_acceleration_m_s2),
        )

    def _speed(self, beside: "Beside", situation: Situation, steer: float) -> float:
        """Speed of the reference and a share of the way by which it leads [m/s]; never against the leg's direction.

        It catches up only near the path: haste makes the rate of the steering a limit on the way back. It waits for
        wheels that are on their way to the command, and, at a steep angle to the path, for wheels that are turned far.
        """
        r, e, k_s, k_e = situation.reference, situation.estimate, self.saturation_m_s, self.gain_per_m
        along, lead = to_heading(r.yaw, r.vx, r.vy)[0], to_heading(r.yaw, r.x - e.x, r.y - e.y)[0]
        astray = max(abs(beside.cross_track) / ASTRAY_M, abs(beside.heading) / ASTRAY)
        ahead = k_s * tanh(k_e * lead) * beside.direction
        pace = beside.direction * along + (ahead * clip(2.0 - astray, 0.0, 1.0) if ahead > 0.0 else ahead)
        turning = abs(steer - situation.steer)
        if abs(beside.heading) > STEEP:
            turning = max(turning, abs(situation.steer - beside.bias - beside.steer_here))
        most = min(self._approach_speed(beside, situation), _swing(situation.machine, turning))
        return beside.direction * clip(pace, 0.0, most)

    def _approach_speed(self, beside: "Beside", situation: Situation) -> float:
        """Largest speed [m/s] at which it can still turn onto a path that it heads for at a steep angle theta.

        The arc that the lateral acceleration a allows, and the way until the wheels have turned, then fit into the
        distance e from the path:  u^2 / a (1 - cos theta) + u T sin theta = e;  never less than full lock allows.
        """
        theta, e, a = abs(beside.heading), abs(beside.cross_track), self.lateral_acceleration_m_s2
        if theta < STEEP or beside.cross_track * beside.heading * beside.direction > 0.0:
            return inf
        bend, straight = (1.0 - cos(theta)) / a, TURNING_S * sin(min(theta, pi / 2))
        tightest = situation.machine.wheelbase_m / tan(situation.machine.steer_limit)
        return max((sqrt(straight**2 + 4.0 * bend * e) - straight) / (2.0 * bend), sqrt(a * tightest))

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the tractor's position and heading relative to the path."""
        return (
            Column("path_s", "m", "distance along the path of the point nearest to the estimated CG"),
            Column("e_cross_track_hat", "m", "estimated CG from the path, left of the heading positive"),
            Column("e_heading_hat", "rad", "estimated heading less that of a tractor on the path, left positive"),
            Column("steer_feedforward", "rad", "steering angle that the curvature of the path asks for"),
        )

    def report(self, state: "FollowingState") -> Sequence[float]:
        """Values of `columns`."""
        return (nan if state.s is None else state.s, state.cross_track, state.heading, state.steer_ahead)


class Integrating(Following):
    """Base of the followers whose own memory has an `integral`, an angle that they report."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of every path-following law, and the integral."""
        return (*super().columns, Column("steer_integral", "rad", "steering angle held by the integral of the law"))

    def report(self, state: "FollowingState") -> Sequence[float]:
        """Values of `columns`."""
        return (*super().report(state), state.memory.integral)


class FollowingState(NamedTuple):
    """Memory of a `Following`."""

    memory: Any
    """State of the law itself."""
    s: float | None = None
    """Distance of the nearest point along the path; None before the first tick [m]."""
    steer: float | None = None
    """Last command; None before the first tick [rad]."""
    direction: float = 0.0
    """Last direction of travel: 1 forward, -1 in reverse, 0 unknown."""
    cross_track: float = nan
    """Last cross-track error [m]."""
    heading: float = nan
    """Last heading error [rad]."""
    steer_ahead: float = nan
    """Last feed-forward angle [rad]."""
    bias: float = 0.0
    """Last correction of the steering bias [rad]."""
    speed: float | None = None
    """Last speed command; None before the first tick [m/s]."""


class Beside(NamedTuple):
    """Position and heading of the tractor relative to the path in one tick."""

    place: PathPoint
    """Point of the path nearest to the CG, on the present leg."""
    leg: tuple[float, float]
    """Distances between which the direction of travel is kept [m]."""
    direction: float
    """1 forward, -1 in reverse."""
    speed: float
    """Estimated speed along the heading, of this direction and at least SLOWEST_M_S [m/s]."""
    yaw: float
    """Heading of a tractor whose CG follows the path there [rad]."""
    cross_track: float
    """CG from the path, left of the heading positive [m]."""
    heading: float
    """Heading less `yaw`, wrapped [rad]."""
    steer_here: float
    """Steering angle that the path asks for at this place [rad]."""
    steer_ahead: float
    """Steering angle that it asks for `preview_s` later [rad]."""
    bias: float
    """Estimated steering bias, which the command has to contain [rad]."""
    limit: float
    """Largest steering command either way [rad]."""

    def offset_of(self, ahead: float, direction: float, situation: Situation) -> float:
        """Offset of the tractor's point `ahead` [m] of the CG from where it would be without errors [m].

        Positive to the left of `direction` [rad].
        """
        e, psi = situation.estimate, self.yaw
        east = e.x - self.place.x + ahead * (cos(e.yaw) - cos(psi))
        north = e.y - self.place.y + ahead * (sin(e.yaw) - sin(psi))
        return to_heading(direction, east, north)[1]


def sideslip(route: Route, s: float, direction: float, leg: tuple[float, float], length: float) -> float:
    """Sideslip beta [rad] of a CG on the path at `s` [m], `length` [m] before the point that has none.

    The mean of the curvature behind (in reverse: ahead), weighted by exp(-distance / length).
    """
    low, high = (leg[0] if leg[0] > 0.0 else s - 1e9, leg[1])  # before its start the path is straight
    ways = [clip(s - direction * lag * length, low, high) for lag in LAGS]
    curvature = sum(route.curvatures(ways).tolist()) / len(LAGS)
    return asin(clip(length * curvature, -0.95, 0.95))


def _swing(machine: TractorParameters, turning: float) -> float:
    """Largest speed [m/s] at which the heading turns by no more than SWING while the wheels turn by `turning` [rad].

    With wheels that turn evenly through it in the time T:  u turning T / (2 L) = SWING.
    """
    T = TURNING_S * turning / machine.steer_limit
    return max(2.0 * machine.wheelbase_m * SWING / max(turning * T, 1e-6), SLOWEST_M_S)


def _sign(x: float) -> float:
    return -1.0 if x < 0 else 1.0
