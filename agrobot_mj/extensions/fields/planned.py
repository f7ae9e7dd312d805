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
    course = plan.course.divided()
    x, y, yaw = course.joints()
    s = course.distances()
    kept = np.concatenate(([True], np.diff(s) > 0))
    x, y, yaw, s = x[kept], y[kept], yaw[kept], s[kept]
    motion = ImplementMotion(s, x - plan.behind * np.cos(yaw), y - plan.behind * np.sin(yaw), yaw, s)
    boom = Boom(plan.width, sections)
    ground = [
        worked(motion, [span if span[1] > span[0] else None for span in one.sections], boom) for one in plan.passes
    ]
    return coverage(whole, body, [each for each in ground if not each.is_empty])
