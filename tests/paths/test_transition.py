"""Clothoids and bends compared with Fresnel integrals and numerical integration."""

from math import cos, hypot, inf, pi, radians, sin, sqrt

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import fresnel

from agrobot_mj.paths import Circle, FigureEight
from agrobot_mj.paths.arc import Pose, advance
from agrobot_mj.paths.track import Piece, chain
from agrobot_mj.paths.transition import Transitions, bend, spiral

START = Pose(3.0, -2.0, 0.4)


@pytest.mark.parametrize(("length", "curvature"), [(0.7, 0.1), (1.8, 1 / 3), (4.0, 0.5), (6.0, 1.0)])
def test_clothoid_end_point_equals_the_fresnel_integrals(length, curvature):
    scale = sqrt(pi * length / curvature)
    y, x = fresnel(length / scale)
    assert spiral(length, curvature) == pytest.approx((scale * x, scale * y, curvature * length / 2), abs=1e-12)


@pytest.mark.parametrize("distance", [0.3, -0.5, 4.0, -7.0, 12.0])
@pytest.mark.parametrize(("curvature", "sharpness"), [(0.0, 0.2), (0.3, -0.2), (-0.4, 0.15), (0.1, 1e-9)])
def test_position_along_a_clothoid_is_the_integral_of_the_heading(curvature, sharpness, distance):
    def heading(s):
        return START.yaw + curvature * s + sharpness * s * s / 2

    x = START.x + quad(lambda s: cos(heading(s)), 0, distance, epsabs=1e-13, limit=200)[0]
    y = START.y + quad(lambda s: sin(heading(s)), 0, distance, epsabs=1e-13, limit=200)[0]
    assert advance(START, curvature, distance, sharpness) == pytest.approx((x, y, heading(distance)), abs=1e-10)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_path_joints_equal_the_end_points_of_its_segments(direction):
    pieces = [
        Piece(3.0, 0.0, direction=direction),
        *bend(2.0, 3.0, 0.2).pieces(-1.0, direction=direction),
        Piece(2.0, 0.0, direction=-direction),
        *bend(0.3, 3.0, 0.2).pieces(1.0, direction=-direction),
    ]
    course, pose = chain(START, pieces), START
    for piece in pieces:
        d = piece.direction
        pose = advance(pose, piece.curvature, d * piece.length, d * piece.sharpness)
    for whole in (course, course.divided()):
        assert [values[-1] for values in whole.joints()] == pytest.approx(list(pose), abs=1e-10)
    assert pose.yaw == pytest.approx(START.yaw - direction * 2.0 - direction * 0.3)


def test_left_arc_driven_in_reverse_turns_the_heading_to_the_right():
    x, y, yaw = (values[-1] for values in chain(Pose(0, 0, 0), [Piece(pi, 0.5, direction=-1.0)]).joints())
    assert (x, y, yaw) == pytest.approx((-2.0, 2.0, -pi / 2))


@pytest.mark.parametrize("angle", [0.05, 0.5, pi / 2, 2.5, pi + 1])
@pytest.mark.parametrize("sharpness", [0.15, 0.5, inf])
def test_clothoid_bend_turns_by_its_angle_and_has_straight_ends(angle, sharpness):
    found = bend(angle, 3.0, sharpness)
    turned = kappa = 0.0
    for piece in found.pieces(1.0):
        if sharpness < inf:
            assert piece.curvature == pytest.approx(kappa, abs=1e-12)
        kappa = piece.curvature + piece.sharpness * piece.length
        turned += piece.length * (piece.curvature + kappa) / 2
        assert abs(piece.sharpness) <= sharpness * (1 + 1e-12)
    assert turned == pytest.approx(angle)
    assert found.curvature <= 1 / 3.0 + 1e-12
    if sharpness < inf:
        assert kappa == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("angle", [0.05, 0.5, pi / 2, 2.5])
@pytest.mark.parametrize("sharpness", [0.15, 0.5, inf])
def test_clothoid_bend_starts_and_ends_a_tangent_length_from_the_corner(angle, sharpness):
    found = bend(angle, 3.0, sharpness)
    x, y, _ = (values[-1] for values in chain(Pose(0, 0, 0), found.pieces(1.0)).joints())
    corner = found.tangent
    assert (x, y) == pytest.approx((corner * (1 + cos(angle)), corner * sin(angle)), abs=1e-9)


def test_clothoid_sharpness_and_maximum_speed_are_inverse_functions():
    none, clothoid = Transitions(), Transitions(transition="clothoid", steer_rate_deg_s=20.0, wheelbase_m=2.0)
    assert none.sharpness(1.0) == none.speed_for(0.1) == inf
    c = clothoid.sharpness(1.5)
    # delta = atan(L kappa) has the rate L c v at kappa = 0.
    assert 2.0 * c * 1.5 == pytest.approx(radians(20.0))
    assert clothoid.speed_for(c) == pytest.approx(1.5)


def test_figure_eight_with_clothoids_keeps_radius_and_straights():
    eight = FigureEight(transition="clothoid", ramp_s=0)
    c = eight.sharpness(eight.speed_m_s)
    grid = np.linspace(eight.turns_s[0][0], eight.turns_s[0][1], 40001)
    kappa, x, y = np.array([(r.curvature, r.x, r.y) for r in map(eight.at, grid.tolist())]).T
    step = (grid[1] - grid[0]) * eight.speed_m_s
    assert np.abs(kappa).max() == pytest.approx(0.1)
    assert (kappa == 0).sum() * step == pytest.approx(2 * 28.0, abs=4 * step)
    clothoids = ((np.abs(kappa) > 0) & (np.abs(kappa) < 0.1 - 1e-12)).sum() * step
    assert clothoids == pytest.approx(4 * 0.1 / c, abs=8 * step)
    assert (x.max() + x.min(), y.max() + y.min()) == pytest.approx((0, 0), abs=1e-3)
    half = eight.at((grid[0] + grid[-1]) / 2)
    assert (half.x, half.y) == pytest.approx((0, 0), abs=1e-9)
    assert hypot(*eight.at(eight.turns_s[0][1])[:2]) == pytest.approx(0, abs=1e-9)


def test_clothoid_lead_in_starts_straight_and_joins_the_circle():
    circle = Circle(transition="clothoid", radius_m=5.0)
    first = circle.turns_s[0][0]
    assert circle.at(0).curvature == pytest.approx(0.0, abs=1e-12)
    assert circle.at(first)[:2] == pytest.approx((0, 0), abs=1e-9)
    assert circle.at(first).curvature == pytest.approx(0.2)
    assert circle.sharpest.distance == pytest.approx(0.2 / circle.sharpness(1.2))


def test_figure_eight_radius_too_small_for_its_clothoids_is_rejected():
    with pytest.raises(ValueError, match=r"radius_m: must be at least 2.2[0-9] for clothoids at 3 m/s"):
        FigureEight(transition="clothoid", radius_m=2.0, speed_m_s=3.0)
