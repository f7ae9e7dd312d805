"""Coverage of a plan without tracking errors: gaps and overlaps caused by the plan itself."""

import numpy as np
from shapely.geometry.base import BaseGeometry

from agrobot_mj.extensions.fields.boom import Boom, ImplementMotion, worked_area
from agrobot_mj.extensions.fields.coverage import FieldCoverage, coverage
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.extensions.fields.planner.rig import tractor_poses


def planned_coverage(plan: Plan, whole: BaseGeometry, body: BaseGeometry) -> FieldCoverage:
    """Return the coverage of a plan if the tractor with a rigidly mounted implement follows it exactly.

    `whole` is the field area, and `body` the area inside the headland laps.
    """
    motion, boom = planned_motion(plan), Boom(plan.width, plan.sections)
    ground = [
        worked_area(motion, [span if span[1] > span[0] else None for span in one.sections], boom) for one in plan.passes
    ]
    return coverage(whole, body, [each for each in ground if not each.is_empty])


def planned_motion(plan: Plan) -> ImplementMotion:
    """Return the motion of a rigidly mounted implement if the CG follows the plan exactly.

    Travelled distances [m] take the place of times.
    """
    course = plan.course.divided()
    x, y, yaw = tractor_poses(course, plan.cg_to_rear_axle)
    s = course.distances()
    kept = np.concatenate(([True], np.diff(s) > 0))
    x, y, yaw, s = x[kept], y[kept], yaw[kept], s[kept]
    return ImplementMotion(s, x - plan.behind * np.cos(yaw), y - plan.behind * np.sin(yaw), yaw, s)
