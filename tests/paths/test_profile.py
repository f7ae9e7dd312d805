"""Maximum speed within limits compared with analytic results."""

from math import inf, pi, sqrt

import numpy as np
import pytest

from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.profile import TimedCourse, fastest
from agrobot_mj.paths.track import STEP_M, Piece, chain, samples, through

ORIGIN = Pose(0.0, 0.0, 0.0)


def test_squared_speed_from_rest_grows_linearly_with_distance():
    v = fastest(np.ones(10), np.full(10, 100.0), 0.5)
    assert v == pytest.approx(np.sqrt(2 * 0.5 * np.arange(11)))


def test_deceleration_ends_at_the_start_of_a_slow_segment():
    limits = np.array([9.0] * 20 + [1.0] * 5 + [9.0] * 20)
    v = fastest(np.ones(45), limits, 1.0)
    assert v[20:26] == pytest.approx(1.0)
    assert v[19::-1][:9] == pytest.approx(np.sqrt(1 + 2 * np.arange(1, 10)))
    assert v[26:36] == pytest.approx(np.sqrt(1 + 2 * np.arange(1, 11)))
    assert np.abs(np.diff(v**2)).max() <= 2 + 1e-9


def test_speed_in_a_bend_is_limited_by_lateral_acceleration():
    course = chain(ORIGIN, [Piece(50), Piece(10 * pi, 0.1), Piece(50)])
    motion = TimedCourse(course, 5.0, 0.4, 0.5)
    inside = motion.time_at(50 + 5 * pi)
    assert motion.at(inside).curvature == 0.1
    assert np.hypot(*motion.at(inside)[2:4]) == pytest.approx(sqrt(0.4 / 0.1))
    assert np.hypot(*motion.at(motion.time_at(20))[2:4]) > 2.5


@pytest.mark.parametrize("distance", [0.0, 0.013, 7.3, 60.0, 99.99])
def test_time_at_distance_is_the_inverse_of_distance_at_time(distance: float):
    motion = TimedCourse(chain(ORIGIN, [Piece(100.0, 0.0, 1.5)]), 2.0, 1.0, 0.3)
    assert motion.at(motion.time_at(distance)).x == pytest.approx(distance)


def test_travel_time_of_a_straight_equals_the_analytic_duration():
    v, a, length = 1.5, 0.3, 100.0
    assert TimedCourse(chain(ORIGIN, [Piece(length)]), v, 1.0, a).duration == pytest.approx(
        length / v + v / (2 * a), rel=1e-3
    )


def test_reference_continues_straight_after_the_end_of_the_path():
    motion = TimedCourse(chain(ORIGIN, [Piece(10.0), Piece(5 * pi, 0.1)]), 1.0, 1.0, 0.5)
    end, later = motion.at(motion.duration), motion.at(motion.duration + 7.0)
    assert (later.x, later.y) == pytest.approx((end.x, end.y + 7.0))
    assert later.curvature == 0
    assert later.yaw == end.yaw == pytest.approx(pi / 2)


def test_divided_path_has_the_joints_of_the_original_path():
    course = chain(Pose(1, 2, 0.3), [Piece(4.0), Piece(0.0, 5.0), Piece(6.0, -0.25), Piece(3.0, 0.5, 0.7)])
    divided = course.divided()
    assert len(course.lengths) == 3
    assert divided.lengths.max() <= STEP_M
    for whole, parts in zip(course.joints(), divided.joints(), strict=True):
        assert parts[-1] == pytest.approx(whole[-1])
    assert course.joints()[2][-1] == pytest.approx(0.3 - 1.5 + 1.5)
    assert divided.speeds.min() == 0.7
    assert divided.speeds.max() == inf


def test_arcs_through_points_of_a_curve_follow_the_curve():
    u = np.linspace(0, 2 * pi, 400)
    course = through(20 * np.cos(u), 10 * np.sin(u), np.arctan2(10 * np.cos(u), -20 * np.sin(u)))
    x, y, yaw = course.joints()
    assert x == pytest.approx(20 * np.cos(u), abs=1e-3)
    assert y == pytest.approx(10 * np.sin(u), abs=1e-3)
    assert yaw[-1] - yaw[0] == pytest.approx(2 * pi)
    assert np.abs(course.curvatures).max() == pytest.approx(20 / 10**2, rel=1e-3)


def test_path_above_the_maximum_length_is_rejected():
    with pytest.raises(ValueError, match="km long, more than 200 km"):
        samples(210e3)
    assert samples(199e3) < 110_000
