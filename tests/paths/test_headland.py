"""Headland turns: end points at the next pass, lengths, and required depth."""

from math import acos, inf, pi, sin

import numpy as np
import pytest

from agrobot_mj.paths import Swaths, sample
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.headland import half_turn_width, headland_turn
from agrobot_mj.paths.track import chain

R, C = 3.0, 0.187  # Radius [m], and sharpness for 15 deg/s at 1 m/s [1/m2]


def end(pieces):
    return [float(values[-1]) for values in chain(Pose(0, 0, 0), pieces).joints()]


@pytest.mark.parametrize("shape", ["omega", "k", "u"])
@pytest.mark.parametrize("sharpness", [inf, C, 1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_headland_turn_ends_at_the_next_pass_with_opposite_heading(shape, sharpness, side):
    close = half_turn_width(R, sharpness) if shape == "u" else 0.3
    for away in np.linspace(close, 12.0, 25).tolist():
        x, y, yaw = end(headland_turn(side * away, shape, R, sharpness, 1.0))
        assert (x, y) == pytest.approx((0.0, side * away), abs=1e-8)
        assert abs(yaw) == pytest.approx(pi, abs=1e-8)


@pytest.mark.parametrize("shape", ["omega", "k"])
@pytest.mark.parametrize("away", [0.5, 2.0, 5.0, 6.3, 7.0, 9.0])
def test_clothoid_turns_have_continuous_curvature(shape, away):
    pieces = [piece for piece in headland_turn(away, shape, R, C, 1.0) if piece.length > 1e-9]
    ends = [0.0, *(p.curvature + p.sharpness * p.length for p in pieces)]
    assert [p.curvature for p in pieces] == pytest.approx(ends[:-1], abs=1e-9)
    assert ends[-1] == pytest.approx(0, abs=1e-9)
    assert max(abs(p.sharpness) for p in pieces) <= C * (1 + 1e-9)
    assert max(abs(p.curvature) for p in pieces) <= 1 / R + 1e-12


def test_k_turn_is_as_long_as_a_semicircle_and_less_than_a_radius_deep():
    pieces = headland_turn(2.0, "k", R, inf, 1.0)
    first = acos((1 - 2.0 / (2 * R)) / 2)
    assert [p.length for p in pieces] == pytest.approx([R * first, R * (pi - 2 * first), R * first])
    assert [p.direction for p in pieces] == [1, -1, 1]
    assert [p.curvature for p in pieces] == pytest.approx([1 / R, -1 / R, 1 / R])
    assert sum(p.length for p in pieces) == pytest.approx(pi * R)
    path = Swaths(length_m=30, run_in_m=5, count=2, turn="k")
    x = sample(path, np.linspace(0, path.duration_s, 20001))[:, 0]
    assert path.at(path.passes_s[0][1]).x == pytest.approx(30)
    inside = np.linspace(path.passes_s[0][1], path.passes_s[1][0] - 6.0, 5000)
    depth = sample(path, inside)[:, 0].max() - 30
    assert depth == pytest.approx(R * sin(first), abs=1e-3)
    assert depth < R
    assert x.max() - 30 == pytest.approx(depth, abs=1e-3)


def test_k_turn_needs_less_headland_than_an_omega_turn():
    depths = []
    for turn in ("k", "omega"):
        path = Swaths(length_m=30, run_in_m=5, count=2, turn=turn, transition="clothoid")
        depths.append(sample(path, np.linspace(0, path.duration_s, 20001))[:, 0].max() - 30)
    assert depths[0] < 0.65 * depths[1]


def test_medium_pass_spacing_gives_a_semicircle_of_larger_radius():
    pieces = headland_turn(7.0, "omega", R, C, 1.0)
    assert len(pieces) == 3
    assert pieces[1].curvature < 1 / R
    assert len(headland_turn(9.0, "omega", R, C, 1.0)) == 7


def test_u_turns_with_clothoids_must_skip_more_passes():
    path = Swaths(length_m=30, run_in_m=5, swath_m=3.02, count=10, turn="u", transition="clothoid")
    assert half_turn_width(R, path.sharpness(1.0)) > 2 * 3.02 > 2 * R
    assert np.abs(np.diff(path.order)).min() >= 3
    assert np.abs(np.diff(path.model_copy(update={"transition": "none"}).order)).min() == 2
