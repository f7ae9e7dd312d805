"""Connections between two poses: end points, lengths and limits."""

from math import acos, cos, hypot, inf, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agrobot_mj.core.geometry import wrap
from agrobot_mj.extensions.fields.planner.words import FORWARD, REVERSING, Bends, connections, end_of, length_of
from agrobot_mj.paths.arc import Pose

ORIGIN = Pose(0.0, 0.0, 0.0)
ARCS, CLOTHOIDS = Bends(4.0), Bends(4.0, 0.12, 1.0)
PLACES = st.floats(-25, 25)


@pytest.mark.parametrize("bends", [ARCS, CLOTHOIDS])
@given(x=PLACES, y=PLACES, yaw=st.floats(-3.1, 3.1), ahead=PLACES, left=PLACES, turned=st.floats(-3.1, 3.1))
@settings(max_examples=25, deadline=None)
def test_connection_ends_at_its_goal_within_the_curvature_limit(bends, x, y, yaw, ahead, left, turned):
    start, goal = Pose(x, y, yaw), Pose(ahead, left, turned)
    found = connections(start, goal, bends)
    assert found
    for pieces in found:
        end = end_of(start, pieces)
        assert hypot(end.x - goal.x, end.y - goal.y) < 1e-4
        assert abs(wrap(end.yaw - goal.yaw)) < 1e-4
        peaks = [max(abs(p.curvature), abs(p.curvature + p.sharpness * p.length)) for p in pieces]
        assert max(peaks, default=0.0) <= 1 / bends.radius + 1e-9
        assert max((abs(p.sharpness) for p in pieces), default=0.0) <= min(bends.sharpness, 1.0) + 1e-9
        assert all(p.direction == 1.0 for p in pieces)


@given(ahead=PLACES, left=PLACES, yaw=st.floats(-3.1, 3.1))
@settings(max_examples=30, deadline=None)
def test_clothoid_connection_is_at_least_as_long_as_arc_connection(ahead, left, yaw):
    goal = Pose(ahead, left, yaw)
    arcs, clothoids = (length_of(connections(ORIGIN, goal, bends)[0]) for bends in (ARCS, CLOTHOIDS))
    assert clothoids >= arcs - 1e-3


def test_straight_and_semicircular_connections_have_analytic_lengths():
    straight = connections(ORIGIN, Pose(20.0, 0.0, 0.0), ARCS)[0]
    half_turn = connections(ORIGIN, Pose(0.0, 8.0, pi), ARCS)[0]
    assert length_of(straight) == pytest.approx(20.0)
    assert length_of(half_turn) == pytest.approx(4.0 * pi)


def test_three_point_turn_is_as_long_as_a_semicircle_of_its_radius():
    found = connections(ORIGIN, Pose(0.0, 2.0, pi), ARCS, REVERSING)
    assert length_of(found[0]) == pytest.approx(4.0 * pi)
    assert [piece.direction for piece in found[0]] == [1.0, -1.0, 1.0]


def test_length_of_a_bulb_turn_of_arcs_matches_the_analytic_value():
    width, radius = 3.0, 4.0
    flare = acos((1 + width / (2 * radius)) / 2)
    found = connections(ORIGIN, Pose(0.0, width, pi), ARCS)
    assert 2 * radius * (2 * cos(flare) - 1) == pytest.approx(width)
    assert min(map(length_of, found)) == pytest.approx(radius * (pi + 4 * flare))


def test_connections_without_clothoids_have_at_most_three_segments():
    assert all(len(p) <= 3 for p in connections(ORIGIN, Pose(3.0, 9.0, 1.0), Bends(4.0, inf), FORWARD))
