"""Swaths along curved contour lines: arcs on a round hill, and a plan with these swaths."""

from math import hypot

import numpy as np
import pytest
import shapely
from field_shapes import L_SHAPE, RECTANGLE, machine

from agrobot_mj.extensions.fields.planned import planned_coverage
from agrobot_mj.extensions.fields.planner.area import body_of, whole_of
from agrobot_mj.extensions.fields.planner.contours import contour_frame
from agrobot_mj.extensions.fields.planner.planning import Options, make_plan
from agrobot_mj.extensions.fields.planner.swaths import SwathFrame, pattern
from agrobot_mj.terrain.grid import Ground

SPACING = 1.0


def hill(x, y, sign=1.0, height=40.0):
    """Return ground with circular contour lines around a point: a hill, or a hollow with `sign` -1."""
    nodes = np.arange(-400.0, 401.0, SPACING)
    away = np.hypot(nodes[None, :] - x, nodes[:, None] - y)
    return Ground(-400.0, -400.0, SPACING, height - sign * 1e-4 * away**2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("place", [(30.0, -150.0), (30.0, 250.0), (-120.0, 20.0)])
def test_swaths_on_a_round_hill_are_arcs_around_its_top(place, sign):
    frame = contour_frame(RECTANGLE.boundary, hill(*place, sign))
    assert frame.centre == pytest.approx(place, abs=0.1)
    assert 1 / abs(frame.curvature) == pytest.approx(hypot(place[0] - 30, place[1] - 20), rel=1e-3)


def test_swaths_are_straight_if_the_hilltop_is_inside_the_field():
    assert contour_frame(L_SHAPE.boundary, hill(10.0, 10.0)).curvature == 0.0


@pytest.mark.parametrize("curvature", [0.0, 0.004, -0.004])
def test_swath_frame_converts_station_and_offset_to_a_pose_and_back(curvature):
    frame = SwathFrame(0.7, curvature, 10.0, -5.0)
    for station, across in ((0.0, 0.0), (40.0, 30.0), (-60.0, -20.0)):
        pose, ahead = frame.pose(station, across), frame.pose(station + 1e-3, across)
        assert frame.of(np.array([pose[:2]]))[0] == pytest.approx((station, across), abs=1e-9)
        step = ahead.x - pose.x, ahead.y - pose.y
        assert np.arctan2(*step[::-1]) == pytest.approx(pose.yaw, abs=1e-5)
        assert hypot(*step) == pytest.approx(1e-3 * frame.stretch(across), rel=1e-6)


@pytest.mark.parametrize("curvature", [0.004, -0.004])
def test_curved_swaths_cover_the_field_without_overlap(curvature):
    frame, area = SwathFrame(0.1, curvature, 30.0, 20.0), RECTANGLE.boundary
    layout = pattern(area, frame, 3.0, 1)
    strips = [
        shapely.Polygon([frame.pose(s, d)[:2] for d, ends in ((a - 1.5, 1), (a + 1.5, -1)) for s in at[::ends]])
        for cell in layout.cells
        for begin, end, a, _ in cell
        for at in [np.linspace(begin, end, 200)]
    ]
    union = shapely.union_all(strips)
    assert area.difference(union).area < 0.1
    assert sum(strip.area for strip in strips) == pytest.approx(union.area, abs=0.5)
    assert layout.length * 3.0 == pytest.approx(union.area, abs=0.5)


def test_plan_of_contour_swaths_covers_the_field_along_arcs():
    frame = contour_frame(RECTANGLE.boundary, hill(30.0, -150.0))
    rig = machine()
    plan = make_plan(RECTANGLE, rig, Options(frame=frame))
    assert plan.angle_deg is None
    assert not any("leaves the field" in warning for warning in plan.warnings)
    assert plan.course.peaks.max() <= rig.max_curvature
    x, y, _ = plan.course.divided().joints()
    s = plan.course.divided().distances()
    for one in plan.passes:
        if one.part == "body":
            away = np.hypot(x - 30.0, y + 150.0)[(s >= one.start) & (s <= one.end)]
            assert np.ptp(away) < 0.01
    found = planned_coverage(plan, whole_of(RECTANGLE), body_of(RECTANGLE, plan))
    assert found.missed.intersection(found.body).area < 0.01 * found.body.area
