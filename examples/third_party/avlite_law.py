"""Guidance law with the steering controllers of AVLite, unmodified (PyPI avlite 0.6.6, MIT).

agrobot-mj run side_slope_10 --plugin avlite_law.py --set guidance.kind=avlite --set guidance.law=pure_pursuit

AVLite follows a list of points from the pose of the rear axle. The speed is the speed of the path. Vehicle data and
gains are attributes of the controllers, with defaults for a car.
"""

from typing import Annotated, Any, Literal

import numpy as np
from avlite.c10_perception.c11_perception_model import EgoState
from avlite.c30_control.c34_stanley import StanleyController
from avlite.c30_control.c35_pure_pursuit import PurePursuitController
from avlite.c50_common.c54_trajectory_tracker import TrajectoryTracker
from pydantic import Field

from agrobot_mj.control import GuidanceLaw, Situation
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.signals import Command
from agrobot_mj.core.spec import Positive


class AvliteLaw(GuidanceLaw):
    """Guidance law with a steering controller of AVLite."""

    kind: Literal["avlite"] = "avlite"
    law: Literal["stanley", "pure_pursuit"] = "stanley"
    """Name of the AVLite steering controller."""
    gain_per_s: Positive = 5.0
    """Gain of Stanley [1/s]. Default: the default of AVLite."""
    ahead_m: Positive = 8.0
    """Look-ahead distance of pure pursuit [m]. Default: the default of AVLite."""
    path_m: Positive = 150.0
    """Length of the path passed to AVLite [m]. Assumed value: longer than a run."""
    spacing_m: Annotated[float, Field(gt=0.01, le=5)] = 0.5
    """Distance between points of the path passed to AVLite [m]. Assumed value."""

    def update(self, state: Any, situation: Situation, dt: float) -> tuple[Any, Command]:
        """Return the AVLite controller, which is created in the first tick, and the command."""
        controller = self._controller(situation) if state is None else state
        e, r = situation.estimate, situation.reference
        ego = EgoState(x=e.rear_x, y=e.rear_y, theta=e.yaw, velocity=e.speed)
        steer = float(controller.control(ego, control_dt=dt).steer)
        return controller, Command(steer, to_heading(r.yaw, r.vx, r.vy)[0])

    def _controller(self, situation: Situation) -> Any:
        """Return an AVLite controller for the machine and path of a situation."""
        places = [situation.route.ahead(s) for s in np.arange(0.0, self.path_m, self.spacing_m).tolist()]
        path = TrajectoryTracker(path=[(p.x, p.y) for p in places], velocity=[abs(p.speed) for p in places])
        controller = (StanleyController if self.law == "stanley" else PurePursuitController)(path)
        controller.k, controller.lookahead_distance = self.gain_per_s, self.ahead_m
        controller.ego_distance_front_axle = situation.machine.wheelbase_m
        controller.ego_max_steering = situation.machine.steer_limit
        controller.ego_min_steering = -situation.machine.steer_limit
        return controller
