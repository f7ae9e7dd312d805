"""Height grid: exact on planes, bilinear between nodes, continuous across cells, and flat beyond its border."""

from math import cos, hypot, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from agrobot_mj.terrain import Flat, Ground, Slope, height_and_gradient
from agrobot_mj.terrain.grid import plane

unhurried = settings(deadline=None)  # the first call compiles
ROUGH = Ground(-3.0, 2.0, 0.7, np.random.default_rng(5).normal(size=(6, 9)))
"""Grid with six rows (north) and nine columns (east), not centred, so that swapped axes are detected."""


def within(ground, margin=0.0):
    """Return a Hypothesis strategy for points on a grid, at least `margin` from its border."""
    x_min, x_max, y_min, y_max = ground.extent
    return st.tuples(
        st.floats(x_min + margin, x_max - margin, allow_subnormal=False),
        st.floats(y_min + margin, y_max - margin, allow_subnormal=False),
    )


@unhurried
@given(grade=st.tuples(st.floats(-1, 1), st.floats(-1, 1)), point=within(plane(0, 0, 40)))
def test_height_and_gradient_of_a_plane_are_exact_everywhere(grade, point):
    got = height_and_gradient(plane(*grade, 40.0), *point)
    assert got == pytest.approx((grade[0] * point[0] + grade[1] * point[1], *grade), abs=1e-11)


@pytest.mark.parametrize("grade_deg", [0.0, 10.0, 44.0])
@pytest.mark.parametrize("direction_deg", [0.0, 90.0, 200.0])
def test_slope_rises_by_its_grade_in_its_direction(grade_deg, direction_deg):
    ground = Slope(grade_deg=grade_deg, direction_deg=direction_deg).ground()
    up = cos(radians(direction_deg)), sin(radians(direction_deg))
    height, dx, dy = height_and_gradient(ground, 7.0 * up[0], 7.0 * up[1])
    assert height == pytest.approx(7.0 * tan(radians(grade_deg)), abs=1e-9)
    assert hypot(dx, dy) == pytest.approx(tan(radians(grade_deg)), abs=1e-12)
    assert (dx * up[0] + dy * up[1]) == pytest.approx(tan(radians(grade_deg)), abs=1e-12)
    across, _, _ = height_and_gradient(ground, -7.0 * up[1], 7.0 * up[0])
    assert across == pytest.approx(0.0, abs=1e-9)


@unhurried
@given(within(ROUGH))
def test_heights_equal_bilinear_interpolation_of_scipy(point):
    rows, columns = ROUGH.heights.shape
    x = ROUGH.x0 + ROUGH.spacing * np.arange(columns)
    y = ROUGH.y0 + ROUGH.spacing * np.arange(rows)
    oracle = RegularGridInterpolator((y, x), ROUGH.heights, bounds_error=False, fill_value=None)
    assert height_and_gradient(ROUGH, *point)[0] == pytest.approx(float(oracle(point[::-1])), abs=1e-9)


@unhurried
@given(
    cell=st.tuples(st.integers(0, 7), st.integers(0, 4)),
    inside=st.tuples(st.floats(0.01, 0.99), st.floats(0.01, 0.99)),
)
def test_gradient_is_the_derivative_of_the_heights(cell, inside):
    x = ROUGH.x0 + ROUGH.spacing * (cell[0] + inside[0])
    y = ROUGH.y0 + ROUGH.spacing * (cell[1] + inside[1])
    e = 1e-4
    across = [height_and_gradient(ROUGH, x + s * e, y)[0] for s in (1, -1)]
    along = [height_and_gradient(ROUGH, x, y + s * e)[0] for s in (1, -1)]
    differences = (across[0] - across[1]) / (2 * e), (along[0] - along[1]) / (2 * e)
    assert height_and_gradient(ROUGH, x, y)[1:] == pytest.approx(differences, abs=1e-8)


@unhurried
@given(point=within(ROUGH), step=st.tuples(st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6)))
def test_heights_are_continuous_across_cell_borders(point, step):
    steepest = 2 * np.ptp(ROUGH.heights) / ROUGH.spacing
    here = height_and_gradient(ROUGH, *point)[0]
    there = height_and_gradient(ROUGH, point[0] + step[0], point[1] + step[1])[0]
    assert abs(there - here) <= steepest * (abs(step[0]) + abs(step[1])) + 1e-12


def test_heights_at_grid_nodes_equal_the_node_values():
    rows, columns = ROUGH.heights.shape
    for j in range(rows):
        for i in range(columns):
            x, y = ROUGH.x0 + i * ROUGH.spacing, ROUGH.y0 + j * ROUGH.spacing
            assert height_and_gradient(ROUGH, x, y)[0] == pytest.approx(ROUGH.heights[j, i], abs=1e-12)


@pytest.mark.parametrize(("x", "y"), [(-1e4, 3.1), (1e4, 3.1), (-1.2, -1e4), (-1.2, 1e4), (1e4, -1e4)])
def test_heights_outside_the_grid_equal_the_heights_at_its_border(x, y):
    x_min, x_max, y_min, y_max = ROUGH.extent
    border = height_and_gradient(ROUGH, min(max(x, x_min), x_max), min(max(y, y_min), y_max))[0]
    assert height_and_gradient(ROUGH, x, y)[0] == pytest.approx(border, abs=1e-12)
    assert not ROUGH.covers(x, y)


def test_extent_and_coverage_of_a_height_grid_are_correct():
    assert ROUGH.extent == pytest.approx((-3.0, 2.6, 2.0, 5.5))
    assert ROUGH.covers(-3.0, 2.0)
    assert ROUGH.covers(2.5, 5.4)
    assert not ROUGH.covers(2.7, 3.0)
    assert not ROUGH.covers(0.0, 5.6)


def test_only_a_grid_with_coplanar_nodes_is_classified_as_a_plane():
    assert plane(0.3, -0.2, 10.0).is_plane
    assert not Ground(0.0, 0.0, 1.0, np.array([[0.0, 0.0], [0.0, 0.1]])).is_plane
    assert not ROUGH.is_plane


def test_level_ground_has_zero_height():
    assert not Flat().ground().heights.any()


@pytest.mark.parametrize("point", [(np.nan, 1.0), (1.0, np.nan), (np.nan, np.nan)])
@pytest.mark.parametrize("read", [height_and_gradient, getattr(height_and_gradient, "py_func", height_and_gradient)])
def test_height_at_a_nan_position_is_nan(read, point):
    """In compiled code, the cell index of NaN would be -2^63 without a bounds check; plain Python would raise."""
    assert np.isnan(read(ROUGH, *point)).all()


@pytest.mark.parametrize("far", [np.inf, -np.inf, 1e300, -1e300])
def test_height_far_outside_the_grid_is_the_border_height(far):
    assert np.isfinite(height_and_gradient(ROUGH, far, 1.0)).all()
