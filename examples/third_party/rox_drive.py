"""Pure pursuit of rox-control, unmodified (PyPI rox-control 0.4.0, MIT), in a loop that steps the simulation.

python rox_drive.py straight_line --set path.speed_m_s=1.5

rox-control follows waypoints from the pose of the rear axle and returns a curvature, left positive. Its defaults are
for a very small robot. Therefore distances and gain are scaled to a tractor. The curvature for a point at the distance
D and the angle alpha to the heading is 2 sin(alpha) / D.
"""

import argparse
import json
import sys
from typing import Any

from rox_control.controllers.pure_pursuit_a import Controller
from rox_control.tools.bicicle_model import RobotState
from rox_control.track import Track

from agrobot_mj import Simulation
from agrobot_mj.cli.options import overrides
from agrobot_mj.core.signals import TICK_S

AHEAD_M, SPACING_M = 2.5, 0.5


def drive(scenario: str, keys: dict[str, Any], ahead: float = AHEAD_M) -> dict[str, Any]:
    """Simulate a scenario with rox-control, and return the metrics of the run. `ahead` is the look-ahead distance
    [m]."""
    sim = Simulation(scenario, keys)
    sim.reset()
    speed = sim.scenario.path.speed_m_s
    controller = Controller(ahead, velocity_vector_length=1.0, proportional_gain=2.0 / ahead, target_speed=speed)
    length = sim.scenario.ticks * TICK_S * speed + 2 * ahead
    places = [sim.path.ahead(k * SPACING_M) for k in range(round(length / SPACING_M))]
    controller.set_track(Track([(place.x, place.y) for place in places]))
    while not sim.done:
        e = sim.estimate
        answer = controller.control(RobotState(e.rear_x, e.rear_y, e.yaw, e.speed))
        sim.step(curvature=float(answer.curvature), speed=answer.velocity)
    return sim.log().metrics


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--set", action="append", default=[], dest="sets")
    arguments = parser.parse_args()
    json.dump(drive(arguments.scenario, overrides(arguments.sets)), sys.stdout, indent=1)
