"""Fields and machines for tests of field work."""

from functools import cache

from shapely import Polygon

from agrobot_mj.extensions.fields.drive import planning_scenario
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.planner.planning import Options, make_plan
from agrobot_mj.extensions.fields.planner.rig import rig_of

RECTANGLE = Field("rectangle", Polygon([(0, 0), (60, 0), (60, 40), (0, 40)]))
L_SHAPE = Field("l_shape", Polygon([(0, 0), (90, 0), (90, 40), (45, 40), (45, 80), (0, 80)]))
HOLE = Field("hole", Polygon([(0, 0), (90, 0), (90, 80), (0, 80)], [[(38, 35), (50, 35), (50, 45), (38, 45)]]))
SLANTED = Field("slanted", Polygon([(0, 0), (80, 0), (60, 50), (10, 50)]))
FIELDS = (RECTANGLE, L_SHAPE, HOLE, SLANTED)


def machine(width=3.0, turn="clothoid", **path):
    """Return the compact tractor with an implement of a given width [m]."""
    keys = {"transition": "none" if turn == "omega" else "clothoid", "speed_m_s": 2.0, **path}
    return rig_of(planning_scenario("field", keys, {}), width)


@cache
def default_plan(field, width=3.0):
    """Return the plan of a field with default options. The plan is computed once for all tests."""
    return make_plan(field, machine(width), Options())
