"""Coverage of a plan without tracking errors: gaps and overlaps caused by the plan itself."""

import numpy as np
from shapely.geometry.base import BaseGeometry

from agrobot_mj.extensions.fields.boom import Boom, ImplementMotion, worked
from agrobot_mj.extensions.fields.coverage import FieldCoverage, coverage
from agrobot_mj.extensions.fields.plan import Plan


def planned_coverage(plan: Plan, whole: BaseGeometry, body: BaseGeometry, sections: int = 1) -> FieldCoverage:
    """Return the coverage of a plan that the tractor follows exactly with a rigidly mounted implement.

    `whole` is the field area, and `body` the area inside the headland laps.
    """
    motion, boom = planned_motion(plan), Boom(plan.width, sections)
    ground = [
        worked(motion, [span if span[1] > span[0] else None for span in one.sections], boom) for one in plan.passes
    ]
    return coverage(whole, body, [each for each in ground if not each.is_empty])


def planned_motion(plan: Plan) -> ImplementMotion:
    """Return the motion of a rigidly mounted implement if the tractor follows the plan with the heading of the course.

    Travelled distances [m] take the place of times. In a bend of radius R, the heading of a tractor differs from that
    of the course by about l_r / R, so that the implement moves further inside.
    """
    course = plan.course.divided()
    x, y, yaw = course.joints()
    s = course.distances()
    kept = np.concatenate(([True], np.diff(s) > 0))
    x, y, yaw, s = x[kept], y[kept], yaw[kept], s[kept]
    return ImplementMotion(s, x - plan.behind * np.cos(yaw), y - plan.behind * np.sin(yaw), yaw, s)
