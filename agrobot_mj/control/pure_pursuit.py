"""Pure pursuit: steering along the arc that leads the rear axle to a goal point ahead on its path.

With the goal (a, b) in the frame of the heading, relative to the rear axle R, the curvature is kappa = 2 b / (a^2 +
b^2), and the steering angle delta = atan(L kappa) with the wheelbase L. The goal is on the path of R that corresponds
to the given path of the CG, at a look-ahead distance that increases with the speed. The same equation holds in reverse,
with the goal behind. Source: [Coulter1992], [Snider2009].

The arc begins at the position of R predicted for `prediction_s` later at the current yaw rate. The prediction
compensates the delay and lag of the steering, which would otherwise cause oscillation at high speed.

The law works on any path, forward and in reverse. Only the look-ahead distance needs tuning. Where the curvature
changes, the tractor cuts the corner by about the squared look-ahead distance divided by eight times the radius. A short
distance causes oscillation if the lag is not compensated. Side slopes, steering errors and valve dead bands cause an
offset. In forward travel near the path, an integral of the cross-track error over the distance removes the offset, as
in AgOpenGPS.
"""

from math import atan, copysign, cos, radians, sin, sqrt, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import SLOWEST_M_S, Situation
from agrobot_mj.control.deviation import MAX_STEER_BIAS, STEEP, PathDeviation, sideslip
from agrobot_mj.control.following import Integrating
from agrobot_mj.control.pid import clip
from agrobot_mj.core.geometry import from_heading, to_heading
from agrobot_mj.core.kernels import stage
from agrobot_mj.core.signals import PathPoint
from agrobot_mj.core.spec import NonNegative, Positive

BRISK_M_S = 1.2
"""Speed below which `lookahead_m` is reduced [m/s]. Assumed value: the field speed in the paper."""


MAX_INTEGRATED_M = 0.1
"""Limit to which the integrated cross-track error is clipped [m], to prevent windup during an approach. Assumed
value."""


class PursuitState(NamedTuple):
    """State of `PurePursuit` between two ticks."""

    integral: float = 0.0  # Steering angle of the integral term [rad]


class PurePursuit(Integrating):
    """Pure pursuit law, which steers the rear axle along an arc to a goal point ahead on the path."""

    sized: ClassVar = {"lookahead_m": {"length": 1}}

    kind: Literal["pure_pursuit"] = "pure_pursuit"
    label: ClassVar = "pure pursuit"
    lookahead_s: NonNegative = 0.21
    """Increase of the look-ahead distance per speed [s]. Assumed value from tuning; manual tuning gives 0.3-2."""
    lookahead_m: Positive = 1.8
    """Speed-independent part of the look-ahead distance at or above `BRISK_M_S` [m]. Assumed value (range 0.6-2.4) from
    tuning; values below 1 cause oscillation with a worn valve."""
    prediction_s: Annotated[float, Field(ge=0, le=2)] = 0.46
    """Prediction time for the start of the arc [s]. Assumed value from tuning: about the steering delay plus lag."""
    approach_deg: Annotated[float, Field(gt=0, le=80)] = 25.0
    """Maximum angle of approach to a distant path [deg]. Assumed value (range 20-50); larger angles cause overshoot."""
    integral_per_m2: NonNegative = 0.012
    """Integral gain in forward travel [rad/m2]: steering angle divided by the integral of the cross-track error over
    the distance; 0 disables the integral. Assumed value (range 0-0.05) from tuning."""
    tunable: ClassVar = {
        "lookahead_s": (0.2, 3.0),
        "lookahead_m": (0.2, 3.0),
        "prediction_s": (0.0, 1.0),
        "integral_per_m2": (0.001, 0.05),
    }
    """Search ranges for tuning the gains."""

    def memory(self) -> PursuitState:
        """Return the initial state, with an integral of zero."""
        return PursuitState()

    def steering(
        self, memory: PursuitState, deviation: PathDeviation, situation: Situation, dt: float
    ) -> tuple[PursuitState, float]:
        """Return the new state and the steering angle [rad]: the angle of the arc to the goal plus the integral."""
        arc, e = self._arc(deviation, situation), situation.estimate
        if deviation.direction < 0:
            return memory, arc
        if e.aligned and abs(deviation.heading) < STEEP:
            near = clip(deviation.cross_track, -MAX_INTEGRATED_M, MAX_INTEGRATED_M)
            angle = memory.integral - self.integral_per_m2 * near * e.speed * dt
            memory = PursuitState(clip(angle, -MAX_STEER_BIAS, MAX_STEER_BIAS))
        return memory, arc + memory.integral

    def _arc(self, deviation: PathDeviation, situation: Situation) -> float:
        """Return the steering angle of the arc to the goal point [rad].

        The goal is on the path, or next to a distant path so that the approach angle is limited. Beyond the end of the
        leg the goal is on the straight extension of the leg.
        """
        e, m, route, end = situation.estimate, situation.machine, situation.route, deviation.leg[1]
        u, l_r = abs(e.speed), m.cg_to_rear_axle
        pace = max(u, route.ahead(deviation.place.s + self.lookahead_m).speed, SLOWEST_M_S)  # speed a little later
        predicted = e.speed * self.prediction_s
        reach = abs(predicted) + self.lookahead_m * min(sqrt(pace / BRISK_M_S), 1.0) + self.lookahead_s * u
        s = min(deviation.place.s + reach, end)
        goal, beta = route.ahead(s), sideslip(route, s, deviation.direction, deviation.leg, l_r)
        turn, far = e.yaw_rate * self.prediction_s, reach * tan(radians(self.approach_deg))
        beyond, pose = deviation.place.s + reach - s, (e.rear_x, e.rear_y, e.yaw)
        return _arc_to(deviation, goal, beta, beyond, far, pose, predicted, turn, l_r, m.wheelbase_m)


@stage
def _arc_to(
    deviation: PathDeviation, goal: PathPoint, beta: float, beyond: float, far: float,
    pose: tuple[float, float, float], predicted: float, turn: float, l_r: float, L: float,
) -> float:  # fmt: skip
    """Return the steering angle [rad] of the arc to a goal `beyond` [m] past a path point with sideslip `beta` [rad].
    The arc begins at the `pose` of the rear axle after travelling `predicted` [m] while turning by `turn` [rad]."""
    rear_x, rear_y, yaw = pose
    aside = deviation.cross_track - min(max(deviation.cross_track, -far), far)
    east, north = from_heading(goal.yaw, deviation.direction * beyond, aside)
    x, y = goal.x + east - l_r * cos(goal.yaw - beta), goal.y + north - l_r * sin(goal.yaw - beta)
    dx, dy = from_heading(yaw + turn / 2, predicted, 0.0)
    ahead, left = to_heading(yaw + turn, x - rear_x - dx, y - rear_y - dy)
    if ahead * deviation.direction < 0.0:  # goal opposite to the direction of travel: turn at the steering limit
        return copysign(deviation.limit, left)
    return atan(L * 2 * left / (ahead * ahead + left * left))
