"""Crab angle across a side slope

The tractor is steered along the contour on a straight course. The tractor crabs: its heading points uphill of its
course. Two angles are measured. The *crab angle of the heading* is the slip angle of the rear wheels. The *mean crab
angle* is the mean angle of the front and rear wheels to the course, weighted by cornering stiffness.

Crab angle of the heading: the rear axle carries the fraction of m g sin(theta) given by the yaw balance, about l_f / L.
Rolling resistance, larger on the lower wheels, and the pneumatic trails shift some of the side force to the front axle.

Mean crab angle: both side forces always sum to m g sin(theta), so that in the linear range the mean angle is m g
sin(theta) / (C_f + C_r). Acceptance limits apply if the tyre force at this slip is within 3 % of its tangent at zero
slip. Due to understeer, the angle is below the mean for the rear wheels and above for the front wheels.
"""

from collections.abc import Iterator
from math import atan, cos, degrees, radians, sin, tan
from typing import Any

from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, tyres
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants.driver import Driver, track_course
from agrobot_mj.terrain import Slope

GRADES_DEG = (2.0, 5.0, 10.0, 15.0)
SPEED_M_S = 1.2
BAND = 0.05
LINEAR_SHARE = 0.97
"""Minimum ratio of the tyre force to its tangent at zero slip in the linear range [-]."""


def traverse(driver: Driver, grade_deg: float, seconds: float) -> tuple[float, float]:
    """Return the angles of the rear and front wheels to the course [deg], in the ground plane and positive uphill."""
    trace = driver.go(seconds, track_course())
    heading = atan(tan(trace.mean("yaw", 3.0)) / cos(radians(grade_deg)))
    return degrees(heading), degrees(heading + trace.mean("steer", 3.0))


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the crab angles on side slopes with every tyre. Quick mode omits the slope of 10 degrees."""
    for tyre in tyres():
        for grade in GRADES_DEG:
            if m.quick and grade == 10.0:
                continue
            plant, truth = m.mujoco(tyre, Slope(grade_deg=grade, direction_deg=90.0))
            rear, front = traverse(Driver(plant, truth, SPEED_M_S), grade, 30.0)
            m.curves.setdefault(tyre.kind, []).append((grade, rear))
            yield from _against(m, tyre, grade, rear, front)


def _against(m: Trial, tyre: Any, grade: float, rear: float, front: float) -> list[Check]:
    heading = m.about(f"crab angle of the heading, {grade:g} deg", tyre.kind, "deg")
    mean = m.about(f"mean crab angle, {grade:g} deg", tyre.kind, "deg")
    if not tyre.judged:
        return [heading.reported(rear), mean.reported((rear + front) / 2)]
    paper = Tractor(tyre=tyre)
    C_f, C_r = paper.axle_stiffness
    share = linear_slip(paper, grade)
    return [
        heading.near(rear, degrees(paper.side_slope(grade).rear_slip), BAND),
        mean.near((C_f * front + C_r * rear) / (C_f + C_r), degrees(share), BAND).judged(in_linear_range(paper, share)),
    ]


def linear_slip(paper: Tractor, grade_deg: float) -> float:
    """Return the mean slip angle at which linear tyres support the tractor on a side slope [rad]."""
    return paper.p.mass_kg * GRAVITY * sin(radians(grade_deg)) / sum(paper.axle_stiffness)


def in_linear_range(paper: Tractor, slip: float) -> bool:
    """Return whether the tyres of both axles are in their linear range at a slip angle [rad]."""
    C_f, C_r = paper.axle_stiffness
    forces = [(paper.lateral(i, slip, paper.static(i)), C / 2 * slip) for i, C in ((0, C_f), (2, C_r))]
    return all(force > LINEAR_SHARE * tangent for force, tangent in forces)
