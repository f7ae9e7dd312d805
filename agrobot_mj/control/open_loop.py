"""Open-loop controller with a step of the steering angle, for tests of the plant."""

from math import radians
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from agrobot_mj.control.base import YawCommand, YawController
from agrobot_mj.control.pid import clip
from agrobot_mj.core.spec import NonNegative


class OpenLoop(YawController):
    """Open-loop controller that commands a step of the steering angle."""

    kind: Literal["open_loop"] = "open_loop"
    label: ClassVar = "open loop"
    closed_loop: ClassVar[bool] = False
    """Always False, because the controller ignores the yaw rate."""
    steer_deg: Annotated[float, Field(ge=-60, le=60)] = 5.0
    """Steering angle of the step [deg], positive to the left. Assumed value, limited by the steering stops."""
    at_s: NonNegative = 1.0
    """Time of the step [s]. Assumed value; any time is possible."""

    def init(self) -> None:
        """Return None, because the open-loop controller has no state."""

    def update(
        self, state: None, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[None, YawCommand]:
        """Return None as the state, and the steering command at time `t` [s], which is zero before the time `at_s`."""
        steer = radians(self.steer_deg) if t >= self.at_s else 0.0
        return None, YawCommand(clip(steer, -steer_limit, steer_limit))
