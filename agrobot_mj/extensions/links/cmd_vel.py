"""Guidance by velocity commands as on the ROS 2 topic /cmd_vel: forward speed v and yaw rate omega.

The steering angle follows from the bicycle model with wheelbase L, tan(delta) = L omega / v. Tractors cannot turn on
the spot. Therefore the steering angle is constant below `least_speed_m_s`. An external program computes the commands
(`agrobot-mj ros2`). This module defines the scenario keys and the behaviour without commands.
"""

from collections.abc import Sequence
from math import atan, inf, nan
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import GuidanceLaw, Situation
from agrobot_mj.control.pid import clip
from agrobot_mj.core.signals import Column, Command
from agrobot_mj.core.spec import Positive


class VelocityRequest(NamedTuple):
    """Last velocity command on /cmd_vel."""

    speed: float = nan  # Velocity along the heading (`linear.x`), negative in reverse [m/s]
    yaw_rate: float = nan  # Yaw rate (`angular.z`), left positive [rad/s]
    age: float = inf  # Time since the command arrived [s]


class CmdVel(GuidanceLaw):
    """Guidance by speed and yaw rate commands of an external program, with the command `agrobot-mj ros2`."""

    kind: Literal["cmd_vel"] = "cmd_vel"
    timeout_s: Positive = 0.5
    """Time after which a command expires and the tractor stops [s]. Default of the ROS 2 diff_drive_controller."""
    least_speed_m_s: Positive = 0.05
    """Commanded speed below which the steering angle is constant [m/s]. Assumed value (range 0.02-0.2): 1 % of the top
    speed."""
    give_up_s: Positive = 10.0
    """Time without commands after which the run ends [s]. Assumed value (range 3-60): enough for a restart of the
    node."""
    origin_lat_deg: Annotated[float, Field(ge=-85, le=85)] = 50.877
    """Latitude of the map origin x = y = 0 [deg]."""
    origin_lon_deg: Annotated[float, Field(ge=-180, le=180)] = 4.699
    """Longitude of the map origin x = y = 0 [deg]."""

    @property
    def follows_path(self) -> bool:
        """Whether the law follows the scenario path. False, because the program follows its own path."""
        return False

    @property
    def outside(self) -> str:
        """Name of the command that runs scenarios with this guidance."""
        return "ros2"

    def init(self) -> VelocityRequest:
        """Return the state of the guidance before the first velocity command."""
        return VelocityRequest()

    def update(self, state: VelocityRequest, situation: Situation, dt: float) -> tuple[VelocityRequest, Command]:
        """Return the tractor command for the velocity request in `state`. The tractor stops if the request has expired.

        At standstill the pedal is in neutral, because the speed loop would overshoot and roll backwards.
        """
        if not state.age < self.timeout_s or state.speed == 0.0:
            return state, Command(situation.steer, 0.0, pedal=0.0)
        if abs(state.speed) < self.least_speed_m_s:
            return state, Command(situation.steer, state.speed)
        limit = situation.machine.steer_limit
        steer = atan(situation.machine.wheelbase_m * state.yaw_rate / state.speed)
        return state, Command(clip(steer, -limit, limit), state.speed)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the received velocity commands: speed, yaw rate, and time since the last command."""
        return (
            Column("cmd_speed", "m/s", "speed requested on /cmd_vel; null before the first request"),
            Column("cmd_yaw_rate", "rad/s", "yaw rate requested on /cmd_vel; null before the first request"),
            Column("cmd_age", "s", "time since the latest request; null before the first request"),
        )

    def report(self, state: VelocityRequest) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        return state.speed, state.yaw_rate, state.age if state.age < inf else nan
