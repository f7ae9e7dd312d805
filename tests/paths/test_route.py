"""Nearest-point search compared with geometry and brute force, and independent of the order of queries."""

from math import atan2, cos, hypot, inf, nan, pi, radians, sin

import numpy as np
import pytest

from agrobot_mj.control.base import Route
from agrobot_mj.core.errors import NotFiniteError
from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import every
from agrobot_mj.metrics.crosstrack import track
from agrobot_mj.paths import Circle, FigureEight, Line, Manoeuvre, Path
from agrobot_mj.paths.manoeuvre import StraightPiece
from agrobot_mj.paths.route import STEP_M, SampledRoute


@pytest.mark.parametrize("offset", [-1.5, -0.2, 0.0, 0.3, 2.0])
@pytest.mark.parametrize("s", [0.013, 4.0, 40.02])
@pytest.mark.parametrize("path", [Line(heading_deg=30.0), Circle(), Circle(direction="right", radius_m=5.0)], ids=str)
def test_nearest_route_point_has_correct_distance_and_lateral_offset(path, s, offset):
    route = SampledRoute(path)
    foot = route.ahead(s)
    x, y = foot.x - offset * sin(foot.yaw), foot.y + offset * cos(foot.yaw)
    found = route.nearest(x, y, s + 0.7, s / path.speed_m_s + 2.0)
    assert found.offset == pytest.approx(offset, abs=1e-6)
    assert found.s == pytest.approx(s, abs=2e-3)
    assert hypot(found.x - foot.x, found.y - foot.y) < 2e-3


@pytest.mark.parametrize("path", [Line(), Circle()], ids=str)
@pytest.mark.parametrize("value", [nan, inf, 1e300])
def test_route_query_with_a_number_out_of_range_is_rejected(path, value):
    route = SampledRoute(path)
    queries = [lambda: route.nearest(0.0, 0.0, 0.0, value)]
    if value != 1e300:
        queries += [lambda: route.nearest(0.0, 0.0, value, 0.0), lambda: route.ahead(value)]
    for query in queries:
        with pytest.raises(NotFiniteError, match=r"^the route cannot be sampled up to the (time|arc length)"):
            query()


def test_route_points_on_a_circle_equal_the_analytic_points():
    route = SampledRoute(Circle(radius_m=10.0))
    for s in np.linspace(0.0, 60.0, 47):
        place = route.ahead(float(s))
        assert (place.x, place.y) == pytest.approx((10 * sin(s / 10), 10 - 10 * cos(s / 10)), abs=2e-3)
        assert place.curvature == pytest.approx(0.1)


@pytest.mark.parametrize("kind", every(Path), ids=lambda kind: kind.__name__)
def test_curvatures_of_many_route_points_equal_those_of_single_points(kind):
    distances = [-3.0, -1e-9, 0.0, 0.04, 0.05, 7.77, 31.0, 400.0]
    assert SampledRoute(kind()).curvatures(distances).tolist() == [
        SampledRoute(kind()).ahead(s).curvature for s in distances
    ]


@pytest.mark.parametrize("kind", every(Path), ids=lambda kind: kind.__name__)
def test_nearest_route_point_to_a_reference_point_is_the_same_point(kind):
    path = kind()
    route, s = SampledRoute(path), 0.0
    for t in np.linspace(0.0, min(path.duration_s, 60.0), 400):
        reference = path.at(float(t))
        place = route.nearest(reference.x, reference.y, s, float(t))
        assert abs(place.offset) < 2e-3
        assert hypot(place.x - reference.x, place.y - reference.y) < 5e-3
        same_leg = route.leg(float(t)) == route.leg(max(float(t) - 0.5, 0.0))
        assert place.s >= s - (1e-2 if same_leg else STEP_M), "a reversal is located to within one sample"
        s = place.s


def test_lateral_offsets_of_route_and_cross_track_metric_are_equal():
    path = FigureEight()
    route, rng, s = SampledRoute(path), np.random.default_rng(3), 0.0
    t = np.arange(10.0, 150.0, 0.5)
    left = 0.6 * np.sin(0.2 * t) + rng.normal(0, 0.05, len(t))
    points = np.array([path.at(u) for u in t.tolist()])
    x, y = points[:, 0] - left * np.sin(points[:, 4]), points[:, 1] + left * np.cos(points[:, 4])
    s = route.nearest(x[0], y[0], 1.2 * 8.0, t[0]).s
    found = []
    for k in range(len(t)):
        place = route.nearest(x[k], y[k], s, t[k])
        s = place.s
        found.append(place.offset)
    assert found == pytest.approx(track(path, t, x, y).offset, abs=1e-9)
    every = np.array([path.at(u)[:2] for u in np.linspace(t[0] - 4.0, t[-1] + 4.0, 125 * (len(t) - 1) + 2001).tolist()])
    around = [every[125 * k : 125 * k + 2001] for k in range(len(t))]
    brute = [np.hypot(*(near - here).T).min() for near, here in zip(around, np.column_stack((x, y)), strict=True)]
    assert np.abs(found) == pytest.approx(brute, abs=1e-3)


def test_nearest_route_point_stays_on_the_driven_branch_at_a_crossing():
    path = FigureEight()
    route, s, yaws = SampledRoute(path), 0.0, []
    for t in np.arange(0.0, 240.0, 0.25):
        r = path.at(float(t))
        place = route.nearest(r.x + 0.4, r.y - 0.4, s, float(t))
        s = place.s
        yaws.append(abs(atan2(sin(place.yaw - r.yaw), cos(place.yaw - r.yaw))))
    assert max(yaws) < radians(10)


def test_route_result_is_independent_of_earlier_queries():
    path = FigureEight()
    lazy, eager = SampledRoute(path), SampledRoute(path)
    eager.ahead(200.0)
    for s in (0.0, 7.3, 33.3):
        assert lazy.ahead(s) == eager.ahead(s)


def test_route_extends_straight_beyond_the_ends_of_the_path():
    route = SampledRoute(Line())
    assert route.ahead(-3.0)[2:4] == pytest.approx((-3.0, 0.0))
    behind = route.nearest(-2.0, 0.5, 0.0, 0.0)
    assert (behind.s, behind.offset) == pytest.approx((-2.0, 0.5))


class ThereAndBack:
    """Path with 10 m forward, a stop, and a left-hand arc in reverse; the heading is continuous."""

    speed_m_s, duration_s = 1.0, 30.0
    turns_s = ((0.0, 30.0),)

    def at(self, t):
        if t < 10.0:
            return Reference(t, 0.0, 1.0, 0.0, 0.0, 0.0)
        if t < 12.0:
            return Reference(10.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        angle = -(t - 12.0) / 8.0  # reversing on a left circle turns the heading right
        yaw = atan2(sin(angle), cos(angle))
        return Reference(10.0 + 8 * sin(angle), 8 - 8 * cos(angle), -cos(yaw), -sin(yaw), yaw, 1 / 8)


def test_cusp_divides_the_path_into_forward_and_reverse_segments():
    route = SampledRoute(ThereAndBack())
    low, high = route.leg(5.0)
    assert (low, high) == pytest.approx((0.0, 10.0), abs=0.05)
    assert route.leg(15.0)[0] == pytest.approx(10.0, abs=0.05)
    forward = route.nearest(9.0, 0.2, 9.0, 9.0)
    assert (forward.speed, forward.offset) == pytest.approx((1.0, 0.2), abs=1e-6)
    back = route.nearest(9.0, 0.2, 10.0, 13.0)
    assert back.speed < 0
    assert back.s > 10.5
    assert back.offset == pytest.approx(8 - hypot(9.0 - 10.0, 0.2 - 8), abs=1e-3)


def test_sampled_route_implements_the_route_interface():
    route: Route = SampledRoute(Line())
    assert route.leg(1.0)[0] == 0.0
    assert pi > route.ahead(1.0).yaw > -pi


def test_route_point_at_a_cusp_has_zero_speed_and_the_next_direction():
    for path, direction in ((Line(), 1.0), (Manoeuvre(piece=(StraightPiece(length_m=9.0, reverse=True),)), -1.0)):
        route = SampledRoute(path)
        for place in (route.ahead(0.0), route.ahead(-1.0), route.nearest(0.0, 0.1, 0.0, 0.0)):
            assert (place.speed, place.direction) == (0.0, direction)
        assert route.ahead(2.0).direction == direction
        assert route.ahead(2.0).speed * direction > 0.1
        assert route.ahead(0.03).x == pytest.approx(0.03 * direction, abs=1e-3)


def test_route_direction_is_forward_before_a_reversal():
    route = SampledRoute(Manoeuvre(piece=(StraightPiece(length_m=3.0), StraightPiece(length_m=9.0, reverse=True))))
    assert [route.ahead(s).direction for s in (0.0, 2.0, 5.0)] == [1.0, 1.0, -1.0]
    assert route.ahead(0.03).x == pytest.approx(0.03, abs=1e-3)
