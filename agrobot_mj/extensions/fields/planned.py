"""Coverage of a plan without tracking errors: gaps and overlaps caused by the plan itself."""

from itertools import accumulate

import numpy as np
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.boom import Boom, ImplementMotion, worked
from agrobot_mj.extensions.fields.coverage import FieldCoverage, coverage
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.paths.track import Course


def planned_coverage(plan: Plan, whole: BaseGeometry, body: BaseGeometry, sections: int = 1) -> FieldCoverage:
    """Return the coverage of a plan if the tractor with a rigidly mounted implement follows it exactly.

    `whole` is the field area, and `body` the area inside the headland laps.
    """
    motion, boom = planned_motion(plan), Boom(plan.width, sections)
    ground = [
        worked(motion, [span if span[1] > span[0] else None for span in one.sections], boom) for one in plan.passes
    ]
    return coverage(whole, body, [each for each in ground if not each.is_empty])


def planned_motion(plan: Plan, cg_to_rear_axle: float = 0.0) -> ImplementMotion:
    """Return the motion of a rigidly mounted implement if the CG follows the plan exactly.

    Travelled distances [m] take the place of times. The rear axle, at the distance `cg_to_rear_axle` [m] behind the CG,
    rolls without sideslip. If this distance is 0, the tractor has the heading of the course.
    """
    course = plan.course.divided()
    x, y, yaw = course.joints()
    if cg_to_rear_axle:
        yaw = yaw - _sideslip(course, cg_to_rear_axle)
    s = course.distances()
    kept = np.concatenate(([True], np.diff(s) > 0))
    x, y, yaw, s = x[kept], y[kept], yaw[kept], s[kept]
    return ImplementMotion(s, x - plan.behind * np.cos(yaw), y - plan.behind * np.sin(yaw), yaw, s)


def _sideslip(course: Course, length: float) -> Array:
    """Return the sideslip of the CG [rad] at each joint of a course in forward travel, shape (segments + 1,).

    The sideslip beta of a point `length` [m] ahead of an axle without sideslip follows d(beta)/ds = kappa - sin(beta) /
    length (see `control.following`).
    """
    steady = np.arcsin(np.clip(length * (course.curvatures + course.ends) / 2, -0.95, 0.95))
    kept = np.exp(-course.lengths / length)
    steps = zip(steady.tolist(), kept.tolist(), strict=True)
    return np.array(list(accumulate(steps, lambda beta, step: step[0] + step[1] * (beta - step[0]), initial=0.0)))
