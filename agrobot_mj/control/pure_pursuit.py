"""Pure pursuit: the arc that leads the rear axle to a point of its path ahead.

With the goal (a, b) in the frame of the heading, seen from the rear axle R:  kappa = 2 b / (a^2 + b^2), delta =
atan(L kappa). The goal lies on the path that R takes while the CG is on the given one, at a distance that grows with
the speed; in reverse it lies behind, and the same equation holds. Source: [Coulter1992], [Snider2009].

Seen not from where R is but from where it will be when the steering has answered, `prediction_s` later at the present
yaw rate: the steering's delay and lag would else make it weave at speed.

Works on any path, forward and in reverse, without tuning beyond the distance: corners of the curvature are cut by
about the square of the distance over eight radii, and with a distance too short for the lag that the prediction leaves
the tractor weaves. A side slope, a steering error or a valve's dead band would leave an offset: forward, and not at
a steep angle, an integral of the cross-track error over the way takes it away, as that of the AgOpenGPS family does.
"""

from math import atan, copysign, cos, radians, sin, sqrt, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import SLOWEST_M_S, Situation
from agrobot_mj.control.following import LARGEST_BIAS, STEEP, Beside, Integrating, sideslip
from agrobot_mj.control.pid import clip
from agrobot_mj.core.geometry import from_heading, to_heading
from agrobot_mj.core.spec import NonNegative, Positive

BRISK_M_S = 1.2
"""Speed below which a shorter look-ahead does [m/s]: the valve has more time a metre, and the line is reached sooner.
Assumed value, that of the paper."""


BESIDE_M = 0.1
"""Largest cross-track error that the integral takes for one that rests, not for the way to the path [m]. Assumed
value."""


class PursuitState(NamedTuple):
    """Memory of `PurePursuit`."""

    integral: float = 0.0
    """Angle beside that of the arc [rad]."""


class PurePursuit(Integrating):
    """Pure pursuit at the rear axle."""

    sized: ClassVar = {"lookahead_m": {"length": 1}}

    kind: Literal["pure_pursuit"] = "pure_pursuit"
    label: ClassVar = "pure pursuit"
    lookahead_s: NonNegative = 0.21
    """Look-ahead distance over speed [s]. Assumed value (0.3-2 by hand), searched."""
    lookahead_m: Positive = 1.8
    """Part of the look-ahead distance that does not grow with the speed, from `BRISK_M_S` on [m]. Assumed value
    (0.6-2.4), searched; below 1 it weaves on a worn valve."""
    prediction_s: Annotated[float, Field(ge=0, le=2)] = 0.46
    """Time ahead at which the arc begins [s]. Assumed value: searched; delay and lag of the steering."""
    approach_deg: Annotated[float, Field(gt=0, le=80)] = 25.0
    """Largest angle at which it heads for a path far away [deg]. Assumed value (20-50): from steeper ones it swings
    over."""
    integral_per_m2: NonNegative = 0.012
    """Steering angle per cross-track error and way beside the path, forward [rad/m2]; 0: none. Assumed value (0-0.05),
    searched."""
    tunable: ClassVar = {
        "lookahead_s": (0.2, 3.0),
        "lookahead_m": (0.2, 3.0),
        "prediction_s": (0.0, 1.0),
        "integral_per_m2": (0.001, 0.05),
    }
    """Ranges in which the gains are sought."""

    def memory(self) -> PursuitState:
        """No offset known."""
        return PursuitState()

    def steering(
        self, memory: PursuitState, beside: Beside, situation: Situation, dt: float
    ) -> tuple[PursuitState, float]:
        """The arc to the goal, and the integral."""
        arc, e = self._arc(beside, situation), situation.estimate
        if beside.direction < 0:
            return memory, arc
        if e.aligned and abs(beside.heading) < STEEP:
            near = clip(beside.cross_track, -BESIDE_M, BESIDE_M)
            angle = memory.integral - self.integral_per_m2 * near * e.speed * dt
            memory = PursuitState(clip(angle, -LARGEST_BIAS, LARGEST_BIAS))
        return memory, arc + memory.integral

    def _arc(self, beside: Beside, situation: Situation) -> float:
        """Steering angle of the arc to the goal [rad]."""
        e, L = situation.estimate, situation.machine.wheelbase_m
        way, turn = e.speed * self.prediction_s, e.yaw_rate * self.prediction_s
        dx, dy = from_heading(e.yaw + turn / 2, way, 0.0)
        x, y = self._goal(beside, abs(way), situation)
        ahead, left = to_heading(e.yaw + turn, x - e.rear_x - dx, y - e.rear_y - dy)
        if ahead * beside.direction < 0.0:  # the goal is where it comes from: turn as tightly as it goes
            return copysign(beside.limit, left)
        return atan(L * 2 * left / (ahead**2 + left**2))

    def _goal(self, beside: Beside, way: float, situation: Situation) -> tuple[float, float]:
        """Goal of the rear axle [m], from `way` [m] on: on its path, or, far from it, beside that on the way there.

        Straight on beyond the end of the leg.
        """
        l_r, route, end = situation.machine.cg_to_rear_axle, situation.route, beside.leg[1]
        u = abs(situation.estimate.speed)
        pace = max(u, route.ahead(beside.place.s + self.lookahead_m).speed, SLOWEST_M_S)  # where it soon will be
        reach = way + self.lookahead_m * min(sqrt(pace / BRISK_M_S), 1.0) + self.lookahead_s * u
        far = reach * tan(radians(self.approach_deg))
        s = min(beside.place.s + reach, end)
        goal, beta = route.ahead(s), sideslip(route, s, beside.direction, beside.leg, l_r)
        psi = goal.yaw - beta
        aside = beside.cross_track - clip(beside.cross_track, -far, far)
        dx, dy = from_heading(goal.yaw, beside.direction * (beside.place.s + reach - s), aside)
        return goal.x + dx - l_r * cos(psi), goal.y + dy - l_r * sin(psi)
