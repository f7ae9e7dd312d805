"""Passes on a field: positions, order, and the turns between them."""

from math import acos, hypot, pi

import numpy as np
import pytest

from agrobot_mj.core.geometry import wrap
from agrobot_mj.paths import Contour, Swaths, sample
from agrobot_mj.paths.parallel import skipping

SMALL = {"length_m": 30.0, "run_in_m": 5.0}
FIELDS = [
    Swaths(**SMALL),
    Swaths(**SMALL, swath_m=7, turn="u", count=5),
    Swaths(**SMALL, swath_m=7, turn="omega", first_turn="right"),
    Swaths(**SMALL, swath_m=2, turn="u", count=9, heading_deg=70, start_x_m=4, start_y_m=-3),
    Swaths(**SMALL, swath_m=0.5, turn="omega", count=3, first_turn="right", heading_deg=-160),
    Contour(**SMALL, swath_m=3, count=5),
]


def local(path, points):
    """Return the coordinates of points along the first pass and to its left."""
    start = path.at(0)
    c, s = np.cos(start.yaw), np.sin(start.yaw)
    x, y = points[:, 0] - start.x, points[:, 1] - start.y
    return c * x + s * y, -s * x + c * y


@pytest.mark.parametrize("path", FIELDS, ids=repr)
def test_each_pass_follows_its_line_over_the_field_length(path):
    side = path.orientation[1]
    assert len(path.passes_s) == len(path.order) == path.count
    for k, ((start, end), line) in enumerate(zip(path.passes_s, path.order, strict=True)):
        along, left = local(path, sample(path, np.linspace(start, end, 50)))
        assert left == pytest.approx(side * line * path.swath_m, abs=1e-6)
        ends = (5, 30) if k % 2 == 0 else (25, 0)
        assert (along[0], along[-1]) == pytest.approx(ends, abs=1e-6)
        assert {path.at(t).curvature for t in np.linspace(start + 1e-6, end - 1e-6, 20).tolist()} == {0.0}


@pytest.mark.parametrize("path", FIELDS, ids=repr)
def test_headland_turns_are_outside_the_field_and_slower_than_passes(path):
    times = np.linspace(0, path.duration_s, 5000)
    references = [path.at(t) for t in times.tolist()]
    along, _ = local(path, sample(path, times))
    for r, here in zip(references, along.tolist(), strict=True):
        if r.curvature:
            assert not 1e-6 < here < 30 - 1e-6
            assert hypot(r.vx, r.vy) <= path.turn_speed_m_s + 1e-9
            assert abs(r.curvature) == pytest.approx(1 / path.turn_radius_m)
    deepest = max(along.max() - 30, -along.min())
    r = path.turn_radius_m
    assert deepest <= 3 * r


@pytest.mark.parametrize("path", FIELDS, ids=repr)
def test_headland_turn_changes_the_heading_by_180_deg(path):
    for (_, end), (start, _) in zip(path.passes_s, path.passes_s[1:], strict=False):
        assert abs(wrap(path.at(start).yaw - path.at(end).yaw)) == pytest.approx(pi)


def test_omega_turn_has_the_analytic_length_of_its_three_arcs():
    path = Swaths(count=2, swath_m=2.0, turn_radius_m=3.0, run_in_m=0.0, length_m=40.0)
    flare = acos((1 + 2 / 6) / 2)
    length = path.motion.distances[-1] - 2 * 40.0 - 5.0
    assert length == pytest.approx(3.0 * (pi + 4 * flare))
    along, left = local(path, sample(path, np.linspace(0, path.duration_s, 20000)))
    assert along.max() - 40 == pytest.approx(3 + 6 * np.sin(flare), abs=1e-3)
    assert (left.min(), left.max()) == pytest.approx((-2, 4), abs=1e-3), "symmetric about the middle of the swath"


@pytest.mark.parametrize("turn", ["u", "omega"])
def test_headland_turn_of_wide_swaths_has_two_quarter_arcs_and_a_straight(turn):
    path = Swaths(count=2, swath_m=8.0, turn_radius_m=3.0, turn=turn, run_in_m=0.0)
    assert path.motion.distances[-1] - 2 * 100.0 - 5.0 == pytest.approx(3 * pi + 2)


@pytest.mark.parametrize("across", [2, 3, 5])
def test_skip_pattern_visits_each_pass_once_and_keeps_minimum_distance(across):
    for count in range(2 * across + 1, 12 * across):
        order = list(skipping(count, across))
        assert sorted(order) == list(range(count))
        assert np.abs(np.diff(order)).min() >= across
        assert order[0] == 0


def test_skip_order_moves_by_little_more_than_the_minimum_distance():
    assert list(skipping(10, 2)) == [0, 2, 4, 1, 3, 5, 7, 9, 6, 8]
    assert np.abs(np.diff(list(skipping(70, 3)))).max() == 4


def test_field_too_narrow_for_u_turns_is_rejected():
    with pytest.raises(
        ValueError, match=r"count: U turns of radius 3 m with swaths of 2 m need 1 or at least 7 passes"
    ):
        Swaths(turn="u", count=6)
    assert Swaths(turn="u", count=1).order == (0,)
    with pytest.raises(ValueError, match="run_in_m: must be at most half of length_m"):
        Swaths(length_m=30, run_in_m=16)
    with pytest.raises(ValueError, match="km long"):
        Swaths(length_m=5000, count=50)


@pytest.mark.parametrize(("first", "heading"), [("left", 0.0), ("right", pi)])
@pytest.mark.parametrize("uphill", [90.0, 200.0])
def test_contour_passes_have_constant_height_and_are_ordered_uphill(first, heading, uphill):
    path = Contour(uphill_deg=uphill, first_uphill=first)
    assert wrap(path.at(0).yaw - heading - np.radians(uphill - 90)) == pytest.approx(0, abs=1e-12)
    up = np.array([np.cos(np.radians(uphill)), np.sin(np.radians(uphill))])
    heights = [sample(path, np.linspace(*leg, 20)) @ up for leg in path.passes_s]
    for k, height in enumerate(heights):
        assert height == pytest.approx(2.0 * k, abs=1e-6)
