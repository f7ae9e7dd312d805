"""Sinusoid and lane change compared with their formulas."""

from math import atan, pi, radians

import numpy as np
import pytest
from scipy.special import ellipe

from agrobot_mj.paths import LaneChange, Sinusoid, sample


def test_sinusoidal_path_follows_its_formula():
    path = Sinusoid(amplitude_m=3, wavelength_m=25, count=3)
    x, y = sample(path, np.linspace(0, path.duration_s, 3000)).T
    assert y == pytest.approx(3 * np.sin(2 * pi * x / 25), abs=1e-3)
    assert x[-1] == pytest.approx(75, abs=1e-3)
    assert path.at(0).yaw == pytest.approx(atan(3 * 2 * pi / 25))


def test_sinusoid_length_and_crest_curvature_match_the_analytic_values():
    path = Sinusoid(amplitude_m=3, wavelength_m=25, count=2)
    slope = 3 * 2 * pi / 25
    assert path.motion.distances[-1] == pytest.approx(4 * 25 / pi * ellipe(-(slope**2)), rel=1e-5)
    assert path.max_curvature == pytest.approx(3 * (2 * pi / 25) ** 2, rel=1e-3)
    assert abs(path.sharpest.y) == pytest.approx(3, abs=1e-3)


def test_negative_amplitude_mirrors_and_heading_rotates_sinusoidal_path():
    left, right = Sinusoid(), Sinusoid(amplitude_m=-2, heading_deg=90, start_x_m=5)
    grid = np.linspace(0, left.duration_s, 100)
    a, b = sample(left, grid), sample(right, grid)
    assert b[:, 1] == pytest.approx(a[:, 0], abs=1e-9)
    assert b[:, 0] - 5 == pytest.approx(a[:, 1], abs=1e-9)


def test_sampled_sinusoid_of_short_waves_keeps_its_maximum_curvature():
    path = Sinusoid(amplitude_m=0.1, wavelength_m=0.5)
    assert path.max_curvature == pytest.approx(0.1 * (2 * pi / 0.5) ** 2, rel=0.02)


def test_lane_change_starts_on_one_line_and_ends_on_the_other():
    path = LaneChange(offset_m=3, change_m=12, straight_m=20)
    x, y = sample(path, np.linspace(0, path.duration_s, 4000)).T
    assert y[x <= 20] == pytest.approx(0, abs=1e-6)
    assert y[x >= 32.1] == pytest.approx(3, abs=1e-3)
    assert x[-1] == pytest.approx(52, abs=1e-3)
    assert np.interp(26, x, y) == pytest.approx(1.5, abs=1e-3)
    u = np.interp(np.linspace(20, 32, 50), x, y)
    v = np.linspace(0, 1, 50)
    assert u == pytest.approx(3 * (10 * v**3 - 15 * v**4 + 6 * v**5), abs=1e-3)
    assert path.at(path.duration_s).yaw == pytest.approx(0, abs=1e-6)


def test_lane_change_curvature_is_continuous():
    path = LaneChange(offset_m=0.5, change_m=20)
    assert path.max_curvature == pytest.approx(0.5 * 5.7735 / 20**2, rel=1e-2)
    curvature = np.array([path.at(t).curvature for t in np.linspace(0, path.duration_s, 3000).tolist()])
    assert np.abs(np.diff(curvature)).max() < 0.06 * path.max_curvature


def test_double_lane_change_returns_to_the_first_line():
    path = LaneChange(double=True, offset_m=-2.5, heading_deg=30, straight_m=15, change_m=10)
    points = sample(path, np.linspace(0, path.duration_s, 4000))
    c, s = np.cos(radians(30)), np.sin(radians(30))
    x, y = points @ (c, s), points @ (-s, c)
    assert np.interp((0, 32, 60), x, y) == pytest.approx((0, -2.5, 0), abs=1e-3)
    assert x[-1] == pytest.approx(65, abs=1e-3)
