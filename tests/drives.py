"""Kinematic tractor with a steering lag, and paths for driving forward and in reverse, for tests of guidance laws."""

from math import cos, exp, sin, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.control.base import GuidanceLaw, Situation
from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.signals import TICK_S, Command, Estimate, Reference
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.paths.arc import Pose, advance
from agrobot_mj.paths.route import SampledRoute

MACHINE = TractorParameters()


class Bend:
    """Straight line followed by an arc, forward or in reverse, at constant speed."""

    def __init__(self, speed: float = 1.2, curvature: float = 0.0, straight_m: float = 5.0) -> None:
        self.speed, self.curvature, self.straight = speed, curvature, straight_m
        self.speed_m_s, self.duration_s, self.turns_s, self.max_curvature = abs(speed), 120.0, (), abs(curvature)

    def at(self, t: float) -> Reference:
        """Return the reference at the time `t` [s]. Its heading is the heading of the tractor, so that in reverse the
        velocity is opposite to the heading."""
        way = self.speed * max(t, 0.0)  # distance along the heading
        on_straight = min(max(way, -self.straight), self.straight)
        pose = advance(Pose(0.0, 0.0, 0.3), 0.0, on_straight)
        kappa = self.curvature if abs(way) > self.straight else 0.0
        pose = advance(pose, kappa, way - on_straight)
        vx, vy = from_heading(pose.yaw, self.speed if t >= 0 else 0.0, 0.0)
        return Reference(pose.x, pose.y, vx, vy, wrap(pose.yaw), kappa)


class Drive(NamedTuple):
    """Results of a drive, one value per tick."""

    offset: np.ndarray  # Offset of the CG from the path, left of the heading positive [m]
    commands: list[Command]
    reports: list[tuple[float, ...]]
    steer: np.ndarray


def drive(
    law: GuidanceLaw,
    path,
    seconds: float = 40.0,
    offset: float = 0.0,
    heading: float = 0.0,
    bias: float = 0.0,
    lag: float = 0.2,
    known_bias: float = float("nan"),
) -> Drive:
    """Simulate a bicycle without slip that starts `offset` [m] left of the path with the heading error `heading` [rad].

    The wheel angle is `bias` [rad] to the right of the angle that the sensor measures.
    """
    route, m = SampledRoute(path), MACHINE
    start = path.at(0.0)
    psi = start.yaw + heading
    x, y = start.x - sin(start.yaw) * offset, start.y + cos(start.yaw) * offset
    rx, ry = x - m.cg_to_rear_axle * cos(psi), y - m.cg_to_rear_axle * sin(psi)
    u, delta, state = 0.0, 0.0, law.init()
    seen, s = [], 0.0
    for k in range(round(seconds / TICK_S)):
        t = k * TICK_S
        x, y = rx + m.cg_to_rear_axle * cos(psi), ry + m.cg_to_rear_axle * sin(psi)
        rate = u * tan(delta - bias) / m.wheelbase_m
        estimate = Estimate(x, y, wrap(psi), u, rate, rx, ry, np.eye(3) * 1e-4, steer_bias=known_bias)
        place = route.nearest(x, y, s, t)
        s = place.s
        state, command = law.update(state, Situation(t, estimate, path.at(t), route, m, delta), TICK_S)
        seen.append((place.offset, command, tuple(law.report(state)), delta))
        for _ in range(10):
            dt = TICK_S / 10
            delta += (command.steer - delta) * (1 - exp(-dt / lag))
            u += (command.speed - u) * (1 - exp(-dt / 0.3))
            rx, ry = rx + u * cos(psi) * dt, ry + u * sin(psi) * dt
            psi += u * tan(delta - bias) / m.wheelbase_m * dt
    offsets, commands, reports, steer = zip(*seen, strict=True)
    return Drive(np.array(offsets), list(commands), list(reports), np.array(steer))
