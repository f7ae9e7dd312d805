"""A guidance law: the path's own steering angle, less two gains times offset and heading error. Forward only."""

from math import atan
from typing import Literal

from agrobot_mj.control import GuidanceLaw, Situation
from agrobot_mj.control.pid import clip
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Command
from agrobot_mj.core.spec import Positive


class TwoGains(GuidanceLaw):
    """Steering in proportion to the offset from the path and to the heading error; `guidance.kind = "two_gains"`."""

    kind: Literal["two_gains"] = "two_gains"
    offset_gain_rad_m: Positive = 0.3
    """Steering angle per offset [rad/m]. Estimate (0.1-0.5)."""
    heading_gain: Positive = 0.9
    """Steering angle per heading error [-]. Estimate (0.5-1.5)."""

    def init(self) -> float:
        """Distance of the nearest point along the path: its start [m]."""
        return 0.0

    def update(self, state: float, situation: Situation, dt: float) -> tuple[float, Command]:
        """Distance of the nearest point along the path [m], and the command."""
        e, machine = situation.estimate, situation.machine
        place = situation.route.nearest(e.x, e.y, state, situation.t)
        error = self.offset_gain_rad_m * place.offset + self.heading_gain * wrap(e.yaw - place.yaw)
        steer = clip(atan(machine.wheelbase_m * place.curvature) - error, -machine.steer_limit, machine.steer_limit)
        return place.s, Command(steer, max(place.speed, 0.3))
