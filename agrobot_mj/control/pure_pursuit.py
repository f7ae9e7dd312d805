"""Pure pursuit: the arc that leads the rear axle to a point of its path ahead.

With the goal (a, b) in the frame of the heading, seen from the rear axle R:  kappa = 2 b / (a^2 + b^2), delta =
atan(L kappa). The goal lies on the path that R takes while the CG is on the given one, at a distance that grows with
the speed; in reverse it lies behind, and the same equation holds. Source: [Coulter1992], [Snider2009].

Works on any path, forward and in reverse, without tuning beyond the distance. There is no integral: a side slope or a
steering error leaves an offset, and corners of the curvature are cut by about the square of the distance over eight
radii. Below about three steering lags times the speed the distance is too short, and the tractor weaves.
"""

from math import atan, cos, sin
from typing import ClassVar, Literal

from agrobot_mj.control.base import Situation
from agrobot_mj.control.following import Beside, Following, sideslip
from agrobot_mj.core.geometry import from_heading, to_heading
from agrobot_mj.core.spec import NonNegative, Positive


class PurePursuit(Following):
    """Pure pursuit at the rear axle."""

    kind: Literal["pure_pursuit"] = "pure_pursuit"
    lookahead_s: NonNegative = 1.0
    """Look-ahead distance over speed [s]. Estimate: three times delay and lag of the steering."""
    lookahead_m: Positive = 1.5
    """Look-ahead distance at rest [m]. Estimate: weaves on a worn valve below 1 m."""
    tunable: ClassVar = {"lookahead_s": (0.2, 3.0), "lookahead_m": (0.2, 2.0)}
    """Ranges in which the gains are sought."""

    def steering(self, memory: None, beside: Beside, situation: Situation, dt: float) -> tuple[None, float]:
        """The arc to the goal."""
        e, L = situation.estimate, situation.machine.wheelbase_m
        x, y = self._goal(beside, situation)
        ahead, left = to_heading(e.yaw, x - e.rear_x, y - e.rear_y)
        return None, atan(L * 2 * left / (ahead**2 + left**2))

    def _goal(self, beside: Beside, situation: Situation) -> tuple[float, float]:
        """Point on the path of the rear axle [m]; straight on beyond the end of the leg."""
        l_r, route, end = situation.machine.cg_to_rear_axle, situation.route, beside.leg[1]
        reach = self.lookahead_m + self.lookahead_s * abs(situation.estimate.speed)
        s = min(beside.place.s + reach, end)
        goal, beta = route.ahead(s), sideslip(route, s, beside.direction, beside.leg, l_r)
        beyond, _ = beside.direction * (beside.place.s + reach - s), 0
        psi = goal.yaw - beta
        dx, dy = from_heading(goal.yaw, beyond, 0.0)
        return goal.x + dx - l_r * cos(psi), goal.y + dy - l_r * sin(psi)
