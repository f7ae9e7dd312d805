"""Swaths, their cells and their order, and headland laps."""

from math import pi, radians, sin

import numpy as np
import pytest
import shapely
from field_shapes import FIELDS, HOLE, L_SHAPE, RECTANGLE, SLANTED, machine
from shapely import Polygon

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.planner.contours import contour_frame
from agrobot_mj.extensions.fields.planner.laps import CORNER_M, DEVIATION, lap, offset, rings, smooth_ring, start_at
from agrobot_mj.extensions.fields.planner.swaths import SwathFrame, best_pattern, pattern, swath_order
from agrobot_mj.terrain import Slope


def ground(layout, width):
    """Return the ground covered by all swaths without lateral error."""
    boxes = [
        shapely.box(s.start, s.across - width / 2, s.end, s.across + width / 2) for cell in layout.cells for s in cell
    ]
    return shapely.affinity.rotate(shapely.union_all(boxes), layout.frame.angle * 180 / pi, origin=(0, 0))


def test_swaths_of_a_rectangle_run_along_its_longer_side():
    layout = best_pattern(RECTANGLE.boundary, 4.0, 1)
    assert (layout.number, layout.frame.angle, layout.length) == (10, 0.0, pytest.approx(600.0))


def test_swath_angle_of_a_rotated_rectangle_is_its_rotation():
    turned = shapely.affinity.rotate(RECTANGLE.boundary, 33.0)
    assert best_pattern(turned, 4.0, 1).frame.angle == pytest.approx(radians(33.0), abs=1e-5)


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.name)
@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0])
def test_swaths_cover_the_whole_field(field, angle):
    layout = pattern(field.boundary, SwathFrame(angle), 3.7, 1)
    assert field.boundary.difference(ground(layout, 3.7)).area < 0.05


def test_field_is_divided_into_cells_at_holes_and_inner_corners():
    assert len(pattern(RECTANGLE.boundary, SwathFrame(0.0), 4.0, 1).cells) == 1
    assert len(pattern(L_SHAPE.boundary, SwathFrame(pi / 2), 4.0, 1).cells) == 1
    assert len(pattern(HOLE.boundary, SwathFrame(0.0), 4.0, 1).cells) == 4


def test_each_section_is_switched_where_it_crosses_the_boundary():
    layout = pattern(SLANTED.boundary, SwathFrame(0.0), 5.0, 5)
    swath = layout.cells[0][0]
    starts, ends = np.array(swath.sections).T
    assert swath.start == starts.min()
    assert np.diff(starts) == pytest.approx([0.2] * 4)
    assert np.diff(ends) == pytest.approx([-0.4] * 4)


@pytest.mark.parametrize(("count", "across"), [(7, 3), (12, 2), (20, 3), (5, 1), (4, 3)])
def test_each_swath_is_driven_once(count, across):
    order = swath_order(count, "skip", across)
    assert sorted(order) == list(range(count))
    if across > 1 and count >= 2 * across + 1:
        assert min(abs(np.diff(order))) >= across


def test_headland_laps_follow_the_boundary_and_surround_holes():
    found = rings(HOLE.boundary, 2, 3.0)
    assert [(ring.number, ring.hole) for ring in found] == [(0, -1), (1, -1), (0, 0), (1, 0)]
    assert [ring.line.is_ccw for ring in found] == [True, True, False, False]
    assert found[0].line.length == pytest.approx(2 * (87 + 77))
    assert found[3].line.length == pytest.approx(2 * (21 + 19))


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.name)
def test_headland_lap_stays_within_the_maximum_machine_curvature(field):
    rig = machine()
    for ring in rings(field.boundary, 2, rig.width):
        course = start_at(lap(smooth_ring(ring, rig), rig), 10.0)
        assert course.peaks.max() <= rig.max_curvature
        x, y, _ = course.joints()
        assert np.hypot(x[-1] - x[0], y[-1] - y[0]) < 1e-6


def test_headland_laps_of_a_round_field_are_drivable():
    rig = machine()
    circle = shapely.Point(0, 0).buffer(30.0, quad_segs=40)
    ring = rings(circle, 1, 3.0)[0]
    course = lap(smooth_ring(ring, rig), rig)
    assert course.lengths.sum() == pytest.approx(2 * pi * 28.5, rel=0.01)
    assert offset(circle, 3.0).area == pytest.approx(pi * 27**2, rel=0.01)


def recorded(line, rng, noise):
    """Return a line as recorded by a receiver, with a point each 0.2 m to 2 m and a `noise` per coordinate [m]."""
    distances = np.cumsum(rng.uniform(0.2, 2.0, int(line.length)))
    points = shapely.get_coordinates(line.interpolate(distances[distances < line.length - 0.2]))
    return points + rng.normal(0.0, noise, points.shape)


BOX = shapely.box(0, 0, 120, 80)
CORNERED = Polygon([(0, 0), (130, 0), (130, 60), (70, 60), (70, 110), (0, 110)])
RECORDED = {
    "circle": shapely.Point(0, 0).buffer(40.0, quad_segs=64),
    "small radius": BOX.buffer(-8).buffer(8),
    "large radius": BOX.buffer(-15).buffer(15),
    "corners": BOX,
    "reflex corner": CORNERED.buffer(-6).buffer(12).buffer(-6),
}


@pytest.mark.parametrize("noise", [0.0, 0.03])
@pytest.mark.parametrize("shape", RECORDED)
def test_headland_laps_with_many_short_sides_need_no_crawling(shape, noise):
    rig, outer = machine(), Polygon(recorded(RECORDED[shape].exterior, np.random.default_rng(3), noise))
    for ring in rings(outer, 3, rig.spacing):
        course = lap(smooth_ring(ring, rig), rig)
        times = course.lengths / np.minimum(course.speeds, rig.path.speed_m_s)
        assert times[course.speeds < rig.path.speed_m_s / 2].sum() < 0.02 * times.sum()
        assert course.peaks.max() <= rig.max_curvature


@pytest.mark.parametrize("shape", RECORDED)
def test_rounded_lap_deviates_little_from_the_offset_line(shape):
    rig, outer = machine(), Polygon(recorded(RECORDED[shape].exterior, np.random.default_rng(4), 0.03))
    ring, reach = rings(outer, 1, rig.spacing)[0], rig.path.turn_radius_m
    x, y, _ = lap(smooth_ring(ring, rig), rig).divided().joints()
    points, turned = shapely.points(x, y), Polygon(ring.points).buffer(-reach).buffer(reach)
    away = shapely.distance(points, turned.exterior) * shapely.contains(turned, points)
    assert away.max() < DEVIATION * rig.width + CORNER_M
    assert shapely.distance(points, outer.exterior).min() > rig.width / 2 - CORNER_M


def test_lap_around_a_recorded_obstacle_keeps_clearance_without_crawling():
    rig, rng = machine(), np.random.default_rng(5)
    hole = recorded(shapely.Point(60, 40).buffer(7.0, quad_segs=32).exterior, rng, 0.03)
    ring = rings(Polygon(BOX.exterior.coords, [hole]), 1, rig.spacing)[1]
    course = lap(smooth_ring(ring, rig), rig)
    x, y, _ = course.divided().joints()
    assert ring.hole == 0
    assert course.speeds.min() > rig.path.speed_m_s / 2
    assert shapely.distance(shapely.points(x, y), Polygon(hole)).min() > rig.width / 2 - CORNER_M


@pytest.mark.parametrize("uphill", [0.0, 30.0, 90.0, 200.0])
def test_swaths_of_a_contour_frame_are_perpendicular_to_the_slope(uphill):
    found = contour_frame(L_SHAPE.boundary, Slope(grade_deg=5.0, direction_deg=uphill).ground())
    assert sin(found.angle - radians(uphill + 90.0)) == pytest.approx(0.0, abs=1e-6)  # swaths have no direction
    assert 0.0 <= found.angle <= pi
    assert found[1:] == (0.0, 0.0, 0.0)


def test_level_field_has_no_contour_frame():
    with pytest.raises(ScenarioError, match="--along contours: the field is level; set a slope"):
        contour_frame(RECTANGLE.boundary, Slope(grade_deg=0.0).ground())
