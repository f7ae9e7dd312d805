"""Machine data for the planner: outlines of the tractor and the implement, and limits of bends."""

from dataclasses import dataclass
from itertools import accumulate, groupby
from typing import cast

import numpy as np
import shapely

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.planner.words import Bends
from agrobot_mj.paths import Swaths
from agrobot_mj.paths.track import Course
from agrobot_mj.scenario.schema import Scenario

MAX_CURVATURE_FRACTION = 0.95
"""Fraction of the machine's curvature limit that plans may use [-]. Assumed value: 5 % remain for feedback control."""
BAR_M = 0.1  # Half of the length of the implement outline in the direction of travel [m]


@dataclass(frozen=True)
class FieldMachine:
    """Dimensions and turn limits of a tractor with its implement. Distances are relative to the CG of the tractor."""

    width: float  # Working width of the implement [m]
    behind: float  # Distance of the working point of the implement behind the CG on a straight line [m]
    front: float  # Distance of the front end of the tractor ahead of the CG [m]
    rear: float  # Distance of the rear end of the tractor behind the CG [m]
    half_width: float  # Half of the width of the tractor [m], including the tyres
    cg_to_rear_axle: float  # Distance of the rear axle behind the CG [m]
    tightest: float  # Minimum turn radius of the CG [m]
    path: Swaths  # Path whose keys define the bends of the machine: radius, speed and steering rate
    overlap: float = 0.0  # Planned overlap between neighbouring passes [m]
    forward_only: bool = False
    """Whether plans contain no reverse segments, on request or for an implement behind a pin, which would jackknife."""

    @property
    def spacing(self) -> float:
        """Distance between adjacent passes [m]."""
        return self.width - self.overlap

    @property
    def bends(self) -> Bends:
        """Radius, sharpness and speed of the bends in turns and in connections between passes."""
        speed = self.path.turn_speed_m_s
        return Bends(self.path.turn_radius_m, self.path.sharpness(speed), speed)

    @property
    def max_curvature(self) -> float:
        """Maximum permitted curvature of a plan [1/m]."""
        return MAX_CURVATURE_FRACTION / self.tightest


def tractor_poses(course: Course, cg_to_rear_axle: float) -> tuple[Array, Array, Array]:
    """Return x [m], y [m] and yaw [rad] of the CG at the joints of a divided course, shape (segments + 1,) each.

    The rear axle rolls without sideslip. In bends, the tractor therefore has another heading than the course of the CG.
    """
    x, y, yaw = course.joints()
    return x, y, yaw - _sideslip(course, cg_to_rear_axle) if cg_to_rear_axle else yaw


def _sideslip(course: Course, length: float) -> Array:
    """Return the sideslip of the CG [rad] at each joint of a divided course, shape (segments + 1,).

    The sideslip beta of a point `length` [m] ahead of an axle without sideslip follows d(beta)/ds = kappa - sin(beta) /
    length (see `control.following`), where s increases in the forward direction of the tractor. Reverse segments are
    therefore evaluated from their end, so that the sideslip may change where reversing begins.
    """
    steady = np.arcsin(np.clip(length * (course.curvatures + course.ends) / 2, -0.95, 0.95)).tolist()
    kept = np.exp(-course.lengths / length).tolist()
    found, first = [0.0], 0
    for direction, leg in groupby(course.directions.tolist()):
        last = first + len(list(leg))
        steps = list(zip(steady[first:last], kept[first:last], strict=True))
        if direction > 0:
            found += _first_order_lag(steps, found[-1])[1:]
        else:
            found += _first_order_lag(steps[::-1], steps[-1][0])[-2::-1]
        first = last
    return np.array(found)


def _first_order_lag(steps: list[tuple[float, float]], initial: float) -> list[float]:
    """Return the values of a first-order lag before and after each step, which is given by its steady-state value and
    the fraction of the difference that remains."""
    return list(accumulate(steps, lambda value, step: step[0] + step[1] * (value - step[0]), initial=initial))


def tractor_boxes(rig: FieldMachine, x: Array, y: Array, yaw: Array) -> Array:
    """Return the outlines of the tractor at n CG poses, as polygons (n,)."""
    return _boxes(x, y, yaw, rig.front, -rig.rear, rig.half_width)


def implement_boxes(rig: FieldMachine, x: Array, y: Array, yaw: Array) -> Array:
    """Return the outlines of the implement at n poses of its working point, as polygons (n,)."""
    return _boxes(x, y, yaw, BAR_M, -BAR_M, rig.width / 2)


def _boxes(x: Array, y: Array, yaw: Array, front: float, rear: float, side: float) -> Array:
    """Return a rectangle at each of n poses, as polygons (n,). `front`, `rear` and `side` are coordinates of the edges
    relative to the pose [m], positive ahead and to the left."""
    ahead, left = np.array([front, rear, rear, front]), np.array([side, side, -side, -side])
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    corners = np.stack([x[:, None] + c * ahead - s * left, y[:, None] + s * ahead + c * left], axis=2)
    found: Array = shapely.polygons(corners)
    return found


def rig_of(scenario: Scenario, width: float, overlap: float = 0.0, forward_only: bool = False) -> FieldMachine:
    """Return the dimensions and turn limits of the machine in a scenario whose path has the kind `swaths`.

    Raise `ScenarioError` for another kind of path, or if the turn radius is too small for the machine.
    """
    tractor, path = scenario.tractor, scenario.path
    if not isinstance(path, Swaths):
        raise ScenarioError(
            f'path.kind: "{path.kind}" has no effect, because the field determines the path; omit the key'
        )
    if path.turn_radius_m * MAX_CURVATURE_FRACTION < tractor.tightest_radius:
        raise ScenarioError(
            f"--radius {path.turn_radius_m:g}: the machine {scenario.machine} has a minimum radius of "
            f"{tractor.tightest_radius / MAX_CURVATURE_FRACTION:.2f} m; set a larger radius"
        )
    return outline_of(scenario, width, overlap, forward_only)


def outline_of(scenario: Scenario, width: float, overlap: float = 0.0, forward_only: bool = False) -> FieldMachine:
    """Return the dimensions and turn limits of the machine in a scenario with any kind of path."""
    tractor = scenario.tractor
    hitched = scenario.implement.hitched(tractor)
    hitch = tractor.cg_to_rear_axle + tractor.hitch_behind_m
    return FieldMachine(
        width=width,
        behind=hitch - hitched.point[0] if hitched else hitch,
        front=tractor.cg_to_front_axle + tractor.front_wheel_radius_m,
        rear=tractor.cg_to_rear_axle + max(tractor.rear_wheel_radius_m, tractor.hitch_behind_m),
        half_width=(tractor.track_m + max(tractor.front_wheel_width_m, tractor.rear_wheel_width_m)) / 2,
        cg_to_rear_axle=tractor.cg_to_rear_axle,
        tightest=tractor.tightest_radius,
        path=cast(Swaths, scenario.path),
        overlap=overlap,
        forward_only=forward_only or scenario.implement.towed(tractor).length > 0.0,
    )
