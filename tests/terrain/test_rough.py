"""Spectrum of rough ground in ISO 8608 classes along rows, columns, diagonals and other lines."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.signal import periodogram, welch

from agrobot_mj.terrain import Rough
from agrobot_mj.terrain.rough import ROUGHNESS, plane_spectrum

HALF_M, NODE_M = 60.0, 0.1
FIELD = Rough(iso_class="D", half_size_m=HALF_M, node_m=NODE_M, seed=4)


def class_spectrum(n, iso_class="D"):
    """Return the spectrum G_d of the standard [m3]."""
    return {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}[iso_class] * (n / 0.1) ** -2.0


def by_octave(profiles, spacing, low, high, segment):
    """Return the mean ratio of measured to nominal spectrum in each octave from `low` to `high` [cycle/m]."""
    n, measured = welch(profiles, 1 / spacing, window="hann", nperseg=segment, detrend="linear", axis=-1)
    share = (measured.mean(axis=0)[1:] / class_spectrum(n[1:]), n[1:])
    edges = low * 2.0 ** np.arange(int(np.log2(high / low)) + 1)
    return np.array([share[0][(share[1] >= a) & (share[1] < b)].mean() for a, b in pairwise(edges)])


@pytest.mark.parametrize("iso_class", ROUGHNESS)
def test_rough_ground_of_every_class_has_the_iso_8608_spectrum(iso_class):
    heights = Rough(iso_class=iso_class, half_size_m=30.0, node_m=NODE_M).ground().heights
    for profiles in (heights[:-1, :-1], heights[:-1, :-1].T):
        n, measured = periodogram(profiles, 1 / NODE_M, detrend=False)
        band = (n > 0) & (n <= 2.83)
        share = measured.mean(axis=0)[band] / class_spectrum(n[band], iso_class)
        assert share == pytest.approx(1.0, abs=0.02)
        assert n[band].min() == pytest.approx(1 / 60.0)


@pytest.mark.parametrize("axis", ["rows", "columns"])
@pytest.mark.parametrize("seed", [1, 2])
def test_welch_spectrum_of_rough_ground_matches_its_class(axis, seed):
    heights = Rough(iso_class="D", half_size_m=HALF_M, seed=seed).ground().heights
    ratios = by_octave(heights if axis == "rows" else heights.T, NODE_M, 10 / (2 * HALF_M), 2.83, 600)
    assert ratios.size == 5
    assert ratios == pytest.approx(1.0, abs=0.1)


def test_roughness_spectrum_is_equal_along_diagonals_and_axes():
    heights, root = FIELD.ground().heights, np.sqrt(2.0)
    length = heights.shape[0] * 3 // 4
    diagonals = [np.diagonal(h, k)[:length] for h in (heights, heights[:, ::-1]) for k in range(-300, 301, 5)]
    ratios = by_octave(np.array(diagonals), NODE_M * root, 10 / (2 * HALF_M), 2.83, length // 2)
    assert ratios.size == 5
    assert ratios == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("angle_deg", [20.0, 45.0, 110.0])
def test_heights_along_any_line_have_the_spectrum_of_their_class(angle_deg):
    ground = FIELD.ground()
    nodes = ground.x0 + ground.spacing * np.arange(ground.heights.shape[0])
    between = RegularGridInterpolator((nodes, nodes), ground.heights)
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    along, across = np.meshgrid(np.arange(-40.0, 40.0, 0.05), np.arange(-40.0, 40.0, 0.5))
    inside = np.abs([c * along - s * across, s * along + c * across]).max() < HALF_M
    assert inside
    profiles = between((s * along + c * across, c * along - s * across))
    ratios = by_octave(profiles, 0.05, 0.175, 0.07 / NODE_M, 800)
    assert ratios.size == 2
    assert ratios == pytest.approx(1.0, abs=0.1)


def test_roughness_spectrum_vanishes_at_the_nyquist_wave_number():
    """With waves up to its limit, a grid would be jagged in diagonal direction and show aliasing."""
    n, measured = periodogram(FIELD.ground().heights[:-1, :-1], 1 / NODE_M, detrend=False)
    assert measured.mean(axis=0)[n > 4.2].max() < 1e-3 * class_spectrum(4.2)


def test_coarse_grid_keeps_roughness_below_its_maximum_wave_number():
    heights = Rough(iso_class="D", half_size_m=100.0, node_m=0.5).ground().heights[:-1, :-1]
    n, measured = periodogram(heights, 2.0, detrend=False)
    band = (n > 0) & (n <= 0.35 / 0.5)
    assert measured.mean(axis=0)[band] == pytest.approx(class_spectrum(n[band]), rel=0.02)


def test_rough_ground_heights_are_nearly_gaussian():
    """Phases are random, so that no single wave dominates."""
    heights = FIELD.ground().heights
    slopes = np.diff(heights, axis=1)[::7, ::7].ravel() / NODE_M
    assert abs(((slopes - slopes.mean()) ** 3).mean()) / slopes.std() ** 3 < 0.1
    assert ((slopes - slopes.mean()) ** 4).mean() / slopes.var() ** 2 == pytest.approx(3.0, abs=0.2)


def test_two_dimensional_spectrum_equals_the_closed_form_of_a_power_law():
    """For the power law alone the inverse Abel transform is G_d(n_0) n_0^2 / (4 k^3)."""
    k = np.array([0.01, 0.1, 1.0])
    assert plane_spectrum(k, 256e-6, 1e4) == pytest.approx(256e-6 * 0.01 / (4 * k**3), rel=1e-3)


def test_rough_ground_has_zero_height_at_the_origin_and_is_periodic():
    ground = FIELD.ground()
    middle = ground.heights.shape[0] // 2
    assert ground.heights[middle, middle] == 0.0
    assert np.array_equal(ground.heights[0], ground.heights[-1])
