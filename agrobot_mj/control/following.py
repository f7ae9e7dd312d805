"""Common parts of the path-following laws: deviation from the path, speed command and steering limits.

The CG follows a path that has the curvature kappa at the arc length s. If the rear axle, l_r behind the CG, rolls
without sideslip, the heading of the tractor differs from the path tangent by the sideslip beta of the CG:  d(beta)/ds =
kappa - sin(beta) / l_r  in the direction of travel. On an arc, sin(beta) = l_r kappa. The path of the rear axle has the
curvature tan(beta) / l_r, which requires the steering angle delta = atan(L tan(beta) / l_r), with the wheelbase L. In
forward travel beta follows from the path behind the tractor, and in reverse from the path ahead (the bounded solution).
The required steering angle is therefore continuous at a step of the curvature.

Errors are in the frame of the heading, positive left, in both directions of travel. The curvature is the rotation of
the heading per distance along the heading, so that delta and kappa also have the same sign in reverse.
"""

from collections.abc import Sequence
from math import asin, atan, cos, inf, isnan, log, nan, pi, radians, sin, sqrt, tan, tanh
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import SLOWEST_M_S, GuidanceLaw, Route, Situation
from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.kernels import jit, shared, stage
from agrobot_mj.core.signals import Column, Command, PathPoint, Reference, Vector
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters

MAX_STEER_BIAS = radians(10.0)
"""Maximum absolute value of the compensated steering bias [rad]."""
FADING_M, FADING_ANGLE = 0.3, radians(20.0)
"""Cross-track error [m] and heading error [rad] above which the speed correction decreases; it is 0 at twice these
values. Assumed values."""
TURNING_S = 1.0
"""Time for the wheels to return from the steering limit to zero [s]. Assumed value, half the time from lock to lock."""
STEEP = radians(10.0)
"""Heading error above which the tractor is approaching the path instead of tracking the path [rad]. Assumed value."""
MAX_HEADING_CHANGE = radians(6.0)
"""Maximum heading change while the wheels turn to their command [rad]; limits the speed. Assumed value."""
RISE_M_S2 = 1.0
"""Maximum increase rate of the speed command [m/s2]. Assumed value: the tractor reaches the path before full speed."""
LOOKBACK = tuple(-log(1 - (k + 0.5) / 8) for k in range(8))
"""Look-back distances for averaging the curvature (exponential quantiles), divided by the CG to rear-axle distance."""
DISTURBANCE_COLUMNS = (
    Column("heading_disturbance", "rad", "estimated crab angle or heading bias b, left positive"),
    Column("curvature_disturbance", "1/m", "estimated curvature d added to that of the steering angle, left positive"),
)
"""Log columns of the laws that estimate the disturbances caused by tyre slip."""


class Following(GuidanceLaw):
    """Base class of the laws that use the nearest point of the path; each kind defines `steering`."""

    saturation_m_s: NonNegative = 0.6
    """Maximum speed correction towards the time-based reference [m/s]. Assumed value, as for `kinematic`."""
    gain_per_m: Positive = 0.4
    """Slope of speed correction over lag, divided by `saturation_m_s` [1/m]. Assumed value, as for `kinematic`."""
    lateral_acceleration_m_s2: Positive = 2.0
    """Maximum lateral acceleration of a command [m/s2]. Assumed value (1-3); the tractor tips at 6.8 m/s2."""
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    """Preview time of the feed-forward angle [s]. Assumed value (0.3-0.5); 63 % of a steering step takes 0.38 s."""
    approach_deg: Annotated[float, Field(gt=0, le=80)] = 35.0
    """Maximum angle of approach to a distant path [deg]. Assumed value; larger angles require tighter turns."""
    compensate_steer_bias: bool = True
    """Whether to compensate the steering bias reported by the estimator."""
    holds_lane_change: ClassVar = True

    def memory(self) -> Any:
        """Return the initial state of the steering law."""
        return None

    def steering(self, memory: Any, deviation: "PathDeviation", situation: Situation, dt: float) -> tuple[Any, float]:
        """Return the new state of the steering law and the unclipped steering angle [rad] after a tick of `dt` [s]."""
        raise NotImplementedError

    def init(self) -> "FollowingState":
        """Return the initial state."""
        return FollowingState(self.memory())

    def update(self, state: "FollowingState", situation: Situation, dt: float) -> tuple["FollowingState", Command]:
        """Return the new state, and the command with the limited steering angle and the speed."""
        deviation = self._deviation(state, situation)
        memory, wanted = self.steering(state.memory, deviation, situation, dt)
        r, e, limits = situation.reference, situation.estimate, state.limits or self._limits(situation.machine)
        last = nan if state.speed is None else state.speed
        steer, speed = _limited(limits, deviation, r, e.x, e.y, situation.steer, wanted, last, dt)
        place, direction, errors = deviation.place, deviation.direction, (deviation.cross_track, deviation.heading)
        ahead, bias = deviation.steer_ahead, deviation.bias
        return FollowingState(memory, place.s, steer, direction, *errors, ahead, bias, speed, limits), Command(
            steer, speed
        )

    def feedback(self, state: "FollowingState", command: Command) -> float:
        """Return the steering command without feed-forward and steering-bias compensation [rad]."""
        return command.steer - state.steer_ahead - state.bias

    def rolling(self, situation: Situation) -> tuple[float, float]:
        """Return slip length and effective wheelbase [m].

        The slip length is the distance from the CG to the point without sideslip, which is the rear axle if the tyres
        do not slip. The effective wheelbase is the small-angle ratio of steering angle to curvature at this point.
        """
        return situation.machine.cg_to_rear_axle, situation.machine.wheelbase_m

    def _limits(self, machine: TractorParameters) -> "CommandLimits":
        speed = self.saturation_m_s, self.gain_per_m, self.lateral_acceleration_m_s2
        return CommandLimits(*speed, machine.wheelbase_m, machine.steer_limit, MAX_HEADING_CHANGE)

    def _deviation(self, state: "FollowingState", situation: Situation) -> "PathDeviation":
        e, r, route, t = situation.estimate, situation.reference, situation.route, situation.t
        leg = route.leg(t)
        place = route.nearest(e.x, e.y, route.passed(t) if state.s is None else state.s, t)
        direction = _direction(r, state.direction or place.direction)
        rolling = self.rolling(situation)
        distances = _lookback(place.s, abs(e.speed) * self.preview_s, direction, leg, rolling[0])
        bias = e.steer_bias if self.compensate_steer_bias else nan
        curvatures, limit = route.curvatures(distances), situation.steer_limit(self.lateral_acceleration_m_s2)
        return _deviated(place, leg, direction, rolling, curvatures, e.yaw, e.speed, bias, limit)

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
        """Return the values of `columns` for a state."""
        return (nan if state.s is None else state.s, state.cross_track, state.heading, state.steer_ahead)


class Integrating(Following):
    """Base class of the path-following laws with an integral term, stored as the angle `integral` of their state."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of `Following` and of the integral term."""
        return (*super().columns, Column("steer_integral", "rad", "steering angle of the integral term"))

    def report(self, state: "FollowingState") -> Sequence[float]:
        """Return the values of `columns` for a state."""
        return (*super().report(state), state.memory.integral)


class FollowingState(NamedTuple):
    """State of a `Following` law."""

    memory: Any
    """State of the steering law."""
    s: float | None = None
    """Arc length of the nearest path point; None before the first tick [m]."""
    steer: float | None = None
    """Last steering command; None before the first tick [rad]."""
    direction: float = 0.0
    """Last direction of travel: 1 forward, -1 reverse, 0 unknown."""
    cross_track: float = nan
    """Last cross-track error [m]."""
    heading: float = nan
    """Last heading error [rad]."""
    steer_ahead: float = nan
    """Last feed-forward steering angle [rad]."""
    bias: float = 0.0
    """Last steering-bias compensation [rad]."""
    speed: float | None = None
    """Last speed command; None before the first tick [m/s]."""
    limits: "CommandLimits | None" = None
    """Limits of steering angle and speed; None before the first tick."""


class PathDeviation(NamedTuple):
    """Position and heading of the tractor relative to the path in one tick."""

    place: PathPoint
    """Path point nearest to the CG on the current leg."""
    leg: tuple[float, float]
    """Arc lengths of the start and end of the current leg [m]."""
    direction: float
    """Direction of travel: 1 forward, -1 reverse."""
    speed: float
    """Estimated speed along the heading, with the sign of `direction` and a magnitude of at least SLOWEST_M_S [m/s]."""
    yaw: float
    """Heading of the tractor that follows the path without error, at the nearest path point [rad]."""
    cross_track: float
    """Cross-track error of the CG, positive left of the heading [m]."""
    heading: float
    """Heading error: estimated heading minus `yaw`, wrapped [rad]."""
    steer_here: float
    """Steering angle for the path curvature at the nearest point [rad]."""
    steer_ahead: float
    """Steering angle for the path curvature `preview_s` ahead [rad]."""
    bias: float
    """Estimated steering bias, added to the command [rad]."""
    limit: float
    """Maximum absolute steering command [rad]."""


class CommandLimits(NamedTuple):
    """Limits of steering angle and speed, as numbers for compiled kernels."""

    saturation: float
    """Maximum speed correction [m/s]."""
    gain: float
    """Slope of the speed correction over the lag along the path, divided by `saturation` [1/m]."""
    lateral_acceleration: float
    """Maximum lateral acceleration of a command [m/s2]."""
    wheelbase: float
    """Wheelbase of the tractor [m]."""
    steer_limit: float
    """Maximum steering angle [rad]."""
    heading_change: float
    """Maximum heading change while the wheels turn to their command [rad]."""


def _direction(r: Reference, otherwise: float) -> float:
    """Return the direction of travel of the reference, 1 forward or -1 in reverse, or `otherwise` at rest."""
    along = cos(r.yaw) * r.vx + sin(r.yaw) * r.vy
    return -1.0 if (along if abs(along) > 1e-6 else otherwise) < 0 else 1.0


@stage
def _lookback(s: float, preview: float, direction: float, leg: tuple[float, float], length: float) -> Vector:
    """Return the arc lengths [m] whose curvatures give the sideslip at arc length `s` [m] and `preview` [m] later."""
    distances, n = np.zeros(2 * len(LOOKBACK)), len(LOOKBACK)
    for k, lag in enumerate(LOOKBACK):
        distances[k] = _behind(s, direction * lag * length, leg)
        distances[n + k] = _behind(s + preview, direction * lag * length, leg)
    return distances


@shared
def _behind(s: float, lag: float, leg: tuple[float, float]) -> float:
    """Return the arc length `lag` [m] behind the arc length `s` [m], limited to the leg (except for the first leg)."""
    return min(max(s - lag, leg[0] if leg[0] > 0.0 else s - 1e9), leg[1])


@stage
def _deviated(
    place: PathPoint, leg: tuple[float, float], direction: float, rolling: tuple[float, float], curvatures: Vector,
    yaw: float, speed: float, bias: float, limit: float,
) -> PathDeviation:  # fmt: skip
    """Return the deviation from the path.

    `curvatures` are the path curvatures at the arc lengths from `_lookback`. The steering `bias` [rad] may be NaN.
    """
    (l_r, L), n = rolling, len(LOOKBACK)
    beta, later = _sideslip(curvatures[:n], l_r), _sideslip(curvatures[n:], l_r)
    bias = 0.0 if isnan(bias) else min(max(bias, -MAX_STEER_BIAS), MAX_STEER_BIAS)
    return PathDeviation(
        place,
        leg,
        direction,
        direction * max(abs(speed), SLOWEST_M_S),
        place.yaw - beta,
        place.offset,
        wrap(yaw - place.yaw + beta),
        atan(L * tan(beta) / l_r),
        atan(L * tan(later) / l_r),
        bias,
        limit,
    )


@shared
def _sideslip(curvatures: Vector, length: float) -> float:
    """Return the sideslip beta [rad] of a CG that is `length` [m] ahead of the point without sideslip.

    The sideslip follows from the mean curvature behind (in reverse: ahead), weighted by exp(-distance / length).
    """
    total = 0.0
    for curvature in curvatures:
        total += curvature
    return asin(min(max(length * (total / len(curvatures)), -0.95), 0.95))


def sideslip(route: Route, s: float, direction: float, leg: tuple[float, float], length: float) -> float:
    """Return the sideslip [rad] of a CG at arc length `s` [m], `length` [m] ahead of the point without sideslip."""
    return _sideslip(route.curvatures([_behind(s, direction * lag * length, leg) for lag in LOOKBACK]), length)


@stage
def _limited(
    limits: CommandLimits, deviation: PathDeviation, r: Reference, x: float, y: float, steer: float, wanted: float,
    last: float, dt: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the limited steering angle [rad] and speed [m/s]; `last` is the last speed command or NaN.

    The speed is the speed of the reference plus a correction for the lag along the path. It exceeds the reference only
    near the path, because the limited steering rate makes an approach at higher speed less accurate. The tractor slows
    down while the wheels turn to their command and, at a large angle to the path, at large steering angles.
    """
    command = min(max(wanted + deviation.bias, -deviation.limit), deviation.limit)
    along, lead = to_heading(r.yaw, r.vx, r.vy)[0], to_heading(r.yaw, r.x - x, r.y - y)[0]
    astray = max(abs(deviation.cross_track) / FADING_M, abs(deviation.heading) / FADING_ANGLE)
    ahead = limits.saturation * tanh(limits.gain * lead) * deviation.direction
    near = min(max(2.0 - astray, 0.0), 1.0)
    pace = deviation.direction * along + (ahead * near if ahead > 0.0 else ahead)
    turning = abs(command - steer)
    if abs(deviation.heading) > STEEP:
        turning = max(turning, abs(steer - deviation.bias - deviation.steer_here))
    most = min(_approach_speed(limits, deviation), _turning_speed(limits, turning))
    speed = deviation.direction * min(max(pace, 0.0), most)
    if not isnan(last):
        highest = max(abs(last), SLOWEST_M_S) + RISE_M_S2 * dt
        speed = min(max(speed, -highest), highest)
    return command, speed


@jit
def _approach_speed(limits: CommandLimits, deviation: PathDeviation) -> float:
    """Return the maximum speed u [m/s] at which the tractor can turn onto the path from a large heading error theta.

    The arc at the lateral acceleration a, and the travel in the time T = TURNING_S in which the wheels turn, must fit
    into the distance e from the path: u^2 / a (1 - cos theta) + u T sin theta = e. The result is at least the speed at
    which the lateral acceleration at maximum steering angle is a.
    """
    theta, e, a = abs(deviation.heading), abs(deviation.cross_track), limits.lateral_acceleration
    if theta < STEEP or deviation.cross_track * deviation.heading * deviation.direction > 0.0:
        return inf
    bend, straight = (1.0 - cos(theta)) / a, TURNING_S * sin(min(theta, pi / 2))
    tightest = limits.wheelbase / tan(limits.steer_limit)
    return max((sqrt(straight * straight + 4.0 * bend * e) - straight) / (2.0 * bend), sqrt(a * tightest))


@jit
def _turning_speed(limits: CommandLimits, turning: float) -> float:
    """Return the maximum speed u [m/s] at which the heading changes by at most `heading_change` while the wheels turn.

    The wheels turn by `turning` [rad] at a constant rate in the time T, so that u turning T / (2 L) = `heading_change`.
    """
    T = TURNING_S * turning / limits.steer_limit
    return max(2.0 * limits.wheelbase * limits.heading_change / max(turning * T, 1e-6), SLOWEST_M_S)


@shared
def offset_of(deviation: PathDeviation, ahead: float, direction: float, pose: tuple[float, float, float]) -> float:
    """Return the lateral offset of a point of the tractor from its error-free position [m].

    The point is `ahead` [m] of the CG, whose `pose` is x, y [m] and yaw [rad]. The offset is positive to the left of
    the heading `direction` [rad].
    """
    (x, y, yaw), psi = pose, deviation.yaw
    east = x - deviation.place.x + ahead * (cos(yaw) - cos(psi))
    north = y - deviation.place.y + ahead * (sin(yaw) - sin(psi))
    return to_heading(direction, east, north)[1]
