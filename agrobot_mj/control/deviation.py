"""Compiled kernels for the deviation of the tractor from its path and for the command limits; see `following`."""

from math import asin, atan, cos, inf, isnan, log, nan, pi, radians, sin, sqrt, tan, tanh
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.control.base import SLOWEST_M_S, Route, steer_limit_at
from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, jit, shared
from agrobot_mj.core.samples import curvatures_at, nearest_point
from agrobot_mj.core.signals import Estimate, Matrix, PathPoint, Reference, Vector

MAX_STEER_BIAS = radians(10.0)  # Maximum absolute value of the compensated steering bias [rad]
FADING_M, FADING_ANGLE = 0.3, radians(20.0)
"""Cross-track error [m] and heading error [rad] above which the speed increase of a lagging tractor is reduced. The
increase is 0 at twice these values. Assumed values."""
TURNING_S = 1.0
"""Time in which the wheels return from the steering limit to zero [s]. Assumed value; lock to lock takes 3.5 s."""
STEEP = radians(10.0)
"""Heading error above which the motion counts as an approach to the path [rad]. Assumed value."""
MAX_HEADING_CHANGE = radians(6.0)
"""Maximum heading change while the wheels turn to the commanded angle [rad], used to limit the speed. Assumed value."""
RISE_M_S2 = 1.0
"""Maximum acceleration of the speed command [m/s2]. Assumed value, low enough to reach the path before full speed."""
LOOKBACK = tuple(-log(1 - (k + 0.5) / 8) for k in range(8))
"""Distances behind the CG at which path curvatures are averaged, divided by the slip length [-]. The distances are
quantiles of an exponential distribution."""


def law_form(
    law: Held[Any], state: Held[Any], last: tuple[float, float], samples: Matrix, seen: "Situated", r: Reference,
    dt: float,
) -> "tuple[Held[Any], Followed, float, Vector]":  # fmt: skip
    """Define the signature of a compiled guidance law. The function itself is never called.

    `last` contains the last direction of travel and the last speed command [m/s]. The results are the new state, the
    command with the path errors, the arc length [m] up to which the path must be sampled, and the values of the
    columns.
    """
    raise NotImplementedError


class Followed(NamedTuple):
    """Command and path errors of a law in one tick. `FollowingState` describes the fields."""

    s: float
    steer: float
    direction: float
    cross_track: float
    heading: float
    steer_ahead: float
    bias: float
    speed: float


class Situated(NamedTuple):
    """Inputs of a compiled guidance law in one tick: estimate, measurements, and search range for the nearest point."""

    estimate: Held[Estimate]
    steer: float  # Measured steering angle [rad]
    low: float
    high: float  # Arc lengths of the start and end of the current leg [m]
    near: float  # Arc length around which the nearest point is searched [m]
    preview: float = nan  # Curvature of the reference after the preview time of the cascade `feedforward` [1/m]
    t: float = nan  # Time since the start of the run [s]
    roll: float = nan  # Measured roll [rad]
    implement: tuple[float, float] = (nan, nan)  # Measured east and north position of the implement [m]


class PathDeviation(NamedTuple):
    """Position and heading of the tractor relative to the path in one tick."""

    place: PathPoint  # Path point nearest to the CG on the current leg
    leg: tuple[float, float]  # Arc lengths of the start and end of the current leg [m]
    direction: float  # Direction of travel: 1 forward, -1 reverse
    speed: float
    """Estimated speed along the heading [m/s], with the sign of `direction` and a magnitude of at least SLOWEST_M_S."""
    yaw: float  # Heading of an error-free tractor at the nearest path point [rad]
    cross_track: float  # Cross-track error of the CG [m], positive left of the heading
    heading: float  # Heading error: estimated heading minus `yaw`, wrapped [rad]
    steer_here: float  # Steering angle for the path curvature at the nearest point [rad]
    steer_ahead: float  # Steering angle for the path curvature `preview_s` ahead [rad]
    bias: float  # Estimated steering bias, added to the command [rad]
    limit: float  # Maximum absolute steering command [rad]


class CommandLimits(NamedTuple):
    """Limits of the steering and speed commands, as numbers for compiled kernels."""

    saturation: float  # Maximum speed correction [m/s]
    gain: float  # Slope of the speed correction, divided by its saturation [1/m]
    lateral_acceleration: float  # Maximum lateral acceleration [m/s2]
    preview_s: float  # Preview time of the feed-forward angle [s]
    compensates: bool  # Whether to compensate the steering bias
    wheelbase: float  # Wheelbase [m]
    steer_limit: float  # Maximum steering angle [rad]
    heading_change: float  # Maximum heading change while the wheels turn to their command [rad]


@shared
def direction_of(r: Reference, last: float, place: PathPoint) -> float:
    """Return the direction of travel of the reference: 1 forward, -1 in reverse.

    At rest, return the `last` direction or, if this is 0, the direction of the path point.
    """
    along, otherwise = cos(r.yaw) * r.vx + sin(r.yaw) * r.vy, place.direction if last == 0.0 else last
    return -1.0 if (along if abs(along) > 1e-6 else otherwise) < 0 else 1.0


@jit
def lookback(limits: CommandLimits, place: PathPoint, direction: float, seen: Situated, length: float) -> Vector:
    """Return arc lengths [m] at which path curvatures determine the sideslip of the CG.

    The first half of the array is for a CG at the path point `place`, the second half for a CG `preview_s` later.
    """
    distances, n = np.zeros(2 * len(LOOKBACK)), len(LOOKBACK)
    s, preview, leg = place.s, abs(fetched(seen.estimate).speed) * limits.preview_s, (seen.low, seen.high)
    for k, lag in enumerate(LOOKBACK):
        distances[k] = _behind(s, direction * lag * length, leg)
        distances[n + k] = _behind(s + preview, direction * lag * length, leg)
    return distances


@shared
def _behind(s: float, lag: float, leg: tuple[float, float]) -> float:
    """Return the arc length `s` - `lag` [m], limited to the current leg (path between two reversals). The first leg has
    no lower limit."""
    return min(max(s - lag, leg[0] if leg[0] > 0.0 else s - 1e9), leg[1])


@jit
def path_deviation(
    limits: CommandLimits, place: PathPoint, direction: float, rolling: tuple[float, float], curvatures: Vector,
    seen: Situated,
) -> PathDeviation:  # fmt: skip
    """Return the deviation of the tractor from the path.

    `rolling` contains the slip length and the effective wheelbase [m]; `curvatures` [1/m] are at the arc lengths that
    `lookback` returns.
    """
    (l_r, L), n, e = rolling, len(LOOKBACK), fetched(seen.estimate)
    u = max(abs(e.speed), SLOWEST_M_S)
    beta, later = _sideslip(curvatures[:n], l_r), _sideslip(curvatures[n:], l_r)
    known = limits.compensates and not isnan(e.steer_bias)
    bias = min(max(e.steer_bias, -MAX_STEER_BIAS), MAX_STEER_BIAS) if known else 0.0
    limit = steer_limit_at(e.speed, limits.lateral_acceleration, limits.wheelbase, limits.steer_limit)
    return PathDeviation(
        place,
        (seen.low, seen.high),
        direction,
        direction * u,
        place.yaw - beta,
        place.offset,
        wrap(e.yaw - place.yaw + beta),
        atan(L * tan(beta) / l_r),
        atan(L * tan(later) / l_r),
        bias,
        limit,
    )


@jit
def deviated_on(
    limits: CommandLimits, last: float, samples: Matrix, seen: Situated, r: Reference, rolling: tuple[float, float]
) -> tuple[PathDeviation, float]:
    """Return the deviation from a sampled path, and the arc length [m] up to which the path must be sampled.

    `last` is the last direction of travel, or 0.
    """
    e = fetched(seen.estimate)
    place = nearest_point(samples, e.x, e.y, seen.near, seen.low, seen.high)
    direction = direction_of(r, last, place)
    curvatures, most = curvatures_at(samples, lookback(limits, place, direction, seen, rolling[0]))
    return path_deviation(limits, place, direction, rolling, curvatures, seen), most


@shared
def _sideslip(curvatures: Vector, length: float) -> float:
    """Return the sideslip beta [rad] of a CG that is `length` [m] ahead of the point without sideslip.

    The sideslip depends on the mean curvature behind the CG (in reverse: ahead), weighted by exp(-distance / length).
    """
    total = 0.0
    for curvature in curvatures:
        total += curvature
    return asin(min(max(length * (total / len(curvatures)), -0.95), 0.95))


def sideslip(route: Route, s: float, direction: float, leg: tuple[float, float], length: float) -> float:
    """Return the sideslip [rad] of a vehicle whose CG is at the arc length `s` [m].

    The point of the vehicle without sideslip is `length` [m] behind the CG.
    """
    return _sideslip(route.curvatures([_behind(s, direction * lag * length, leg) for lag in LOOKBACK]), length)


@jit
def limited_commands(
    limits: CommandLimits,
    deviation: PathDeviation,
    r: Reference,
    seen: Situated,
    wanted: float,
    last: float,
    dt: float,
) -> Followed:
    """Return the limited steering and speed commands of a law, with the path errors.

    `last` is the last speed command [m/s] or NaN. The speed command is the reference speed plus a correction for the
    lag behind the reference. A positive correction is applied only near the path, because the limited steering rate
    makes a faster approach less accurate. The tractor slows down while the wheels turn to the commanded angle. At a
    large angle to the path the tractor also slows down if the steering angle is large.
    """
    e, command = fetched(seen.estimate), min(max(wanted + deviation.bias, -deviation.limit), deviation.limit)
    along, lead = to_heading(r.yaw, r.vx, r.vy)[0], to_heading(r.yaw, r.x - e.x, r.y - e.y)[0]
    astray = max(abs(deviation.cross_track) / FADING_M, abs(deviation.heading) / FADING_ANGLE)
    ahead = limits.saturation * tanh(limits.gain * lead) * deviation.direction
    near = min(max(2.0 - astray, 0.0), 1.0)
    pace = deviation.direction * along + (ahead * near if ahead > 0.0 else ahead)
    turning = abs(command - seen.steer)
    if abs(deviation.heading) > STEEP:
        turning = max(turning, abs(seen.steer - deviation.bias - deviation.steer_here))
    most = min(_approach_speed(limits, deviation), _turning_speed(limits, turning))
    speed = deviation.direction * min(max(pace, 0.0), most)
    if not isnan(last):
        highest = max(abs(last), SLOWEST_M_S) + RISE_M_S2 * dt
        speed = min(max(speed, -highest), highest)
    d = deviation
    return Followed(d.place.s, command, d.direction, d.cross_track, d.heading, d.steer_ahead, d.bias, speed)


@jit
def integral_columns(found: Followed, integral: float) -> Vector:
    """Return the values of the log columns of `Integrating`, given the result of a tick and the integral term [rad]."""
    return np.array((found.s, found.cross_track, found.heading, found.steer_ahead, integral))


@jit
def _approach_speed(limits: CommandLimits, deviation: PathDeviation) -> float:
    """Return the maximum speed u [m/s] at which the tractor can turn onto the path from a large angle theta.

    The arc at the lateral acceleration a, and the travel in the time T = TURNING_S in which the wheels turn, must fit
    into the distance e from the path: u^2 / a (1 - cos theta) + u T sin theta = e. The result is at least the speed at
    which an arc at full lock requires a. The result is infinite at a small angle, and if the tractor moves away from
    the path.
    """
    theta, e, a = abs(deviation.heading), abs(deviation.cross_track), limits.lateral_acceleration
    if theta < STEEP or deviation.cross_track * deviation.heading * deviation.direction > 0.0:
        return inf
    bend, straight = (1.0 - cos(theta)) / a, TURNING_S * sin(min(theta, pi / 2))
    tightest = limits.wheelbase / tan(limits.steer_limit)
    return max((sqrt(straight * straight + 4.0 * bend * e) - straight) / (2.0 * bend), sqrt(a * tightest))


@jit
def _turning_speed(limits: CommandLimits, turning: float) -> float:
    """Return the maximum speed u [m/s] at which the heading changes by at most A = `heading_change`. The wheels turn by
    `turning` [rad] at a constant rate in the time T, so that u turning T / (2 L) = A."""
    T = TURNING_S * turning / limits.steer_limit
    return max(2.0 * limits.wheelbase * limits.heading_change / max(turning * T, 1e-6), SLOWEST_M_S)


@shared
def offset_of(deviation: PathDeviation, ahead: float, direction: float, pose: tuple[float, float, float]) -> float:
    """Return the lateral offset [m] of a tractor point from its position on a tractor without path errors.

    The point is `ahead` [m] in front of the CG at `pose` (x, y [m], yaw [rad]). Left of `direction` [rad] is positive.
    """
    (x, y, yaw), psi = pose, deviation.yaw
    east = x - deviation.place.x + ahead * (cos(yaw) - cos(psi))
    north = y - deviation.place.y + ahead * (sin(yaw) - sin(psi))
    return to_heading(direction, east, north)[1]
